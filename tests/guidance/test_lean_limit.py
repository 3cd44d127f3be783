"""The maximum lean of a copter, which is estimated from its lean, heading and commanded speed
alone."""

from cmath import phase, rect
from math import atan, degrees, pi, radians, tan

import numpy as np
import pytest

from circnav_mav.guidance.copter_air import CopterAir
from circnav_mav.guidance.types import GRAVITY, OwnMotion

V = 5.0
DRAG = 0.35
TURN = 5.0 / 30


def after(laps, wind, limit_deg=90.0, *, gust=0.0, trim=0.0, lag=0.0):
    """Return the learned lean limit after laps at speed V. wind: m/s. gust: RMS acceleration by
    gusts, m/s^2. trim: constant acceleration along the nose, m/s^2. lag: time constant of the lean,
    s."""
    rng = np.random.default_rng(2)
    limit = GRAVITY * tan(radians(limit_deg))
    air = CopterAir(0.25, V)
    lean = air.lean
    gusts = 0j
    flown = 0j
    for i in range(round(laps * 2 * pi / TURN / 0.05)):
        heading = TURN * 0.05 * i
        nose = rect(1.0, heading)
        gusts += (-gusts * 0.05 + gust * complex(*rng.standard_normal(2)) * 0.3) / 2
        thrust_acceleration = (
            DRAG * (V * lean.share * nose - wind)
            + 1j * V * lean.share * TURN * nose
            + gusts
            + trim * nose
        )
        thrust_acceleration = rect(min(abs(thrust_acceleration), limit), phase(thrust_acceleration))
        flown = (
            thrust_acceleration if lag == 0 else flown + (thrust_acceleration - flown) * 0.05 / lag
        )
        own = OwnMotion(0.05 * i, heading, TURN, V * lean.share)
        air.over_ground(own, flown * nose.conjugate(), None, steering=True, settled=True)
    return lean


@pytest.mark.parametrize("wind", [6.5, 7.5])
def test_found_lean_limit_lowers_commanded_speed(wind):
    """A lean of 20 deg gives 3.57 m/s^2. With a drag of 0.35/s this allows 10.2 m/s of airspeed,
    and less while a part of the lean turns the path."""
    lean = after(5, wind, limit_deg=20.0)
    assert degrees(atan(lean.found / GRAVITY)) == pytest.approx(20.0, abs=0.5)
    asked = abs(DRAG * (V * lean.share + wind) + 1j * V * lean.share * TURN)
    assert lean.share < 1.0
    assert asked < 1.1 * GRAVITY * tan(radians(20.0))


@pytest.mark.parametrize(
    "flight",
    [
        {"wind": 0.0},
        {"wind": 6.0},
        {"wind": 6.0, "trim": 0.4},
        {"wind": 3.0, "gust": 1.0},
        {"wind": 6.0, "gust": 2.0},
        {"wind": 6.0, "lag": 0.9},
    ],
    ids=str,
)
def test_lean_limit_ignores_wind_trim_and_gusts(flight):
    assert after(6, **flight).share == 1.0
