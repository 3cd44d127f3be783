"""`circnav fly` where it cannot fly: one clear line, the right exit code, no traceback."""

import json
import socket
import threading
from contextlib import ExitStack

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.process import PATIENCE
from tests.process import circnav as process_of

pytestmark = pytest.mark.usefixtures("undrawn")


def test_a_missing_file(circnav):
    assert circnav("fly", "nowhere.toml").refused == "nowhere.toml: cannot be read: No such file or directory"


def test_an_impossible_gain_is_refused_before_anything_is_opened(circnav, mission, tmp_path):
    ran = circnav("fly", mission, "--set", "guidance.gain=1e-5", "--out", tmp_path / "out")
    assert ran.refused == f"{mission}: refused by its checks, see FAIL above"
    assert "FAIL" in ran.out
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ("--set orbit.radius_m", "--set orbit.radius_m: write it as table.key=value"),
        ("--duration -5", "limits.duration_s: must be above 0, not -5"),
        ("--speed 0", "link.sim_speed: must be above 0, not 0"),
        ("--speed 8", "--speed: only the bundled vehicle flies at another speed, not udpin:127.0.0.1:0"),
        ("--endpoint udpin:127.0.0.1:BUSY", "port is in use by another program: close it, or choose another port"),
        (
            "--set ranging.endpoint=udpin:127.0.0.1:BUSY",
            "port is in use by another program: close it, or choose another port",
        ),
        ("--out /dev/null/run", "/dev/null/run: cannot be written: Not a directory"),
    ],
)
def test_an_option_that_cannot_be_followed_is_one_line(circnav, mission, busy_port, options, line):
    assert circnav("fly", mission, *options.replace("BUSY", str(busy_port)).split()).refused.endswith(line)


def test_a_run_folder_without_a_name_is_refused(circnav, mission):
    assert circnav("fly", mission, "--out", "").refused == "--out: is empty, give it a name"


# --- nobody there: exit code 3, and what was heard ---


def test_a_tcp_endpoint_where_nobody_listens(circnav, mission):
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        endpoint = f"tcp:127.0.0.1:{unused.getsockname()[1]}"
        ran = circnav("fly", mission, "--endpoint", endpoint)
    assert (ran.code, ran.line) == (3, f"circnav: endpoint {endpoint}: nobody listens there (connection refused)")


def summary(folder):
    return json.loads((folder / "summary.json").read_text(encoding="utf-8"))


def test_no_heartbeat_at_all_is_recorded_in_a_folder_named_after_time_and_mission(circnav, mission, tmp_path):
    ran = circnav("fly", mission, "--set", "orbit.radius_m=80.0", "--duration", "7")
    assert (ran.code, ran.err) == (3, "")
    assert "no vehicle: no autopilot heartbeat, 0 bytes heard" in ran.out
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.endswith("-small")
    assert {"summary.json", "ticks.csv", "flight.tlog", "mission.toml"} <= {path.name for path in folder.iterdir()}
    made = summary(folder)
    assert (made["outcome"], made["settled_s"], made["truth"], made["setpoints_sent"]) == ("aborted", None, None, 0)
    assert made["reason"].startswith("no vehicle: ")
    text = (folder / "mission.toml").read_text(encoding="utf-8")
    assert "radius_m = 80.0" in text, "as flown, with its overrides"
    assert "duration_s = 7.0" in text


@pytest.mark.parametrize(("command", "said"), [("fly", "WARNING    "), ("preflight", "WARN  endpoint    ")])
def test_what_goes_wrong_on_an_endpoint_is_told(circnav, mission, command, said):
    """A server that hangs up. (A close with our heartbeat unread would be a reset.)"""
    with socket.create_server(("127.0.0.1", 0)) as server, ExitStack() as kept:

        def hang_up() -> None:
            kept.enter_context(server.accept()[0]).shutdown(socket.SHUT_WR)

        hangs_up = threading.Thread(target=hang_up)
        hangs_up.start()
        endpoint = f"tcp:127.0.0.1:{server.getsockname()[1]}"
        ran = circnav(command, mission, "--endpoint", endpoint, "--set", "link.wait_s=2")
        hangs_up.join()
    assert ran.code == 3
    assert f"{said}{endpoint}: closed by the other side\n" in ran.out


PATIENTLY = "--set", "link.wait_s=1.5"
"""Heard is who speaks fifty times a second, also where this process stands still for a second."""


class Speaker(threading.Thread):
    """Says the same datagram to a port again and again, until it is stopped."""

    def __init__(self, port, datagram):
        super().__init__(daemon=True)
        self._port, self._datagram, self._over = port, datagram, threading.Event()

    def run(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not self._over.wait(0.02):
                out.sendto(self._datagram, ("127.0.0.1", self._port))

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self.join()


def heartbeat(system=1):
    message = mavlink.MAVLink_heartbeat_message(2, 3, base_mode=129, custom_mode=4, system_status=4, mavlink_version=3)
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=1)))


@pytest.mark.parametrize(
    ("datagram", "told"),
    [
        (b"GET / HTTP/1.1", "0 frames"),
        (heartbeat(system=9), "system 9 is not the mission's vehicle.system_id 1"),
        (heartbeat(), "no ranging: no usable DISTANCE_SENSOR, rejected: none"),
    ],
    ids=["junk", "wrong system id", "no ranging"],
)
def test_what_was_heard_instead_of_the_vehicle_is_told(circnav, mission, port, datagram, told):
    endpoint = ("--endpoint", f"udpin:127.0.0.1:{port}", *PATIENTLY)
    with Speaker(port, datagram):
        ran = circnav("fly", mission, *endpoint, "--set", "vehicle.system_id=1")
    assert (ran.code, ran.err) == (3, "")
    assert told in ran.out


def test_a_sigterm_ends_the_process_with_130_and_whole_files(mission, tmp_path):
    folder = tmp_path / "out"
    with process_of("fly", str(mission), "--set", "link.wait_s=30.0", "--out", str(folder)) as process:
        try:
            assert any("waiting for the link" in line for line in process.stdout), "a plain line a second"
            process.terminate()
            out, err = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    assert (process.returncode, err) == (130, "")
    assert "INTERRUPTED: SIGTERM" in out
    assert summary(folder)["outcome"] == "interrupted"
