"""Copters that lose GPS on the emulator. test_vehicles.py flies copters without GPS from the
start."""

import copy
from functools import cache

import pytest
from circnav_sim.config import Event

from circnav_mav.pilot import Ending, Phase, Pilot
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runlog.replay import replay
from tests.flight.ground_station import Operator
from tests.flight.lockstep import (
    Flight,
    clockwise_turns,
    flight,
    last_third,
    rms_error,
    true_radius,
)
from tests.rig import flown_for_long

GUIDED = 4
LOITER = 5
LAND = 9
ALT_HOLD = 2
GUIDED_NOGPS = 20
LOST_AT = 40.0
OVERRIDES = (
    f'sim.events=[{{at_s={LOST_AT},action="gps_off"}}]',
    "sim.truth.rate_hz=0",
    "sim.wind.speed_mps=2.0",
    "limits.duration_s=78.0",
    'guidance.law="auto"',
)


class Recorded(Flight):
    """A flight that records its steps."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.steps: list[LoopStep] = []

    def _keep(self, step: LoopStep) -> None:
        self.steps.append(step)
        super()._keep(step)


@cache
def _circling() -> Recorded:
    """Return a flight just before the loss of GPS. Copy it before use."""
    made = flight("arducopter", *OVERRIDES, law="auto")
    flown = Recorded(made.pilot, made.vehicle)
    flown.fly(LOST_AT)
    return flown


@cache
def _lost() -> Recorded:
    """Return a flight 5 s after the loss of GPS. Copy it before use."""
    flown = copy.deepcopy(_circling())
    flown.fly(LOST_AT + 5.0)
    return flown


def lost() -> Recorded:
    return copy.deepcopy(_lost())


def test_circle_continues_in_new_mode_after_gps_loss() -> None:
    flown = lost().fly(100)
    changed_at = next(truth.time for truth in flown.truths if truth.mode == GUIDED_NOGPS)
    assert changed_at - LOST_AT < 2.0
    after = [truth for truth in flown.truths if truth.time > LOST_AT]
    assert max(abs(true_radius(truth) - 30.0) for truth in after) < 2.0
    assert rms_error(last_third(flown), 30.0) < 0.5
    assert clockwise_turns(after) > 0.8
    modes = {truth.mode for truth in after[:-10]}
    assert modes == {GUIDED, GUIDED_NOGPS}
    assert not any(b"by turns" in data for _, data in flown.sent)
    assert flown.outcome.ending is Ending.COMPLETED
    assert flown.vehicle.truth.mode == LAND


def test_gps_loss_keeps_estimates_of_target_and_wind() -> None:
    flown = lost()
    tick = flown.ticks[-1]
    assert "land" in flown.pilot.conditions.alarms["gps_lost"]
    assert tick.law == "drift"
    wind = flown.vehicle.truth.wind_east, flown.vehicle.truth.wind_north
    assert (tick.drift_x, tick.drift_y) == pytest.approx(wind, abs=0.7)


@pytest.mark.parametrize("mode", [GUIDED, LAND, ALT_HOLD])
def test_operator_takes_over_copter_without_gps(mode: int) -> None:
    """A return to GUIDED is a takeover too, because circnav left this mode at the loss of GPS."""
    flown = lost()
    Operator(flown.vehicle).set_mode(mode)
    while flown.pilot.session.vehicle.mode == GUIDED_NOGPS:
        flown.fly(flown.now + 0.02)
        assert flown.now < LOST_AT + 10
    seen_at = flown.now
    flown.fly(seen_at + 3.0)
    assert flown.outcome.ending is Ending.TAKEN_OVER
    assert [time for time in flown.setpoint_times if time > seen_at] == []
    assert flown.vehicle.truth.mode == mode


def test_operator_takes_over_during_switch_to_guided_nogps() -> None:
    """The operator selects a mode just after circnav has requested GUIDED_NOGPS."""
    flown = copy.deepcopy(_circling())
    while flown.pilot.method.failure is None:
        flown.fly(flown.now + 0.02)
    flown.fly(flown.now + 0.1)
    Operator(flown.vehicle).set_mode(ALT_HOLD)
    flown.fly(flown.now + 5.0)
    assert flown.outcome.ending is Ending.TAKEN_OVER
    assert flown.vehicle.truth.mode == ALT_HOLD


def test_returning_gps_does_not_change_guided_nogps() -> None:
    flown = lost()
    flown.vehicle._run_event(Event(action="gps_on"))
    flown.fly(LOST_AT + 20.0)
    assert flown.vehicle.truth.mode == GUIDED_NOGPS
    assert flown.pilot.mission.steering


def test_flight_without_gps_resumes_after_lost_link() -> None:
    """The vehicle that is found again is an ArduCopter without GPS, as before."""
    flown = lost()
    flown.hears = lambda frame, now: not LOST_AT + 6.0 < now < LOST_AT + 11.0
    flown.fly(LOST_AT + 9.5)
    assert flown.pilot.mission.phase is Phase.WAIT_LINK
    flown.fly(LOST_AT + 14.0)
    assert flown.pilot.mission.phase is Phase.ENGAGED
    assert flown.vehicle.truth.mode == GUIDED_NOGPS


def test_short_gps_loss_does_not_change_guided() -> None:
    events = 'sim.events=[{at_s=12.0,action="gps_off"},{at_s=12.6,action="gps_on"}]'
    flown = flight("arducopter", events).fly(20)
    assert flown.pilot.method.failure is None
    assert flown.vehicle.truth.mode == GUIDED


def test_on_gps_loss_exit_leaves_copter_to_failsafe() -> None:
    flown = flight(
        "arducopter", 'engage.on_gps_loss="exit"', 'sim.events=[{at_s=12.0,action="gps_off"}]'
    ).fly(32)
    assert flown.outcome.ending is Ending.TAKEN_OVER
    assert flown.vehicle.truth.mode == LAND


@pytest.mark.parametrize("fault", ["frozen", pytest.param("zero", marks=pytest.mark.nightly)])
def test_second_imu_is_used_when_first_accelerometer_fails(fault: str) -> None:
    failed = f'sim.events=[{{at_s=40.0,action="imu_first_{fault}"}}]'
    texts: set[str] = set()
    flown = flight("arducopter_nogps", failed, law="auto").fly(
        95, watch=lambda step: texts.update(step.pilot.conditions.alarms.values())
    )
    after = [truth for truth in flown.truths if truth.time > 40.0]
    assert max(abs(true_radius(truth) - 30.0) for truth in after) < 2.0
    assert rms_error(last_third(flown), 30.0) < 0.5
    assert any("RAW_IMU" in text and "SCALED_IMU2 is used" in text for text in texts)
    assert flown.pilot.session.motion.accelerations.used == "SCALED_IMU2"


def test_accelerometer_bias_is_learned_before_gps_loss() -> None:
    """With an uncorrected bias of 0.5 m/s^2, the copter left its circle by 37 m, with a false alarm
    of too much wind."""
    events = '{at_s=0.0,action="accel_bias",value=0.5},{at_s=40.0,action="gps_off"}'
    alarms: set[str] = set()
    flown = flight(
        "arducopter", f"sim.events=[{events}]", "sim.wind.speed_mps=2.0", law="auto"
    ).fly(90, watch=lambda step: alarms.update(step.pilot.conditions.alarms))
    after = [truth for truth in flown.truths if truth.time > 40.0]
    assert max(abs(true_radius(truth) - 30.0) for truth in after) < 2.0
    assert alarms == {"gps_lost"}


def test_flight_without_gps_replays_identically() -> None:
    """The recorded frames must be sufficient to reproduce the switch to GUIDED_NOGPS."""
    flown = _lost()
    assert replay(flown_for_long(Pilot(flown.pilot.settings)), flown.steps).identical


def test_single_report_without_position_does_not_change_guided() -> None:
    """EKF_STATUS_REPORT with flags 0 while the GPS has a fix, seen once at a lane switch."""
    events = 'sim.events=[{at_s=12.0,action="ekf_zero",value=1}]'
    flown = flight("arducopter", events).fly(20)
    assert flown.pilot.method.failure is None
    assert flown.vehicle.truth.mode == GUIDED


@pytest.mark.parametrize("lost_message", ["ack", "request"])
def test_operator_lands_copter_during_mode_request(lost_message: str) -> None:
    """The operator commands LAND while the request of GUIDED_NOGPS or its acknowledgment is lost. A
    repeated request must not replace LAND."""
    flown = copy.deepcopy(_circling())
    flown.vehicle._run_event(Event(action=f"lose_mode_{lost_message}", value=1))
    while flown.pilot.method.failure is None:
        flown.fly(flown.now + 0.02)
    flown.fly(flown.now + (0.3 if lost_message == "request" else 0.6))
    Operator(flown.vehicle).set_mode(LAND)
    flown.fly(flown.now + 6.0)
    assert flown.vehicle.truth.mode == LAND
    assert flown.outcome.ending is Ending.TAKEN_OVER


def test_interrupt_just_after_gps_loss_lands_copter() -> None:
    """The copter refuses LOITER, the exit action of the mission."""
    events = 'sim.events=[{at_s=12.0,action="gps_off",value=0.5}]'
    flown = flight("arducopter", events, 'exit.action="loiter"').fly(12.7)
    flown.pilot.interrupt(flown.now, "SIGTERM")
    flown.fly(flown.now + 3.0)
    assert flown.pilot.done
    assert flown.vehicle.truth.mode == LAND


@pytest.mark.parametrize("start", [("80.0", "-40.0", "120.0"), ("30.0", "0.0", "90.0")])
def test_wind_above_airspeed_raises_alarm_within_20_s(start: tuple[str, str, str]) -> None:
    """A wind of 6.5 m/s carries a copter with an airspeed of 5 m/s away from its circle."""
    north, east, heading = start
    seen: list[float] = []

    def watch(step: Flight) -> None:
        if {"not_closing", "wind_too_strong"} & set(step.pilot.conditions.alarms):
            seen.append(step.now)

    flown = flight(
        "arducopter_nogps",
        "sim.wind.speed_mps=6.5",
        f"sim.start.north_m={north}",
        f"sim.start.east_m={east}",
        f"sim.start.heading_deg={heading}",
        law="auto",
    ).fly(45, watch=watch)
    nearest = min(flown.truths, key=true_radius)
    engaged = flown.pilot.mission.engaged_at
    assert engaged is not None
    assert seen[0] < max(nearest.time, engaged) + 20.0


@pytest.mark.parametrize("drift", [0.5, pytest.param(-0.5, marks=pytest.mark.nightly)])
def test_circle_is_kept_while_heading_drifts_without_compass(drift: float) -> None:
    flown = flight(
        "arducopter_nogps",
        "sim.sensors.compass=false",
        f'sim.events=[{{at_s=30.0,action="heading_drift",value={drift}}}]',
        "limits.duration_s=100.0",
        law="auto",
    ).fly(120)
    after = [truth for truth in flown.truths if truth.time > 40.0]
    assert flown.outcome.ending is Ending.COMPLETED
    assert max(abs(true_radius(truth) - 30.0) for truth in after) < 3.0
    assert not any(b"does not follow" in data for _, data in flown.sent)
