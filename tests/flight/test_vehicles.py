"""Every vehicle of the adapter table, flown in lockstep against its emulator profile."""

import copy
import random
from functools import cache
from itertools import pairwise
from math import cos, degrees, hypot, pi, radians, sin
from statistics import pstdev
from typing import Any

import pytest
from circnav_sim.vehicle import Truth

from circnav_mav.pilot import Ending
from tests.flight.ground_station import Operator
from tests.flight.lockstep import (
    Flight,
    clockwise_turns,
    flight,
    last_third,
    mean_radius,
    rms_error,
)

# by mission: the custom mode that the operator selects for the takeover
ARDUPILOT = {"arducopter": 5, "arduplane": 7, "ardurover": 4}
PX4 = ("px4_copter", "px4_plane")
VEHICLES = (*ARDUPILOT, *PX4)
AUTO_LOITER = (4, 3)
GPS_LOST = 'sim.events=[{at_s=25.0, action="gps_off"}]'
LEANS_LITTLE = ("sim.vehicle.max_lean_deg=20.0", "sim.vehicle.drag_per_s=0.175")


def take_over(flown: Flight, mission: str) -> None:
    numbers = (ARDUPILOT[mission],) if mission in ARDUPILOT else AUTO_LOITER
    Operator(flown.vehicle).set_mode(*numbers)


@cache
def begun(mission: str) -> Flight:
    """Return a flight 8 s after its start, engaged, without its records. Copy it before use."""
    flown = flight(mission, "limits.coast_s=4.0", 'exit.action="rtl"').fly(8)
    flown.truths = []
    flown.ticks = []
    flown.sent = []
    return flown


CIRCLES = [
    # mission, share of the radius in which the RMS radius error stays, largest standard deviation
    # of the commanded turn rate in deg/s, and overrides
    ("arducopter", 0.02, 5.0, ("sim.wind.speed_mps=4.0", *LEANS_LITTLE)),
    ("arducopter_nogps", 0.7 / 30, 7.0, ("vehicle.drag_per_s=0.58",)),
    ("arduplane", 0.01, 0.8, (GPS_LOST,)),
    ("ardurover", 0.02, 2.5, ()),
    ("px4_copter", 0.02, 9.0, ("sim.wind.speed_mps=2.0", "sim.wind.gust_rms_mps=1.0")),
    ("px4_copter_nogps", 0.05, 9.0, ()),
    ("px4_plane", 0.02, 1.5, ()),
]
"""Every vehicle settles within 45 s. The copter's maximum lean is just sufficient. The mission of
the copter without GPS assumes 1.5 times the drag of the emulated copter, so it first flies faster
than V. The plane loses its GPS at 25 s."""


def distances(track: list[Truth], sim: dict[str, Any]) -> tuple[float, float]:
    """Return the lengths of a track over ground and through the air in steady wind, m."""
    wind = sim.get("wind", {})
    towards = radians(wind.get("from_deg", 0.0) + 180.0)
    north = wind.get("speed_mps", 0.0) * cos(towards)
    east = wind.get("speed_mps", 0.0) * sin(towards)
    over_ground = 0.0
    through_air = 0.0
    for a, b in pairwise(track):
        dt = b.time - a.time
        over_ground += hypot(b.north - a.north, b.east - a.east)
        through_air += hypot(b.north - a.north - north * dt, b.east - a.east - east * dt)
    return over_ground, through_air


@pytest.mark.parametrize(
    ("mission", "most", "quiet", "overrides"), CIRCLES, ids=[one[0] for one in CIRCLES]
)
def test_vehicle_settles_on_counterclockwise_circle(
    mission: str, most: float, quiet: float, overrides: tuple[str, ...]
) -> None:
    """Clockwise circles are in test_ringing.py and test_without_gps.py."""
    reverse = 'orbit.direction="counterclockwise"'
    flown = flight(mission, reverse, *overrides, "limits.duration_s=58.0", law="auto").fly(90)
    assert flown.outcome.ending is Ending.COMPLETED
    assert flown.outcome.reason == "flown to its end"
    exits = flown.pilot.session.adapter.exits
    assert flown.vehicle.truth.mode == exits[flown.pilot.settings.file.exit.action or "loiter"]
    orbit = flown.pilot.settings.orbit
    circle = [truth for truth in flown.truths if truth.time > 45.0]
    over_ground, through_air = distances(circle, flown.pilot.settings.file.sim)
    assert rms_error(circle, orbit.radius) < most * orbit.radius
    laps = over_ground / (2 * pi * orbit.radius)
    assert clockwise_turns(circle) == pytest.approx(-laps, rel=0.03)
    # Wind changes the speed over ground of a vehicle that does not hold it.
    adapter = flown.pilot.session.adapter
    way = over_ground if adapter.holds_ground_speed else through_air
    assert way / (circle[-1].time - circle[0].time) == pytest.approx(orbit.speed, rel=0.15)
    ticks = [tick for tick in flown.ticks if tick.time > 45.0 and tick.turn_rate is not None]
    assert degrees(pstdev(tick.turn_rate for tick in ticks)) < quiet
    assert {tick.law for tick in ticks if tick.time < 55.0} == {"drift"}
    heights = [truth.down for truth in flown.truths if truth.time > 10.0]
    assert max(heights) - min(heights) < 1.0
    assert not any(b"lean limit" in data for _, data in flown.sent)
    assert flown.pilot.conditions.alarms == {}
    if mission == "arducopter_nogps":
        speeds = [truth.airspeed for truth in circle]
        assert sum(speeds) / len(speeds) == pytest.approx(5.0, rel=0.1)


@pytest.mark.nightly
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
def test_no_setpoint_is_sent_after_operator_takeover(mission: str) -> None:
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
def test_setpoint_timeout_of_autopilot_expires_when_circnav_is_killed(mission: str) -> None:
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


@pytest.mark.parametrize(
    ("excepted", "in_the_end", "taken_over"),
    [(0, "rtl", False), (0, "rtl", True), (2, "loiter", True)],
)
def test_px4_plane_obeys_stick_loss_exception_after_exit(
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
    flown.vehicle.advance(flown.now + 12.0)
    assert flown.vehicle.truth.mode == modes[in_the_end]


@pytest.mark.parametrize("mission", VEHICLES)
def test_lost_ranging_ends_flight_with_exit_mode_of_mission(mission: str) -> None:
    flown = copy.deepcopy(begun(mission))
    flown.hears = lambda frame, now: frame[7:10] != b"\x84\x00\x00"
    flown.fly(40)
    assert "no range" in flown.outcome.reason
    assert flown.pilot.done
    adapter = flown.pilot.session.adapter
    assert flown.pilot.session.vehicle.mode == adapter.exits["rtl"] == flown.vehicle.truth.mode


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
