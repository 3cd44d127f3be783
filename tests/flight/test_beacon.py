"""docs/beacon.py against the emulator with its own radio switched off: the range of a simulator that has none."""

import socket
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.process import PATIENCE, ROOT, UNHURRIED, circnav, python


def wait_for_ranges(port: int) -> None:
    """Until a station of the vehicle's hears them."""
    station, parser = mavlink.MAVLink(None, 255, 190), mavlink.MAVLink(None)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        wire.settimeout(PATIENCE)
        wire.connect(("127.0.0.1", port))
        wire.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(station))
        kinds: set[str] = set()
        while "DISTANCE_SENSOR" not in kinds:
            kinds = {message.get_type() for message in parser.parse_buffer(wire.recv(2048)) or []}


@pytest.mark.parametrize("profile", ["arducopter", "px4_copter"])
def test_a_simulator_without_a_radio_gets_one(profile: str, port: int, tmp_path: Path) -> None:
    mission = tmp_path / "mission.toml"
    text = (ROOT / "config" / f"{profile}.toml").read_text()
    mission.write_text(text.replace("rate_hz = 10.0\nnoise_m", "rate_hz = 0.0\nnoise_m"))
    at = f"127.0.0.1:{port}"
    vehicle = circnav("emulate", str(mission), "--endpoint", f"udpin:{at}", "--speed", "2")
    processes = [vehicle]
    try:
        assert vehicle.stdout is not None
        vehicle.stdout.readline()
        processes.append(python("docs/beacon.py", f"udpout:{at}", "--north", "30", "--east", "40", "--seed", "1"))
        wait_for_ranges(port)
        overrides = ("--set", 'link.clock="autopilot"', "--seconds", "10", *UNHURRIED)
        survey = circnav("preflight", str(mission), "--endpoint", f"udpout:{at}", *overrides)
        printed, _ = survey.communicate(timeout=PATIENCE)
    finally:
        for process in processes:
            process.terminate()
            process.communicate(timeout=PATIENCE)
    lines = {line.split()[1]: line for line in printed.split("listening")[1].splitlines()[1:] if line[:4] != "conf"}
    assert lines["ranging"].startswith("PASS"), printed
    assert lines["noise"].startswith("PASS"), printed
    assert lines["stamps"].startswith("PASS"), printed
    assert float(lines["distance"].split()[2]) == pytest.approx((50**2 + 15**2) ** 0.5, abs=4.0)  # drift, noise
    assert survey.returncode == 0, printed
