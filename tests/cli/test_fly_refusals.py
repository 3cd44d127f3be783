"""`circnav fly` where it cannot fly: one clear line, the right exit code, no traceback."""

import json
import os
import resource
import socket
import subprocess
import sys
import threading
from contextlib import ExitStack

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.process import PATIENCE

TRIES = "fly", "check"


@pytest.mark.parametrize("command", TRIES)
def test_a_missing_file(circnav, command):
    ran = circnav(command, "nowhere.toml")
    assert ran.code == 2
    assert ran.line == "circnav: nowhere.toml: cannot be read: No such file or directory"


@pytest.mark.parametrize("command", TRIES)
@pytest.mark.parametrize(
    ("right", "wrong", "line"),
    [
        ('name = "small"', "name = ", "not valid TOML: "),
        ("radius_m = 100.0", "raduis_m = 100.0", "orbit.raduis_m: unknown key, did you mean radius_m?"),
        ("radius_m = 100.0", 'radius_m = "wide"', "orbit.radius_m: should be a valid number, not 'wide'"),
        ("radius_m = 100.0", "radius_m = -100.0", "orbit.radius_m: must be above 0, not -100"),
        ("speed_mps = 15.0", "speed_mps = 0.0", "vehicle.speed_mps: must be above 0, not 0"),
        ("radius_m = 100.0\n", "", "orbit.radius_m: missing, add it"),
    ],
    ids=["bad TOML", "unknown key", "wrong type", "radius below 0", "speed of 0", "missing key"],
)
def test_a_mission_that_is_wrong(circnav, mission, text, command, right, wrong, line):
    mission.write_text(text.replace(right, wrong), encoding="utf-8")
    ran = circnav(command, mission)
    assert ran.code == 2
    assert ran.line.startswith(f"circnav: {mission}: {line}")


