"""A new circle in flight on the emulated vehicles: reached within a lap and then kept, or refused
if it cannot be flown. The sense of rotation is measured from the vehicle's true track."""

from math import pi

import pytest

from circnav_mav.guidance.circle_change import CircleLimits, CircleRequest, obstacle
from circnav_mav.guidance.types import Direction
from tests.flight.lockstep import clockwise_turns, flight, true_radius


def radii(flown, since):
    return [true_radius(truth) for truth in flown.truths if truth.time >= since]


def moved(flown, after, speed):
    """Request another radius on the circle, and check the transition to the new circle."""
    begins = flown.now
    before = flown.pilot.controller.orbit.radius
    assert flown.pilot.request_circle(CircleRequest(radius=after, by="test"), begins) == ""
    lap = 2 * pi * max(before, after) / speed
    flown.fly(begins + 1.6 * lap)
    settled = radii(flown, begins + lap)
    assert max(abs(radius - after) for radius in settled) < 0.05 * after
    beyond = (
        (after - min(radii(flown, begins)))
        if after < before
        else (max(radii(flown, begins)) - after)
    )
    assert beyond < 5.0
    assert flown.pilot.controller.orbit.radius == after


def test_requested_larger_circle_is_reached_without_overshoot():
    moved(
        flight("arduplane", "orbit.radius_m=110", "limits.duration_s=400", law="auto").fly(40.0),
        150.0,
        22.0,
    )


def test_requested_smaller_circle_and_reversed_direction_are_flown():
    flown = flight(
        "arducopter",
        "orbit.radius_m=40",
        "limits.duration_s=400",
        "bounds.min_range_m=15",
        law="auto",
    )
    moved(flown.fly(40.0), 25.0, 5.0)
    refused = flown.pilot.request_circle(CircleRequest(radius=10.0, by="test"), flown.now)
    assert refused.startswith("radius 10 m outside")
    flown.fly((begins := flown.now) + 10.0)
    assert abs(true_radius(flown.truths[-1]) - 25.0) < 1.5
    assert flown.pilot.controller.orbit.direction is Direction.CLOCKWISE
    assert clockwise_turns([truth for truth in flown.truths if truth.time > begins]) > 0
    flown.pilot.request_circle(
        CircleRequest(direction=Direction.COUNTERCLOCKWISE, by="test"), flown.now
    )
    flown.fly(flown.now + 60.0)
    assert (
        clockwise_turns([truth for truth in flown.truths if truth.time > flown.now - 30.0]) < -0.4
    )


def test_small_circle_in_wind_is_refused_with_least_radius():
    flown = flight(
        "arduplane",
        "orbit.radius_m=150",
        "limits.duration_s=400",
        "sim.wind.speed_mps=8",
        law="auto",
    ).fly(75.0)
    refused = flown.pilot.request_circle(CircleRequest(radius=80.0, by="test"), flown.now)
    least = (22.0 + 8.0) ** 2 / (22.0 * flown.pilot.controller.vehicle.most)
    assert refused.startswith("radius 80 m: min ") and refused.endswith(" m in wind 8 m/s")
    assert abs(float(refused.split()[4]) - least) < 6.0
    assert flown.pilot.controller.orbit.radius == 150.0
    assert flown.pilot.request_circle(CircleRequest(radius=140.0, by="test"), flown.now) == ""


@pytest.mark.parametrize("begins", [60.0, pytest.param(76.0, marks=pytest.mark.nightly)])
def test_direction_reversal_stays_within_announced_distance(begins):
    flown = flight(
        "arduplane",
        "orbit.radius_m=150",
        "limits.duration_s=400",
        "sim.wind.speed_mps=6",
        law="auto",
    ).fly(begins)
    orbit = flown.pilot.controller.orbit
    request = CircleRequest(direction=Direction.COUNTERCLOCKWISE)
    most = flown.pilot.controller.vehicle.most
    words = obstacle(request, orbit, CircleLimits(22.0, farthest=200.0), 6.0, most)
    flown.pilot.request_circle(request, flown.now)
    flown.fly(begins + 40.0)
    reached = max(radii(flown, begins))
    assert 200.0 < reached < float(words.split()[2]) < 1.5 * reached
