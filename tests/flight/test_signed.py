"""Signed flights end to end: in lockstep, over sockets and replayed; and flights that must not
start."""

import hashlib
import json
import subprocess
import time
from pathlib import Path

import pytest
from circnav_sim.config import Event
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.framing import split_frames
from circnav_mav.mav.signing import Refusal, is_signed
from circnav_mav.pilot import Ending
from circnav_mav.pilot.mission_state import Phase
from tests.command_line import circnav, undrawn
from tests.flight.lockstep import UNIX, clockwise_turns, last_third, rms_error
from tests.flight.signed import KEY, OTHER, key_file, signed_flight, voice
from tests.process import PATIENCE, QUICKSTART
from tests.process import circnav as start

__all__ = ["circnav", "undrawn"]

MODE_LOITER = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 5, 0, 0, 0, 0, 0)
EPOCH = 1_420_070_400


def test_signed_flight_circles_without_rejected_frames(tmp_path: Path) -> None:
    flown = signed_flight(
        "arducopter", tmp_path, 'orbit.direction="counterclockwise"', "limits.duration_s=1000.0"
    )
    flown.fly(66)
    assert flown.pilot.mission.phase is Phase.ENGAGED
    assert clockwise_turns(last_third(flown)) < -0.5
    radius = flown.pilot.settings.orbit.radius
    assert rms_error(last_third(flown), radius) < 0.05 * radius
    assert flown.pilot.frames_refused() == {}
    assert flown.vehicle.refused == 0
    assert all(is_signed(frame) for _, data in flown.sent for frame in split_frames(data))


APART = ('ranging.endpoint="sim"', 'sim.ranging.via="direct"')


@pytest.mark.parametrize(
    ("mission", "overrides", "clock"),
    [("px4_copter", (), 0.0), ("arducopter", APART, 0.0), ("arducopter", (), None)],
    ids=["PX4 before and in OFFBOARD", "separate ranging link", "vehicle without clock"],
)
def test_vehicle_with_matching_key_is_flown(mission, overrides, clock, tmp_path):
    """Without GPS an autopilot has no clock (None) and takes the time from our first frame. F22 of
    the fault matrix covers a wrong clock and unknown keys on one link."""
    flown = signed_flight(mission, tmp_path, *overrides, vehicle_clock=clock).fly(15)
    assert flown.pilot.mission.phase is Phase.ENGAGED
    assert len(flown.vehicle.setpoint_log) > 200
    assert flown.vehicle.refused == 0


@pytest.mark.parametrize(
    ("ours", "theirs", "overrides", "refusal", "reason"),
    [
        (KEY, None, APART, "unsigned", "every frame received is unsigned or wrongly signed"),
        (None, KEY, (), None, "set signing.key_file"),
    ],
    ids=["vehicle without key", "circnav without key"],
)
def test_vehicle_without_matching_key_is_not_flown(
    ours, theirs, overrides, refusal, reason, tmp_path
):
    wait = "link.wait_s=15.0"
    flown = signed_flight("arducopter", tmp_path, wait, *overrides, ours=ours, theirs=theirs).fly(
        100
    )
    assert reason in flown.outcome.reason
    assert flown.vehicle.setpoint_log == []
    if refusal is None:
        assert flown.vehicle.refused > 0
    else:
        assert flown.outcome.ending is Ending.NOTHING_RECEIVED
        assert set(flown.pilot.frames_refused()) == {refusal}
        assert flown.setpoint_times == []


def test_authenticated_reboot_ends_mission(tmp_path: Path) -> None:
    flown = signed_flight("arducopter", tmp_path).fly(12)
    flown.vehicle._run_event(Event(action="reboot", value=2.0))
    flown.fly(40)
    # STABILIZE is the mode after the reboot
    assert flown.outcome.reason.startswith("pilot or failsafe switched to STABILIZE after ")
    assert flown.now < 17
    assert flown.pilot.frames_refused() == {}


def test_forged_and_replayed_commands_have_no_effect(tmp_path: Path) -> None:
    """An attacker sends commands to the vehicle and imitates it, and then replays recorded
    frames."""
    flown = signed_flight("arducopter", tmp_path, "limits.duration_s=1000.0").fly(12)
    recorded: list[bytes] = []
    flown.hears = lambda frame, now: recorded.append(frame) or True
    flown.fly(13)
    before = flown.pilot.mission.engaged_at
    forger = voice(OTHER, timestamp=2**47, system=255)
    took_over = voice(OTHER, timestamp=2**47)
    for _ in range(50):
        flown.vehicle.receive(bytes(MODE_LOITER.pack(forger)))
        flown.vehicle.receive(bytes(MODE_LOITER.pack(voice(None, system=255))))
        loiter = mavlink.MAVLink_heartbeat_message(2, 3, 0x81, 5, 4, 3)
        flown.pilot.receive(bytes(loiter.pack(took_over)), flown.now, "sim")
        flown.pilot.receive(bytes(loiter.pack(voice(None))), flown.now, "sim")
        for frame in recorded[:5]:
            flown.pilot.receive(frame, flown.now, "sim")
        flown.fly(flown.now + 0.1)
    flown.fly(24)
    assert (flown.pilot.mission.phase, flown.pilot.mission.engaged_at) == (Phase.ENGAGED, before)
    assert flown.pilot.frames_refused() == {
        "unsigned": 50,
        "wrong_signature": 50,
        Refusal.REPEATED.value: 250,
    }
    assert flown.vehicle.refused == 100