def test_an_impossible_gain_is_refused_before_anything_is_opened(circnav, mission, tmp_path):
    ran = circnav("fly", mission, "--set", "guidance.gain=1e-5", "--out", tmp_path / "out")
    assert ran.code == 2
    assert ran.line == f"circnav: {mission}: refused by its checks, see FAIL above"
    assert "FAIL" in ran.out
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--set", "orbit.radius_m"], "--set orbit.radius_m: write it as table.key=value"),
        (["--duration", "-5"], "limits.duration_s: must be above 0, not -5"),
        (["--speed", "0"], "link.sim_speed: must be above 0, not 0"),
        (["--speed", "1000"], "link.sim_speed: must be at most 100, not 1000"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_an_option_out_of_its_bounds(circnav, mission, options, line):
    ran = circnav("fly", mission, *options)
    assert ran.code == 2
    assert ran.line.endswith(line)


def test_a_speed_for_a_vehicle_that_is_not_the_bundled_one(circnav, mission):
    ran = circnav("fly", mission, "--speed", "8", "--endpoint", "udpin:127.0.0.1:14550")
    assert ran.code == 2
    assert ran.line == "circnav: --speed: only the bundled vehicle flies at another speed, not udpin:127.0.0.1:14550"


def test_a_tcp_endpoint_where_nobody_listens(circnav, mission, closed_port):
    ran = circnav("fly", mission, "--endpoint", f"tcp:127.0.0.1:{closed_port}")
    assert ran.code == 3
    assert ran.line == f"circnav: endpoint tcp:127.0.0.1:{closed_port}: nobody listens there (connection refused)"


def test_a_port_in_use(circnav, mission, busy_port):
    ran = circnav("fly", mission, "--endpoint", f"udpin:127.0.0.1:{busy_port}")
    assert ran.code == 2
    assert ran.line.startswith(f"circnav: endpoint udpin:127.0.0.1:{busy_port}: port is in use by another program")


def test_a_ranging_port_in_use(circnav, mission, busy_port):
    ran = circnav("fly", mission, "--set", f'ranging.endpoint="udpin:127.0.0.1:{busy_port}"')
    assert ran.code == 2
    assert "port is in use" in ran.line


@pytest.mark.parametrize("place", ["/proc/circnav", "/dev/null/run"])
def test_a_run_folder_that_cannot_be_written(circnav, mission, place):
    ran = circnav("fly", mission, "--out", place)
    assert ran.code == 2
    assert ran.line.startswith(f"circnav: {place}: cannot be written: ")


# --- nobody there: exit code 3, and what was heard ---


def summary(folder):
    return json.loads((folder / "summary.json").read_text(encoding="utf-8"))


def test_no_heartbeat_at_all(circnav, mission, tmp_path):
    ran = circnav("fly", mission, "--out", tmp_path / "out")
    assert ran.code == 3
    assert "no vehicle: no autopilot heartbeat, 0 bytes heard" in ran.out
    assert ran.err == ""
    made = summary(tmp_path / "out")
    assert made["outcome"] == "aborted"
    assert made["reason"].startswith("no vehicle: ")
    assert (made["settled_s"], made["truth"], made["setpoints_sent"]) == (None, None, 0)


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


def test_an_endpoint_that_refuses_datagrams_is_a_vehicle_that_is_not_there(circnav, mission, port):
    ran = circnav("fly", mission, "--endpoint", f"udpout:127.0.0.1:{port}")
    assert ran.code == 3
    assert "0 bytes heard" in ran.out


PATIENTLY = "--set", "link.wait_s=1.5"
"""Heard is who speaks fifty times a second, also where this process stands still for a second."""


class Speaker(threading.Thread):
    """Says the same datagrams to a port again and again, until it is stopped."""

    def __init__(self, port, *datagrams):
        super().__init__(daemon=True)
        self._port, self._datagrams, self._over = port, datagrams, threading.Event()

    def run(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not self._over.wait(0.02):
                for datagram in self._datagrams:
                    out.sendto(datagram, ("127.0.0.1", self._port))

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self.join()


def heartbeat(system=1, version=2, **fields):
    values = {"type": 2, "autopilot": 3, "base_mode": 129, "custom_mode": 4, "system_status": 4, "mavlink_version": 3}
    speaker = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    return bytes(mavlink.MAVLink_heartbeat_message(**values | fields).pack(speaker, force_mavlink1=version == 1))


@pytest.mark.parametrize(
    ("datagram", "options", "told"),
    [
        (b"GET / HTTP/1.1", [], "0 frames"),
        (heartbeat(system=9), ["--set", "vehicle.system_id=1"], "system 9 is not the mission's vehicle.system_id 1"),
        (heartbeat(version=1), [], "system 1 speaks MAVLink 1 only"),
        (heartbeat(autopilot=12), [], "system 1 is px4 quadrotor, the mission is for ardupilot copter"),
        (heartbeat(system=255, type=6, autopilot=8), [], "system/component ids: 255/1, MAVLink version: 2"),
        (heartbeat(), [], "no ranging: no usable DISTANCE_SENSOR, rejected: none"),
    ],
    ids=["junk", "wrong system id", "MAVLink 1 only", "another autopilot", "a ground station", "no ranging"],
)
def test_what_was_heard_instead_of_the_vehicle_is_told(circnav, mission, port, datagram, options, told):
    with Speaker(port, datagram):
        ran = circnav("fly", mission, "--endpoint", f"udpin:127.0.0.1:{port}", *PATIENTLY, *options)
    assert ran.code == 3
    assert told in ran.out
    assert ran.err == ""


def test_a_run_folder_is_named_after_time_and_mission_unless_given(circnav, mission, tmp_path):
    circnav("fly", mission)
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.endswith("-small")
    assert {"summary.json", "ticks.csv", "flight.tlog", "mission.toml"} <= {path.name for path in folder.iterdir()}


def test_the_mission_is_kept_as_flown_with_its_overrides(circnav, mission, tmp_path):
    circnav("fly", mission, "--set", "orbit.radius_m=80.0", "--duration", "7", "--out", tmp_path / "out")
    text = (tmp_path / "out" / "mission.toml").read_text(encoding="utf-8")
    assert "radius_m = 80.0" in text
    assert "duration_s = 7.0" in text


# --- a process of its own ---


def test_a_sigterm_ends_the_process_with_130_and_whole_files(mission, tmp_path):
    folder = tmp_path / "out"
    command = [sys.executable, "-m", "circnav_mav", "fly", mission, "--set", "link.wait_s=30.0", "--out", folder]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert any("waiting for the link" in line for line in process.stdout), "a plain line a second"
            process.terminate()
            out, err = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    assert process.returncode == 130, err
    assert "INTERRUPTED: SIGTERM" in out
    assert err == ""
    assert summary(folder)["outcome"] == "interrupted"


def test_a_disk_that_fills_up_in_flight_ends_with_a_warning_and_no_traceback(mission, tmp_path):
    """No file of the process may grow beyond 1 kB: the tick log meets that within half a second."""
    command = [
        sys.executable,
        "-m",
        "circnav_mav",
        "fly",
        mission,
        "--set",
        "link.wait_s=3.0",
        "--out",
        tmp_path / "out",
    ]
    ran = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000)),
    )
    assert "Traceback" not in ran.stderr
    assert ran.returncode == 3
    assert f"WARNING    {tmp_path / 'out'}: recording stopped: File too large" in ran.stdout


def test_a_run_folder_without_a_name_is_refused(circnav, mission, tmp_path):
    assert circnav("fly", mission, "--out", "").line == "circnav: --out: is empty, give it a name"
