"""Requests for another circle: reasons for refusal, and values that a request omits."""

from math import nan

import pytest

from circnav_mav.guidance.circle_change import CircleLimits, CircleRequest, obstacle
from circnav_mav.guidance.types import Direction, Orbit

ORBIT = Orbit(100.0, Direction.CLOCKWISE, 15.0, 0.35)
LIMITS = CircleLimits(speed=15.0, nearest=40.0, farthest=500.0)


@pytest.mark.parametrize(
    ("request_", "limits", "why"),
    [
        (CircleRequest(radius=60.0), LIMITS, ""),
        (CircleRequest(direction=Direction.COUNTERCLOCKWISE), LIMITS, ""),
        (CircleRequest(speed=16.5), LIMITS, ""),
        (CircleRequest(offset=-29.0), LIMITS, ""),
        (CircleRequest(offset=31.0), LIMITS, "spacing offset +31.0 m, limit 30.0 m"),
        (CircleRequest(radius=40.0), LIMITS, "radius 40 m outside 40 to 500 m"),
        (CircleRequest(radius=501.0), LIMITS, "radius 501 m outside 40 to 500 m"),
        (CircleRequest(radius=nan), LIMITS, "radius nan m outside 40 to 500 m"),
        (CircleRequest(radius=-60.0), CircleLimits(speed=15.0), "radius -60 m outside 0 to inf m"),
        (CircleRequest(speed=18.5), LIMITS, "speed 18.5 m/s outside 12 to 18 m/s"),
        (CircleRequest(speed=nan), LIMITS, "speed nan m/s outside 12 to 18 m/s"),
        (CircleRequest(speed=-15.0), LIMITS, "speed -15 m/s outside 12 to 18 m/s"),
        (
            CircleRequest(speed=16.0),
            CircleLimits(15.0, keeps_speed=True),
            "this autopilot holds its own airspeed",
        ),
        (
            CircleRequest(direction=Direction.COUNTERCLOCKWISE),
            CircleLimits(15.0, farthest=200.0),
            "reversal reaches 201 m, max 200 m",
        ),
        (CircleRequest(radius=42.0), LIMITS, "radius 42 m: min 43 m by turn rate"),
        (
            CircleRequest(radius=55.0),
            CircleLimits(15.0, 40.0, turn_gain=0.7),
            "radius 55 m: min 61 m by turn rate",
        ),
    ],
)
def test_rejected_circle_request_names_exceeded_limit(request_, limits, why):
    assert obstacle(request_, ORBIT, limits) == why
    assert len(why) <= 50 - len("circnav: ")  # a STATUSTEXT has 50 characters


def test_circle_request_keeps_omitted_values():
    assert CircleRequest().applied(ORBIT) == ORBIT
    turned = CircleRequest(radius=60.0, direction=Direction.COUNTERCLOCKWISE).applied(ORBIT)
    assert turned == Orbit(60.0, Direction.COUNTERCLOCKWISE, 15.0, 0.35)
