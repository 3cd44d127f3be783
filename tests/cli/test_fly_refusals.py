"""`circnav fly` where no vehicle is: exit code 3, and what was heard; and where it is told to end."""

import json
import re
import socket
import threading
from contextlib import contextmanager

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.process import PATIENCE
from tests.process import circnav as process_of

pytestmark = pytest.mark.usefixtures("undrawn")


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


PATIENTLY = "--set", "link.wait_s=1.5"
"""Heard is who speaks fifty times a second, also where this process stands still for a second."""


@contextmanager
def speaking(port, datagram):
    """A datagram comes to a port again and again."""
    over = threading.Event()

    def speak():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not over.wait(0.02):
                out.sendto(datagram, ("127.0.0.1", port))

    speaker = threading.Thread(target=speak)
    speaker.start()
    yield
    over.set()
    speaker.join()


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
    with speaking(port, datagram):
        ran = circnav("fly", mission, *endpoint, "--set", "vehicle.system_id=1")
    assert (ran.code, ran.err) == (3, "")
    assert told in ran.out


@pytest.mark.parametrize(("command", "said"), [("fly", "WARNING    "), ("preflight", "WARN  endpoint    ")])
def test_what_goes_wrong_on_an_endpoint_is_told(circnav, mission, port, command, said):
    endpoint = f"udpin:127.0.0.1:{port}"
    with speaking(port, heartbeat()):
        ran = circnav(command, mission, "--endpoint", endpoint, *PATIENTLY, "--set", "link.peer=192.0.2.7")
    assert ran.code == 3
    assert re.search(rf"{said}{endpoint}: ignored: sent by 127\.0\.0\.1:\d+ \(\d+ times\)\n", ran.out)


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
