"""A copter whose maximum lean is too small for the speed V against the wind: detected, reported by
an alarm, and flown at a lower speed."""

import pytest

from circnav_mav.runtime.listeners import Listeners
from circnav_mav.runtime.status import StatusSource
from tests.flight.lockstep import clockwise_turns, flight, last_third, rms_error, unrest

LEANS_LITTLE = ("sim.vehicle.max_lean_deg=20.0", "sim.vehicle.drag_per_s=0.175")
"""Copter with a maximum lean of 20 deg. Its drag then allows 9.5 m/s of airspeed along a body axis,
and less while a part of the lean turns the path."""


@pytest.mark.parametrize(
    ("mission", "overrides", "lean", "until", "speed", "most"),
    [
        ("px4_copter", (), 45, 75.0, (4.0, 4.2), 1.2),
        pytest.param(
            "arducopter", LEANS_LITTLE, 20, 140.0, (4.4, 4.9), 0.6, marks=pytest.mark.nightly
        ),
    ],
)
def test_copter_lowers_speed_when_lean_limit_is_found(mission, overrides, lean, until, speed, most):
    """Without the lower speed, the ground speed dropped once per lap, and the turn command was
    irregular. On PX4 a drag of 1/s and MPC_TILTMAX_AIR = 45 deg limit the airspeed to 9.8 m/s."""
    flown = flight(mission, "sim.wind.speed_mps=6.0", *overrides, law="auto").fly(until)
    reduced = f"lean limit {lean} deg, speed cut to {int(speed[0])}.".encode()
    assert any(reduced in data for _, data in flown.sent)
    alarms = StatusSource(flown.pilot, Listeners()).status(flown.ticks[-1], flown.now).alarms
    text = f"LEAN LIMIT: the copter leans {lean} deg at most"
    assert any(alarm.startswith(text) for alarm in alarms)
    end = last_third(flown)
    speeds = [truth.ground_speed for truth in end]
    assert speed[0] < flown.pilot.view.speed < speed[1]
    assert max(speeds) - min(speeds) < 2.0
    assert rms_error(end, flown.pilot.settings.orbit.radius) < most
    assert unrest(flown) < 5.0


def test_small_circle_in_wind_raises_no_lean_limit_alarm() -> None:
    """A lean limit is tested in test_vehicles.py with a lean that is just sufficient."""
    small = ("orbit.radius_m=10", "vehicle.speed_mps=3", "sim.wind.speed_mps=3.0")
    flown = flight("arducopter", *small, law="auto").fly(50)
    assert clockwise_turns(last_third(flown)) > 0.5
    assert not any(b"lean limit" in data for _, data in flown.sent)
