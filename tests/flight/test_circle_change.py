"""A new circle in flight on the emulated vehicles: reached within a lap and then kept, or refused if it cannot be
flown. The sense of rotation is measured from the vehicle's true track."""

from math import pi

import pytest

from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.guidance.types import Direction
from tests.flight.lockstep import clockwise_turns, flight, true_radius


def radii(flown, since):
    return [true_radius(truth) for truth in flown.truths if truth.time >= since]


@pytest.mark.parametrize(
    ("profile", "before", "after", "speed"),
    [("arducopter", 60.0, 30.0, 5.0), ("arduplane", 150.0, 110.0, 22.0), ("px4_plane", 60.0, 90.0, 10.0)],
)
def test_a_smaller_or_larger_circle_is_reached_within_a_lap_and_not_overshot_by_5_m(profile, before, after, speed):
    flown = flight(profile, f"orbit.radius_m={before}", "limits.duration_s=400", law="auto")
    flown.fly(begins := 60.0)
    assert flown.pilot.request_circle(CircleRequest(radius=after, by="test"), flown.now) == ""
    lap = 2 * pi * max(before, after) / speed
    then = flown.fly(begins + 1.6 * lap)
    settled = radii(then, begins + lap)
    assert max(abs(radius - after) for radius in settled) < 0.05 * after
    beyond = (after - min(radii(then, begins))) if after < before else (max(radii(then, begins)) - after)
    assert beyond < 5.0
    assert then.pilot.controller.orbit.radius == after


def test_a_circle_that_cannot_be_flown_is_refused_and_the_old_one_held_and_the_direction_is_reversed_in_flight():
    flown = flight("arducopter", "limits.duration_s=400", "bounds.min_range_m=15", law="auto")
    flown.fly(60.0)
    refused = flown.pilot.request_circle(CircleRequest(radius=10.0, by="test"), flown.now)
    assert refused.startswith("radius 10 m outside")
    flown.fly(70.0)
    assert abs(true_radius(flown.truths[-1]) - 30.0) < 1.5
    assert flown.pilot.controller.orbit.direction is Direction.CLOCKWISE
    assert clockwise_turns([truth for truth in flown.truths if truth.time > 50.0]) > 0
    flown.pilot.request_circle(CircleRequest(direction=Direction.COUNTERCLOCKWISE, by="test"), flown.now)
    flown.fly(140.0)
    assert clockwise_turns([truth for truth in flown.truths if truth.time > 110.0]) < -0.4
