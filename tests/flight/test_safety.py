"""Complete flights in lockstep with failing sensors, streams and ranges, and with a stalled
computer."""

import itertools

import pytest

from circnav_mav.pilot import VEHICLE, OutputMode, Pilot
from circnav_mav.pilot.mission_state import STEERING, Phase
from tests.flight.lockstep import flight, last_third, message_ids, rms_error, tangent
from tests.frames import read
from tests.tools.fault_link.frames import frames, message_id

NEAR = tangent(180.0)
"""Start of the plane near its circle."""


def is_ranging(frame: bytes) -> bool:
    return message_ids(frame) == [132]


@pytest.mark.parametrize("law", ["auto", "drift"])
def test_setpoints_continue_when_attitude_messages_stop(law: str) -> None:
    """The autopilot stops sending ATTITUDE, so own motion is unknown. The ranges continue."""
    flown = flight("arduplane", *NEAR, law=law).fly(12)
    flown.hears = lambda frame, now: message_ids(frame) != [30]
    flown.fly(24)
    times = [time for time in flown.setpoint_times if time > 11]
    assert max(b - a for a, b in itertools.pairwise(times)) < 0.2
    assert times[-1] > 23.5
    assert flown.pilot.mission.phase in STEERING


def test_stuck_airspeed_sensor_raises_airspeed_alarm() -> None:
    flown = flight("arduplane", *NEAR, "limits.duration_s=200", law="auto").fly(50)
    flown.vehicle._flight.instruments.airspeed = lambda shown: 27.0  # type: ignore[method-assign]
    flown.fly(95)
    assert any(b"airspeed reads" in data and b"too high" in data for _, data in flown.sent)
    assert rms_error(flown.truths[-200:], 150.0) < 8.0


def test_plane_keeps_circle_with_one_attitude_per_second() -> None:
    """Example: an autopilot that refuses the request for a faster ATTITUDE stream."""
    flown = flight("arduplane", "sim.wind.speed_mps=5.0", "limits.duration_s=150", law="auto")
    flown.hears = lambda frame, now: message_ids(frame) != [30] or now % 1.0 < 0.051
    flown.fly(130)
    assert rms_error(last_third(flown), 150.0) < 5.0
    assert sum(b"attitude rarer than" in data for _, data in flown.sent) == 1


def test_dry_run_beside_steering_pilot_reports_drift_law() -> None:
    flown = flight("arducopter", law="auto")
    dry = Pilot(flown.pilot.settings, output_mode=OutputMode.DRY_RUN)

    def listens(frame: bytes, now: float) -> bool:
        dry.receive(frame, now, "sim", VEHICLE)
        return True

    flown.hears = listens
    flown.fly(26, lambda here: dry.step(here.now, lambda data: True))
    laws = [record.law for record in dry.take_records() if record.time > 18]
    assert laws.count("drift") > 0.9 * len(laws)


def test_coasting_turns_at_v_over_r_until_ranges_return() -> None:
    flown = flight("quickstart", "limits.coast_s=20")
    flown.hears = lambda frame, now: not (is_ranging(frame) and 30 < now < 36)
    phases = []
    flown.fly(54, lambda f: phases.append((f.now, f.pilot.mission.phase)))
    coasting = [now for now, phase in phases if phase is Phase.COASTING]
    assert 30.3 < coasting[0] < 30.8
    assert 35.9 < coasting[-1] < 37.0  # the first range after the outage arrives at 36.0 s
    steady = [tick.turn_rate for tick in flown.ticks if tick.phase is Phase.COASTING]
    # V/r_d; 1 % for the error of the learned turn gain
    assert steady == pytest.approx([-15.0 / 100.0] * len(steady), rel=0.01)
    assert rms_error(last_third(flown), 100.0) < 2.0


@pytest.mark.parametrize("pause", [1.0, 6.0])
def test_stall_of_computer_raises_one_alarm(pause: float) -> None:
    """The messages that the vehicle sends during the stall arrive at its end."""
    flown = flight("arduplane", *NEAR).fly(20.0)
    before = len(flown.sent)
    resumed = flown.now + pause
    while flown.clock.now() < resumed:
        flown.clock.advance(resumed)
    alarms: set[str] = set()
    flown.fly(40.0, lambda now: alarms.update(now.pilot.conditions.alarms))
    texts = [
        read(frame).text
        for _, data in flown.sent[before:]
        for frame in frames(data)
        if message_id(frame) == 253
    ]
    assert alarms == {"stalled"}
    assert texts == [f"circnav: computer stalled for {pause:.1f} s"]
    assert flown.pilot.mission.phase is Phase.ENGAGED
    assert not flown.pilot.conditions.alarms
    assert flown.pilot.session.timesync.worst < 0.5
