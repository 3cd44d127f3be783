"""Copters without GPS on the emulator: flown from the start by attitude or by stick, and after a
loss of GPS."""

import copy
from functools import cache

import pytest

from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import Ending, Pilot
from circnav_mav.runlog.replay import replay
from tests.flight.ground_station import Operator
from tests.flight.lockstep import (
    CONFIG,
    Flight,
    clockwise_turns,
    flight,
    last_third,
    rms_error,
    true_radius,
    unrest,
)

GUIDED = 4
LOITER = 5
LAND = 9
ALT_HOLD = 2
GUIDED_NOGPS = 20
LOST_AT = 60.0
GPS_LOST = f'sim.events=[{{at_s={LOST_AT},action="gps_off"}}]'
WIND = "sim.wind.speed_mps=2.0"


@pytest.mark.parametrize("direction", ["clockwise", "counterclockwise"])
def test_copter_without_gps_keeps_circle_in_wind(direction: str) -> None:
    flown = flight(
        "arducopter_nogps", f'orbit.direction="{direction}"', "limits.duration_s=120.0", law="auto"
    ).fly(160)
    assert flown.outcome.ending is Ending.COMPLETED
    assert rms_error(last_third(flown), 30.0) < 0.7
    assert clockwise_turns(last_third(flown)) * (1 if direction == "clockwise" else -1) > 0.4
    assert unrest(flown) < 7.0
    assert flown.vehicle.truth.mode == ALT_HOLD


def test_copter_without_gps_learns_its_drag() -> None:
    """The mission assumes 1.5 times the drag of the emulated copter, so the copter first flies
    faster than V."""
    flown = flight(
        "arducopter_nogps", "vehicle.drag_per_s=0.58", "limits.duration_s=150.0", law="auto"
    ).fly(180)
    assert rms_error(last_third(flown), 30.0) < 0.7
    speeds = [truth.airspeed for truth in last_third(flown)]
    assert sum(speeds) / len(speeds) == pytest.approx(5.0, rel=0.1)


def test_px4_copter_without_gps_keeps_circle_by_stick() -> None:
    flown = flight("px4_copter_nogps", "limits.duration_s=150.0", law="auto").fly(190)
    assert flown.outcome.ending is Ending.COMPLETED
    assert rms_error(last_third(flown), 50.0) < 2.5
    assert clockwise_turns(last_third(flown)) > 0.4


@cache
def _lost() -> Flight:
    """Return a flight 5 s after the loss of GPS. Copy it before use."""
    return flight("arducopter", GPS_LOST, WIND, "limits.duration_s=150.0", law="auto").fly(
        LOST_AT + 5.0
    )


def lost() -> Flight:
    return copy.deepcopy(_lost())


def test_gps_loss_changes_mode_and_keeps_circle() -> None:
    flown = lost().fly(200)
    changed_at = flown.pilot.gps_loss.changed_at
    assert changed_at is not None
    assert changed_at - LOST_AT < 2.0
    after = [truth for truth in flown.truths if truth.time > LOST_AT]
    assert max(abs(true_radius(truth) - 30.0) for truth in after if truth.time < 150) < 2.0
    assert rms_error(last_third(flown), 30.0) < 0.5
    assert clockwise_turns(after) > 1.5
    modes = {truth.mode for truth in after if truth.time < 150}
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
    flown = flight("arducopter", GPS_LOST, WIND, law="auto").fly(LOST_AT)
    while flown.pilot.gps_loss.changed_at is None:
        flown.fly(flown.now + 0.02)
    flown.fly(flown.now + 0.1)
    Operator(flown.vehicle).set_mode(ALT_HOLD)
    flown.fly(flown.now + 5.0)
    assert flown.outcome.ending is Ending.TAKEN_OVER
    assert flown.vehicle.truth.mode == ALT_HOLD


def test_returning_gps_does_not_change_guided_nogps() -> None:
    events = (
        f'sim.events=[{{at_s={LOST_AT},action="gps_off"}},{{at_s={LOST_AT + 10},action="gps_on"}}]'
    )
    flown = flight("arducopter", events, WIND, "limits.duration_s=110.0", law="auto").fly(
        LOST_AT + 30
    )
    assert flown.vehicle.truth.mode == GUIDED_NOGPS
    assert flown.pilot.mission.steering


def test_short_gps_loss_does_not_change_guided() -> None:
    events = 'sim.events=[{at_s=20.0,action="gps_off"},{at_s=20.6,action="gps_on"}]'
    flown = flight("arducopter", events, law="auto").fly(30)
    assert flown.pilot.gps_loss.changed_at is None
    assert flown.vehicle.truth.mode == GUIDED


def test_on_gps_loss_exit_leaves_copter_to_failsafe() -> None:
    flown = flight(
        "arducopter", 'engage.on_gps_loss="exit"', 'sim.events=[{at_s=20.0,action="gps_off"}]'
    ).fly(40)
    assert flown.outcome.ending is Ending.TAKEN_OVER
    assert flown.vehicle.truth.mode == LAND


def test_flight_without_gps_replays_identically() -> None:
    """The recorded frames must be sufficient to reproduce the switch to GUIDED_NOGPS."""
    overrides = (GPS_LOST, WIND, "limits.duration_s=75.0", 'guidance.law="auto"')
    flown = Recorded.start(overrides)
    flown.fly(90)
    mission = load_mission(CONFIG / "arducopter.toml", ("sim.truth.rate_hz=0", *overrides))
    again = replay(Pilot(mission.pilot_settings()), flown.steps)
    assert again.identical


class Recorded(Flight):
    """A flight that records its steps."""

    @classmethod
    def start(cls, overrides: tuple[str, ...]) -> "Recorded":
        one = flight("arducopter", *overrides, law="auto")
        recorded = cls(one.pilot, one.vehicle)
        recorded.steps = []
        return recorded

    def _keep(self, step: object) -> None:
        self.steps.append(step)
        super()._keep(step)
