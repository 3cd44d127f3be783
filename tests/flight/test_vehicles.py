"""Every vehicle of the adapter table, flown in lockstep against its emulator profile."""

import copy
import random
from functools import cache

import pytest

from circnav_mav.pilot import Ending
from tests.flight.ground_station import Operator
from tests.flight.lockstep import (
    Flight,
    clockwise_turns,
    flight,
    last_third,
    mean_radius,
    rms_error,
    unrest,
)

# by mission: the custom mode that the operator selects for the takeover
ARDUPILOT = {"arducopter": 5, "arduplane": 7, "ardurover": 4}
PX4 = ("px4_copter", "px4_plane")
VEHICLES = (*ARDUPILOT, *PX4)
AUTO_LOITER = (4, 3)


def take_over(flown: Flight, mission: str) -> None:
    numbers = (ARDUPILOT[mission],) if mission in ARDUPILOT else AUTO_LOITER
    Operator(flown.vehicle).set_mode(*numbers)


@cache
def begun(mission: str) -> Flight:
    """Return a flight 8 s after its start, engaged, without its records. Copy it before use."""
    flown = flight(mission, "limits.hold_s=4.0").fly(8)
    flown.truths = []
    flown.ticks = []
    flown.sent = []
    return flown


def test_copter_keeps_counterclockwise_circle_within_two_percent() -> None:
    """The circle's own turn rate is 10 deg/s. The rover circles in test_weather.py, the other
    vehicles in tests/tools/firmware/test_emulated.py, and clockwise circles are in
    test_ringing.py."""
    flown = flight(
        "arducopter", 'orbit.direction="counterclockwise"', "limits.duration_s=120.0", law="auto"
    ).fly(200)
    assert flown.outcome.ending is Ending.COMPLETED
    assert rms_error(last_third(flown), 30.0) < 0.02 * 30.0
    assert unrest(flown) < 1.5
    assert clockwise_turns(last_third(flown)) < -0.4


def test_plane_with_low_turn_gain_holds_its_radius() -> None:
    """The emulated plane's airspeed of 22.0 m/s is 23.4 m/s true, so the assumed coordinated turn
    rate is 6 % too high. The learned turn gain corrects this."""
    flown = flight(
        "arduplane",
        "sim.vehicle.turn_effectiveness=0.73",
        'orbit.direction="counterclockwise"',
        law="auto",
    ).fly(160)
    assert rms_error(last_third(flown), 150.0) < 1.0
    assert clockwise_turns(last_third(flown)) < -0.8
    assert mean_radius(last_third(flown)) == pytest.approx(150.0, abs=0.2)
    assert flown.pilot.controller.vehicle.gain == pytest.approx(0.73 * 22.0 / 23.4, abs=0.03)


@pytest.mark.parametrize("mission", VEHICLES)
def test_no_setpoint_follows_an_operator_takeover(mission: str) -> None:
    """F16 of the fault matrix repeats the takeover at 1,000 random ticks."""
    chance = random.Random(3)
    for _ in range(5):
        flown = copy.deepcopy(begun(mission))
        flown.fly(flown.now + chance.uniform(0, 0.6))
        take_over(flown, mission)
        guided = flown.pilot.session.adapter.guided_mode
        while flown.pilot.session.vehicle.mode == guided:
            flown.fly(flown.now + 0.02)
            assert flown.now < 12
        seen_at = flown.now
        flown.fly(seen_at + 0.3)
        assert [time for time in flown.setpoint_times if time >= seen_at - 1e-9] == []
        assert flown.outcome.ending is Ending.TAKEN_OVER


@pytest.mark.parametrize("mission", VEHICLES)
def test_autopilot_timeout_acts_when_application_is_killed(mission: str) -> None:
    flown = copy.deepcopy(begun(mission))
    vehicle = flown.vehicle
    guided = flown.pilot.session.adapter.guided_mode
    banks = []
    for tenth in range(200):
        vehicle.advance(flown.now + tenth / 10)
        banks.append(abs(vehicle.truth.roll))
    truth = vehicle.truth
    if mission in ("arducopter", "ardurover"):
        assert (truth.mode, truth.ground_speed) == (guided, pytest.approx(0.0, abs=0.3))
    elif mission == "arduplane":
        assert truth.mode == guided
        assert max(banks[40:]) > 0.6
    else:
        assert truth.mode != guided


