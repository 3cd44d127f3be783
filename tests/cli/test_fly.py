"""`circnav fly` without a vehicle: exit code 3, and the received traffic. Also with a signing
key."""

import json
import re
import socket
import threading
from contextlib import contextmanager
from importlib import util

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.flight.signed import KEY
from tests.process import PATIENCE
from tests.process import circnav as process_of

pytestmark = pytest.mark.usefixtures("undrawn")


def summary(folder):
    return json.loads((folder / "summary.json").read_text(encoding="utf-8"))


def test_flight_without_vehicle_is_recorded_with_exit_3(circnav, mission, port, tmp_path):
    endpoint = f"tcp:127.0.0.1:{port}"
    ran = circnav("fly", mission, "--endpoint", endpoint)
    assert (ran.code, ran.line) == (
        3,
        f"circnav: endpoint {endpoint}: connection refused: no program listens at this address",
    )
    ran = circnav("fly", mission, "--set", "orbit.radius_m=80.0", "--duration", "7")
    assert (ran.code, ran.err) == (3, "")
    assert "no vehicle: no autopilot heartbeat, 0 bytes received" in ran.out
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.endswith("-small")
    assert {"summary.json", "ticks.csv", "flight.tlog", "mission.toml"} <= {
        path.name for path in folder.iterdir()
    }
    made = summary(folder)
    assert (made["outcome"], made["settled_s"], made["truth"], made["setpoints_sent"]) == (
        "aborted",
        None,
        None,
        0,
    )
    assert made["reason"].startswith("no vehicle: ")
    text = (folder / "mission.toml").read_text(encoding="utf-8")
    assert "radius_m = 80.0" in text
    assert "duration_s = 7.0" in text


PATIENTLY = "--set", "link.wait_s=1.5"
"""Time that circnav waits for a vehicle. It is long enough to receive a sender at 50 Hz even if the
test process is stopped for 1 s."""


@contextmanager
def speaking(port, datagram):
    """Send a datagram to a port repeatedly."""
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
    message = mavlink.MAVLink_heartbeat_message(
        2, 3, base_mode=129, custom_mode=4, system_status=4, mavlink_version=3
    )
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=1)))


@pytest.mark.parametrize(
    ("datagram", "reason"),
    [
        (b"GET / HTTP/1.1", "0 frames"),
        (heartbeat(system=9), "system 9 is not the mission's vehicle.system_id 1"),
        (heartbeat(), "no ranging: no usable DISTANCE_SENSOR, rejected: none"),
    ],
    ids=["junk", "wrong system id", "no ranging"],
)
def test_missing_vehicle_reports_received_traffic(circnav, mission, port, datagram, reason):
    endpoint = ("--endpoint", f"udpin:127.0.0.1:{port}", *PATIENTLY)
    with speaking(port, datagram):
        ran = circnav("fly", mission, *endpoint, "--set", "vehicle.system_id=1")
    assert (ran.code, ran.err) == (3, "")
    assert reason in ran.out


def system_time(unix):
    message = mavlink.MAVLink_system_time_message(round(1e6 * unix), 60_000)
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1)))


YEAR_2060 = 2_842_000_000


@pytest.mark.parametrize(
    ("unix", "is_later"), [(YEAR_2060, True), (0, False), (1_000_000_000, False)]
)
def test_run_folder_is_named_by_autopilot_utc_if_later(
    circnav, mission, port, tmp_path, unix, is_later
):
    endpoint = ("--endpoint", f"udpin:127.0.0.1:{port}", *PATIENTLY)
    with speaking(port, heartbeat() + system_time(unix)):
        ran = circnav("fly", mission, *endpoint)
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.startswith("2060") is is_later
    assert str(folder.relative_to(tmp_path)) in ran.out
    found = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["utc_epoch_us"]
    assert found == (pytest.approx(1e6 * unix, abs=60e6) if is_later else None)


@pytest.mark.parametrize(
    ("command", "prefix"), [("fly", "WARNING    "), ("preflight", "WARN  endpoint      ")]
)
def test_flight_reports_ignored_senders(circnav, mission, port, command, prefix):
    endpoint = f"udpin:127.0.0.1:{port}"
    with speaking(port, heartbeat()):
        ran = circnav(
            command, mission, "--endpoint", endpoint, *PATIENTLY, "--set", "link.peer=192.0.2.7"
        )
    assert ran.code == 3
    assert re.search(
        rf"{prefix}{endpoint}: ignored: from 127\.0\.0\.1:\d+ \(\d+ times\)\n", ran.out
    )


