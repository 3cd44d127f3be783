"""A new circle in flight on the emulated vehicles: reached within a lap and then kept, or refused
if it cannot be flown. The sense of rotation is measured from the vehicle's true track."""

from math import pi

from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.guidance.types import Direction
from tests.flight.lockstep import clockwise_turns, flight, true_radius


def radii(flown, since):
    return [true_radius(truth) for truth in flown.truths if truth.time >= since]


def moved(flown, after, speed):
    """Request another radius on the circle, and check the way to it."""
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


def test_larger_circle_is_reached_without_overshoot():
    moved(
        flight("arduplane", "orbit.radius_m=110", "limits.duration_s=400", law="auto").fly(40.0),
        150.0,
        22.0,
    )


def test_smaller_circle_and_reversed_direction_are_flown():
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