@pytest.mark.parametrize("mission", VEHICLES)
def test_exit_action_commands_mode_of_mission(mission: str) -> None:
    flown = flight(mission, "limits.duration_s=8.0", 'exit.action="rtl"').fly(60)
    adapter = flown.pilot.session.adapter
    assert flown.pilot.done
    assert flown.pilot.session.vehicle.mode == adapter.exits["rtl"] == flown.vehicle.truth.mode
    assert flown.outcome.reason == "flown to its end"


@pytest.mark.parametrize("taken_over", [False, True])
@pytest.mark.parametrize(("excepted", "in_the_end"), [(0, "rtl"), (2, "loiter")])
def test_px4_plane_after_exit_follows_stick_loss_exception(
    excepted: int, in_the_end: str, taken_over: bool
) -> None:
    """PX4 treats circnav's MANUAL_CONTROL as the sticks. When it ends, PX4 reacts to the loss of
    manual control, even after a takeover. COM_RCL_EXCEPT excepts modes from this reaction."""
    flown = flight("px4_plane", "limits.duration_s=8.0")
    operator = Operator(flown.vehicle)
    operator.set_px4_integer("COM_RCL_EXCEPT", excepted)
    if taken_over:
        flown.fly(8)
        operator.set_mode(*AUTO_LOITER)
    flown.fly(60)
    assert flown.pilot.done
    modes = flown.pilot.session.adapter.exits
    assert flown.vehicle.truth.mode == modes["loiter"]
    flown.vehicle.advance(flown.now + 4.0)
    assert flown.vehicle.truth.mode == modes["loiter"]
    flown.vehicle.advance(flown.now + 40.0)
    assert flown.vehicle.truth.mode == modes[in_the_end]


@pytest.mark.parametrize("mission", VEHICLES)
def test_lost_ranging_ends_flight_with_exit_mode(mission: str) -> None:
    flown = copy.deepcopy(begun(mission))
    flown.hears = lambda frame, now: frame[7:10] != b"\x84\x00\x00"
    flown.fly(40)
    assert "no range" in flown.outcome.reason
    assert (
        flown.vehicle.truth.mode
        == flown.pilot.session.adapter.exits[flown.pilot.settings.exit or "loiter"]
    )


def test_autopilot_auto_recognizes_arduplane() -> None:
    flown = flight("arduplane", 'vehicle.autopilot="auto"', "limits.duration_s=5.0").fly(20)
    assert flown.pilot.session.adapter.name == "ardupilot plane"
    assert flown.setpoint_times != []


def test_plane_without_vfr_hud_gets_no_setpoint() -> None:
    flown = flight("arduplane", "link.wait_s=5.0")
    flown.hears = lambda frame, now: frame[7] != 74  # VFR_HUD is lost
    flown.fly(30)
    assert flown.setpoint_times == []
    assert flown.outcome.ending is Ending.NOTHING_RECEIVED
    assert "no airspeed in VFR_HUD" in flown.outcome.reason


def test_plane_continues_circle_when_gps_is_lost() -> None:
    lost = 'sim.events=[{at_s=40.0, action="gps_off"}]'
    flown = flight("arduplane", lost, "limits.duration_s=100.0", law="auto").fly(400)
    assert flown.outcome.ending is Ending.COMPLETED
    assert rms_error(last_third(flown), 150.0) < 1.5


def test_px4_copter_holds_its_height() -> None:
    flown = flight("px4_copter", "limits.duration_s=40.0").fly(80)
    heights = [-truth.down for truth in flown.truths if truth.time > 10]
    assert max(heights) - min(heights) < 1.0


def test_px4_copter_keeps_drift_law_when_turn_changes_sign() -> None:
    """The copter follows a turn command within 0.5 s. When 1.3 s was assumed, it was once
    classified as not following: its path was ignored, and the search for the target restarted on
    the circle."""
    flown = flight("px4_copter", "sim.wind.speed_mps=3.0", "sim.seed=4", law="auto").fly(90)
    laws = [tick.law for tick in flown.ticks if tick.time > 40]
    assert laws.count("drift") > 0.95 * len(laws)