def test_operator_with_key_takes_over(tmp_path: Path) -> None:
    flown = signed_flight("arducopter", tmp_path).fly(12)
    operator = voice(KEY, timestamp=round((UNIX + 12 - EPOCH) * 1e5), system=255, component=190)
    flown.vehicle.receive(bytes(MODE_LOITER.pack(operator)), "gcs")
    flown.fly(20)
    assert "pilot or failsafe switched to LOITER" in flown.outcome.reason


# --- the command `circnav fly`


def test_signed_run_replays_without_its_key(circnav, undrawn, tmp_path):
    """The run folder contains neither key nor signature."""
    key = key_file(tmp_path, KEY)
    folder = tmp_path / "out"
    flown = circnav(
        *("fly", QUICKSTART, "--duration", "20", "--out", folder),
        *("--set", f"signing.key_file={key}", "--set", f"sim.signing.key_file={key}"),
        *("--set", 'guidance.law="smooth"'),
    )
    assert flown.done
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["setpoints_sent"] > 350
    assert set(summary["frames_refused"]) <= {Refusal.REPEATED.value}
    kept = int(key.with_name("drone.key.timestamp").read_text())
    assert abs(EPOCH + kept / 1e5 - key.with_name("drone.key.timestamp").stat().st_mtime) < 15
    key.unlink()
    assert_nothing_secret_is_kept(folder)
    assert "byte for byte the same" in circnav("replay", folder).done


def assert_nothing_secret_is_kept(folder: Path) -> None:
    kept = b"".join(path.read_bytes() for path in folder.iterdir())
    assert KEY not in kept
    assert KEY.hex().encode() not in kept
    log = mavutil.mavlink_connection(str(folder / "flight.tlog"))
    kinds: dict[str, int] = {}
    while (message := log.recv_match()) is not None:
        kinds[message.get_type()] = kinds.get(message.get_type(), 0) + 1
        assert not is_signed(bytes(message.get_msgbuf()))
    assert kinds["SET_POSITION_TARGET_LOCAL_NED"] > 350
    assert kinds.get("BAD_DATA", 0) == 0


def test_pymavlink_with_passphrase_commands_signing_emulator(port: int, tmp_path: Path) -> None:
    """The command is sent by pymavlink's mavutil with `setup_signing`, as MAVProxy does. Without
    signing the vehicle ignores the command."""
    passphrase = "open sesame"
    made = subprocess.run(
        ["sh", "-c", f"printf %s '{passphrase}' | sha256sum | cut -c1-64 > drone.key"],
        cwd=tmp_path,
        check=True,
    )
    assert made.returncode == 0
    (tmp_path / "vehicle.toml").write_text(
        '[signing]\nkey_file = "drone.key"\n[start]\nmode = "LOITER"\n'
    )
    vehicle = start(
        "emulate", str(tmp_path / "vehicle.toml"), "--endpoint", f"udpin:127.0.0.1:{port}"
    )
    try:
        assert vehicle.stdout is not None
        assert "udpin" in vehicle.stdout.readline()
        stranger = request_guided(port, None)
        holder = request_guided(port, hashlib.sha256(passphrase.encode()).digest())
    finally:
        vehicle.terminate()
        vehicle.communicate(timeout=PATIENCE)
    assert stranger is None
    assert holder == mavlink.MAV_RESULT_ACCEPTED


def request_guided(port: int, key: bytes | None) -> int | None:
    """Request GUIDED and return the result, or None without an answer."""
    station = mavutil.mavlink_connection(
        f"udpout:127.0.0.1:{port}", source_system=255, dialect="all"
    )
    station.mav = mavlink.MAVLink(station, srcSystem=255, srcComponent=190)
    station.mav.robust_parsing = True
    if key is not None:
        station.setup_signing(key)
    end = time.monotonic() + (PATIENCE if key else 1.5)
    while time.monotonic() < end:
        station.mav.heartbeat_send(6, 8, 0, 0, 4)
        station.mav.command_long_send(1, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0)
        answer = station.recv_match(type="COMMAND_ACK", blocking=True, timeout=0.3)
        if answer is not None:
            station.close()
            return int(answer.result)
    station.close()
    return None
