"""The lap of a vehicle that cannot turn as fast as its circle demands, against the geometry of the
planned curve."""

from copy import deepcopy
from itertools import pairwise, product
from math import hypot, inf, pi

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from circnav_mav.guidance.lap_plan import ANGLES, plan
from circnav_mav.guidance.limits import BankLimit
from circnav_mav.guidance.maths import chord, clip, wrap
from circnav_mav.guidance.turn_response import PendingTurn, Response
from circnav_mav.guidance.types import OwnMotion
from circnav_mav.guidance.vector_field import drift, drift_gains, mirrored
from tests.tools.firmware.bound import squeezed

V = 23.4
R_D = 150.0
WIND = 5.0
"""True airspeed V (m/s), radius (m) and wind (m/s) of a flown ArduPlane. In this wind the circle
demands up to 0.230 rad/s."""
LIMIT = 0.215


def geometry(lap, wind):
    """Return the turn rates of the nose along a planned curve (rad/s), and the curve's RMS radius
    error over time (m). Uses positions alone, without the plan's own equation."""
    knots = np.linspace(-pi, pi, ANGLES, endpoint=False) + lap.downwind
    radii = [lap.at(float(angle))[0] for angle in knots]
    curve = CubicSpline([*knots, knots[0] + 2 * pi], [*radii, radii[0]], bc_type="periodic")
    angle = np.linspace(knots[0], knots[0] + 2 * pi, 4000)
    place = curve(angle) * np.exp(1j * angle)
    course = np.unwrap(np.angle(np.gradient(place)))
    blows = wind * np.exp(-1j * course)
    time = np.abs(np.gradient(place)) / (np.sqrt(V**2 - blows.imag**2) + blows.real)
    turn = np.gradient(course - np.arcsin(blows.imag / V)) / time
    # Average over one knot interval: the spline overshoots where the turn rate reaches its limit.
    of_a_knot = round(4000 / ANGLES)
    smooth = np.convolve(turn, np.ones(of_a_knot) / of_a_knot, "valid")
    return smooth, float(np.sqrt(np.average((abs(place) - R_D) ** 2, weights=time)))


@pytest.mark.parametrize("blows", [0.0, 2.3])
def test_planned_lap_keeps_limit_with_nearly_least_rms(blows):
    """tests/tools/firmware/bound.py computes the least RMS independently: the planned RMS lies
    between the least RMS for this limit and for 0.98 of it."""
    wind = WIND * np.exp(1j * blows)
    lap = plan((wind.real, wind.imag), V=V, r_d=R_D, limit=LIMIT)
    assert lap is not None
    turn, rms = geometry(lap, wind)
    assert turn.max() < 1.01 * LIMIT
    assert squeezed(LIMIT) < rms < squeezed(0.98 * LIMIT)


def test_lap_plan_is_finite_for_every_drift_and_limit():
    """Where the plan's equation has no solution, the plan must not raise an error. The cases
    include a turn limit of 0 and a drift of V or more."""
    farthest = 0.0
    for wind, limit in product(np.arange(0.0, 1.2, 0.1), np.arange(0.0, 3.2, 0.2)):
        lap = plan((wind * V, 0.0), V=V, r_d=R_D, limit=limit * V / R_D)
        radii = (
            [R_D]
            if lap is None
            else [lap.at(float(angle))[0] for angle in np.linspace(-pi, pi, 20)]
        )
        assert np.isfinite(radii).all()
        farthest = max(farthest, np.abs(np.array(radii) - R_D).max())
    assert farthest == pytest.approx(0.2 * R_D)


def test_lap_plan_is_none_if_turn_limit_suffices():
    assert plan((WIND, 0.0), V=V, r_d=R_D, limit=0.24) is None
    assert plan((0.0, 0.0), V=V, r_d=R_D, limit=V / R_D * 1.02) is None


def flown(limit_known, sense=1.0, seconds=240.0, dt=0.05):
    """Return the RMS radius error over the last two laps (m), and the final angular momentum per
    mass about the target. The vehicle turns at LIMIT at most."""
    lag = 0.4
    p = (R_D + 40.0, 0.0)
    psi = 1.5 * sense
    rate = 0.0
    d = (3.0, -4.0)
    under_way = PendingTurn()
    response = Response(0.0, lag, 1 / lag)
    errors = []
    for i in range(round(seconds / dt)):
        here = mirrored(p, d, psi, under_way.at(i * dt, response, rate), sense)
        lap = plan(here[1], V=V, r_d=R_D, limit=LIMIT) if limit_known else None
        gains = drift_gains(V, lag, 1 / lag)
        command = clip(
            sense * drift(*here, V=V, r_d=R_D, max_turn_rate=0.3, gains=gains, lap=lap),
            -LIMIT,
            LIMIT,
        )
        under_way.command(i * dt, command)
        rate += (command - rate) * dt / lag
        x, y = chord(V, psi, rate * dt, dt)
        p = (p[0] + x + d[0] * dt, p[1] + y + d[1] * dt)
        psi = psi + rate * dt
        errors.append(hypot(*p) - R_D)
    last = errors[-round(4 * pi * R_D / V / dt) :]
    v = V * np.cos(psi) + d[0], V * np.sin(psi) + d[1]
    return float(np.sqrt(np.mean(np.square(last)))), p[0] * v[1] - p[1] * v[0]


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_drift_law_with_planned_lap_reduces_radius_error(sense):
    planned, momentum = flown(True, sense)
    assert planned < 1.3 * squeezed(0.98 * LIMIT)
    assert planned < 0.5 * flown(False, sense)[0]
    assert momentum * sense > 0


def after(*banks, commanded=0.4, step=0.05, limit=None):
    """Return the bank limit learned from a series of banks, given as coordinated turn rates
    (rad/s). The nose of the vehicle turns at 0.7 of them."""
    heading = 3.0
    limit = deepcopy(limit) if limit else BankLimit()
    for i, (before, now) in enumerate(pairwise(banks)):
        heading = wrap(heading + 0.7 * now * step)
        own = OwnMotion(i * step, heading, 0.7 * now, V, bank_turn=now)
        limit.follow(own, commanded, before)
    return limit


def test_bank_limit_is_learned_from_bank_below_command():
    assert after(*[0.3] * 15).bank == inf
    found = after(*[0.3] * 60)
    assert (found.bank, found.turn) == pytest.approx((0.3, 0.21))
    assert after(*[-0.3] * 60, commanded=-0.4).turn == pytest.approx(0.21)


@pytest.mark.parametrize(
    ("banks", "commanded"),
    [([0.39] * 60, 0.4), (list(np.linspace(-0.3, 0.35, 60)), 0.4), ([-0.3] * 60, 0.4)],
    ids=["as commanded", "rolling", "opposite"],
)
def test_bank_limit_needs_steady_bank_below_command(banks, commanded):
    assert after(*banks, commanded=commanded).bank == inf


def test_bank_limit_is_forgotten_when_bank_exceeds_limit():
    assert after(*[0.33] * 10, limit=after(*[0.3] * 60)).bank == inf
