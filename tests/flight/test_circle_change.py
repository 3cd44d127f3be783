"""A new circle in flight on the emulated vehicles: reached within a lap and then kept, or refused
if it cannot be flown. The sense of rotation is measured from the vehicle's true track."""

from math import pi

import pytest

from circnav_mav.guidance.circle_change import CircleLimits, CircleRequest, obstacle
from circnav_mav.guidance.types import Direction
from tests.flight.lockstep import clockwise_turns, flight, tangent, true_radius


def radii(flown, since):
    return [true_radius(truth) for truth in flown.truths if truth.time >= since]


def moved(flown, after, speed):
    """Request another radius on the circle, and check the transition to the new circle."""
    begins = flown.now
    before = flown.pilot.controller.orbit.radius
    assert flown.pilot.request_circle(CircleRequest(radius=after, by="test"), begins) == ""
    lap = 2 * pi * max(before, after) / speed
    flown.fly(begins + 1.2 * lap)
    settled = radii(flown, begins + lap)
    assert max(abs(radius - after) for radius in settled) < 0.05 * after
    since = radii(flown, begins)
    beyond = after - min(since) if after < before else max(since) - after
    assert beyond < 5.0
    assert flown.pilot.controller.orbit.radius == after


def near(mission, radius, *overrides):
    """Return a flight that starts near its circle, on a tangent."""
    orbit = f"orbit.radius_m={radius}", "limits.duration_s=400"
    return flight(mission, *orbit, *tangent(radius + 20.0), *overrides, law="auto")


def test_requested_larger_circle_is_reached_without_overshoot():
    moved(near("arduplane", 110).fly(25.0), 150.0, 22.0)


def test_requested_smaller_circle_and_reversed_direction_are_flown():
    flown = near("arducopter", 30, "bounds.min_range_m=15")
    moved(flown.fly(25.0), 20.0, 5.0)
    refused = flown.pilot.request_circle(CircleRequest(radius=10.0, by="test"), flown.now)
    assert refused.startswith("radius 10 m outside")
    flown.fly((begins := flown.now) + 5.0)
    assert abs(true_radius(flown.truths[-1]) - 20.0) < 1.5
    assert flown.pilot.controller.orbit.direction is Direction.CLOCKWISE
    assert clockwise_turns([truth for truth in flown.truths if truth.time > begins]) > 0
    reverse = CircleRequest(direction=Direction.COUNTERCLOCKWISE, by="test")
    flown.pilot.request_circle(reverse, flown.now)
    flown.fly((begins := flown.now) + 35.0)
    end = [truth for truth in flown.truths if truth.time > begins + 20.0]
    assert clockwise_turns(end) < -0.4


def test_small_circle_in_wind_is_refused_with_least_radius():
    flown = near("arduplane", 150, "sim.wind.speed_mps=8").fly(40.0)
    refused = flown.pilot.request_circle(CircleRequest(radius=80.0, by="test"), flown.now)
    least = (22.0 + 8.0) ** 2 / (22.0 * flown.pilot.controller.vehicle.most)
    assert refused.startswith("radius 80 m: min ") and refused.endswith(" m in wind 8 m/s")
    assert abs(float(refused.split()[4]) - least) < 6.0
    assert flown.pilot.controller.orbit.radius == 150.0
    assert flown.pilot.request_circle(CircleRequest(radius=140.0, by="test"), flown.now) == ""


@pytest.mark.parametrize("begins", [30.0, pytest.param(40.0, marks=pytest.mark.nightly)])
def test_direction_reversal_stays_within_announced_distance(begins):
    flown = near("arduplane", 150, "sim.wind.speed_mps=6").fly(begins)
    orbit = flown.pilot.controller.orbit
    request = CircleRequest(direction=Direction.COUNTERCLOCKWISE)
    most = flown.pilot.controller.vehicle.most
    words = obstacle(request, orbit, CircleLimits(22.0, farthest=200.0), 6.0, most)
    flown.pilot.request_circle(request, flown.now)
    flown.fly(begins + 25.0)
    reached = max(radii(flown, begins))
    assert 200.0 < reached < float(words.split()[2]) < 1.5 * reached
