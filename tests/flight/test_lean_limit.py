"""A copter whose maximum lean is too small for the speed V against the wind: detected, reported by
an alarm, and flown at a lower speed."""

import pytest

from circnav_mav.runtime.onlookers import Onlookers
from circnav_mav.runtime.status import StatusSource
from tests.flight.lockstep import flight, last_third, rms_error, unrest

LEANS_LITTLE = ("sim.vehicle.max_lean_deg=20.0", "sim.vehicle.drag_per_s=0.175")
"""Copter with a maximum lean of 20 deg. Its drag then allows 9.5 m/s of airspeed along a body axis,
and less while a part of the lean turns the path."""


def test_copter_lowers_speed_when_lean_limit_is_found() -> None:
    """Without the lower speed, the ground speed dropped once per lap, and the turn command was
    irregular."""
    flown = flight("arducopter", "sim.wind.speed_mps=6.0", *LEANS_LITTLE, law="auto").fly(140)
    assert any(b"lean limit 20 deg, speed cut to 4." in data for _, data in flown.sent)
    alarms = StatusSource(flown.pilot, Onlookers()).status(flown.ticks[-1], flown.now).alarms
    assert any(alarm.startswith("LEAN LIMIT: the copter leans 20 deg at most") for alarm in alarms)
    end = last_third(flown)
    speeds = [truth.ground_speed for truth in end]
    assert 4.4 < flown.pilot.controller.speed < 4.9
    assert max(speeds) - min(speeds) < 2.0
    assert rms_error(end, 30.0) < 0.6
    assert unrest(flown) < 5.0


def test_small_circle_in_wind_causes_no_lean_limit() -> None:
    small = ("orbit.radius_m=10", "vehicle.speed_mps=3", "sim.wind.speed_mps=3.0")
    flown = flight("arducopter", *small, law="auto").fly(90)
    assert not any(b"lean limit" in data for _, data in flown.sent)


@pytest.mark.nightly
def test_px4_lean_limit_is_found() -> None:
    """A drag of 1/s and MPC_TILTMAX_AIR = 45 deg limit the airspeed to 9.8 m/s. The wind is 6
    m/s."""
    flown = flight("px4_copter", "sim.wind.speed_mps=6.0", law="auto").fly(110)
    assert any(b"lean limit 45 deg" in data for _, data in flown.sent)
    assert rms_error(last_third(flown), 50.0) < 1.2


@pytest.mark.parametrize(
    ("mission", "wind"), [("arducopter", ("sim.wind.speed_mps=4.0", *LEANS_LITTLE)),
                          ("px4_copter", ("sim.wind.speed_mps=2.0", "sim.wind.gust_rms_mps=1.0"))],
)  # fmt: skip
def test_copter_keeps_speed_when_lean_is_sufficient(mission, wind) -> None:
    flown = flight(mission, *wind, law="auto").fly(60)
    assert flown.pilot.controller.speed == 5.0
    assert not any(b"lean limit" in data for _, data in flown.sent)