def test_sigterm_ends_flight_with_130_and_complete_files(mission, tmp_path):
    folder = tmp_path / "out"
    arguments = ("--set", "link.wait_s=30.0", "--out", str(folder))
    with process_of("fly", str(mission), *arguments, drawn=False) as process:
        try:
            assert any("waiting for the link" in line for line in process.stdout)
            process.terminate()
            out, err = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    assert (process.returncode, err) == (130, "")
    assert "INTERRUPTED: SIGTERM" in out
    assert summary(folder)["outcome"] == "interrupted"


@pytest.mark.parametrize(
    ("endpoint", "ranging", "words"),
    [
        ("udpin:192.0.2.1:14550", "", "no interface of this computer has this address"),
        ("udpout:no.such.host.invalid:14550", "", "unknown host name"),
        ("udpin:127.0.0.1:0", "udpin:192.0.2.1:5005", "no interface of this computer"),
        pytest.param(
            *("udpin:127.0.0.1:0", "lines:udpin:192.0.2.1:5005", "no interface of this computer"),
            marks=pytest.mark.skipif(
                not util.find_spec("circnav_mav.extras"), reason="the driver is an extra"
            ),
        ),
        ("tcp:127.0.0.1:{port}", "", "connection refused"),
    ],
)
def test_fly_waits_for_address_that_is_not_there_yet(
    circnav, mission, port, endpoint, ranging, words
):
    apart = (f'ranging.endpoint="{ranging}"', 'ranging.message="ranging_beacon"')
    options = [part for one in apart if ranging for part in ("--set", one)]
    endpoint = endpoint.format(port=port)
    ran = circnav("fly", mission, "--endpoint", endpoint, "--set", "link.wait_s=0.1", *options)
    assert ran.code == 3
    assert f"{words}" in ran.line
    assert ": waiting" in ran.out


# --- with a signing key


@pytest.fixture
def key(mission):
    """The mission's key file of 64 hex digits, beside the mission."""
    with mission.open("a") as file:
        file.write('[signing]\nkey_file = "drone.key"\n')
    path = mission.with_name("drone.key")
    path.touch(0o600)
    path.write_text(KEY.hex())
    return path


@pytest.fixture
def unsigned(circnav, mission, key, port):
    """Run a command that receives only unsigned heartbeats: unsigned("fly")."""

    def unsigned(command, *options):
        with speaking(port, heartbeat()):
            return circnav(
                command, mission, "--endpoint", f"udpin:127.0.0.1:{port}", *PATIENTLY, *options
            )

    return unsigned


def test_flight_refuses_damaged_timestamp_and_world_readable_key(circnav, mission, key):
    key.with_name("drone.key.timestamp").write_text("yesterday")
    assert "drone.key.timestamp: is not a timestamp" in circnav("fly", mission).refused
    key.chmod(0o644)
    error = f"{key}: other users can read this key (mode 644): chmod 600 {key}"
    assert circnav("fly", mission).refused == f"{mission}: signing.key_file: {error}"


def test_unsigned_vehicle_is_reported_without_the_key(unsigned, key, tmp_path):
    ran = unsigned("fly", "--out", tmp_path / "out")
    assert (ran.code, ran.err) == (3, "")
    (line,) = [line for line in ran.out.splitlines() if line.startswith("ABORTED")]
    assert "every frame received is unsigned or wrongly signed" in line
    assert "check signing.key_file" in line
    made = summary(tmp_path / "out")
    assert (set(made["frames_refused"]), made["setpoints_sent"]) == ({"unsigned"}, 0)
    kept = b"".join(path.read_bytes() for path in (tmp_path / "out").iterdir()) + ran.out.encode()
    assert str(key).encode() in kept
    assert not any(secret in kept for secret in (KEY, KEY.hex().encode(), repr(KEY).encode()))
    ran = unsigned("preflight", "--seconds", "1")
    assert ran.code == 3
    assert "every frame received is unsigned or wrongly signed" in ran.out
