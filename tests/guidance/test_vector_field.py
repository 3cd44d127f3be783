"""The drift law: a vector field of headings around the target, in wind."""

from itertools import product
from math import acos, hypot, pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance.maths import chord, clip, wrap
from circnav_mav.guidance.turn_response import Pending, PendingTurn, Response
from circnav_mav.guidance.vector_field import (
    DriftGains,
    drift,
    drift_gains,
    field_heading,
    inward_angle,
    mirrored,
    orbit_turn_rate,
)

V = 15.0
R_D = 100.0
LIMIT = 0.35
LAG = 0.4
GAINS = drift_gains(V, LAG, 1 / LAG)
angles = st.floats(-pi, pi)


def turn(p, d, psi, omega):
    """Return the turn command while a turn of an earlier command is still pending."""
    return drift(
        np.array(p),
        np.array(d),
        psi,
        Pending(LAG * omega, LAG),
        V=V,
        r_d=R_D,
        max_turn_rate=LIMIT,
        gains=GAINS,
    )


@given(
    r=st.floats(5, 900),
    at=angles,
    psi=angles,
    wind=st.floats(0, 10),
    blows=angles,
    omega=st.floats(-0.35, 0.35),
)
def test_drift_law_is_independent_of_compass_direction(r, at, psi, wind, blows, omega):
    commands = []
    for turned in (0.0, 1.1):
        p = r * np.array([np.cos(at + turned), np.sin(at + turned)])
        d = wind * np.array([np.cos(blows + turned), np.sin(blows + turned)])
        commands.append(float(turn(p, d, psi + turned, omega)))
    first, command = commands
    # where the heading error is pi, a turn to either side is correct
    assert (
        command == pytest.approx(first, abs=1e-6)
        or abs(abs(command - first) - 2 * pi * GAINS.heading) < 1e-3
    )


@given(at=angles, wind=st.floats(0, 13), blows=angles, r=st.floats(30, 900))
def test_field_heading_in_wind_flies_course_of_vector_field(at, wind, blows, r):
    p, d = (s * np.array([np.cos(a), np.sin(a)]) for s, a in ((r, at), (wind, blows)))
    psi = field_heading(p, d, V=V, r_d=R_D, k=GAINS.radial, max_turn_rate=LIMIT)
    v = V * np.array([np.cos(psi), np.sin(psi)]) + d
    n = p / r
    inward = inward_angle(r, r_d=R_D, k=GAINS.radial, sharpest=0.7 * LIMIT / (V + wind))
    assert np.arctan2(-(n @ v), n[0] * v[1] - n[1] * v[0]) == pytest.approx(inward, abs=1e-6)


@pytest.mark.parametrize(
    ("r", "sharpest", "inward"),
    [
        (50.0, 0.02, -1.0),
        (98.0, 0.02, -0.2),
        (50.0, 0.01, -sqrt(0.1)),
        (1.0, 0.05, -pi / 2),
        (400.0, 0.02, acos(0.25)),
    ],
)
def test_inward_angle_matches_hand_calculation_far_from_circle(r, sharpest, inward):
    """By hand: inward angle sqrt(2 e (sharpest - 1/r_d)) = sqrt(2 * 50 * 0.01) = 1 rad. The law
    uses a difference of at least 0.1/r_d, and its course points straight outward at most."""
    assert inward_angle(r, r_d=R_D, k=1e4, sharpest=sharpest) == pytest.approx(inward, rel=1e-4)


def flown(sense, start, psi, d, seconds, dt=0.05):
    """Fly a point mass with a turn lag by the law, with exact relative motion. Return the ranges,
    the last position (2,), and the angular momentum about the target. The sign of the momentum
    gives the direction of rotation."""
    p = np.array(start, float)
    d = np.array(d, float)
    omega = 0.0
    under_way = PendingTurn()
    ranges = []
    response = Response(0.0, LAG, 1 / LAG)
    for i in range(round(seconds / dt)):
        here = mirrored(p, d, psi, under_way.at(i * dt, response, omega), sense)
        command = sense * clip(
            drift(*here, V=V, r_d=R_D, max_turn_rate=LIMIT, gains=GAINS), -LIMIT, LIMIT
        )
        under_way.command(i * dt, command)
        after = command + (omega - command) * np.exp(-dt / LAG)
        turned = command * dt + (omega - command) * LAG * (1 - np.exp(-dt / LAG))
        p = p + chord(V, psi, turned, dt) + d * dt
        psi = psi + turned
        omega = after
        ranges.append(np.hypot(*p))
    v = V * np.array([np.cos(psi), np.sin(psi)]) + d
    return np.array(ranges), p, p[0] * v[1] - p[1] * v[0]


@pytest.mark.parametrize(("r", "side"), [(85.0, -1), (105.0, 1), (180.0, 1), (240.0, -1)])
def test_drift_law_turns_away_from_target_only_near_circle(r, side):
    """The heading error is 2.5 rad to the right, the side of the target. r: range, m; three turn
    radii outside the circle are 229 m. side: sign of the turn, left positive."""
    field = {"V": V, "r_d": R_D, "k": GAINS.radial, "max_turn_rate": LIMIT, "lap": None}
    heading = field_heading((r, 0.0), (0.0, 0.0), **field)
    assert np.sign(turn((r, 0.0), (0.0, 0.0), heading + 2.5, 0.0)) == side


def test_drift_law_reverses_outward_when_direction_is_wrong_outside():
    """The half turn to the inside is shorter, but passes the target at 0.3 to 0.7 r_d."""
    for r, heading, d in product(
        [115.0, 160.0, 230.0], [-1.7, -1.3, -0.6], [(0, 0), (-3, 2), (-3, -2)]
    ):
        ranges, _, _ = flown(1.0, (r, 0.0), heading, d, seconds=60.0)
        assert ranges.min() > 0.9 * R_D
        assert ranges.max() < r + R_D
        assert ranges[-1] == pytest.approx(R_D, abs=2.0)


@pytest.mark.parametrize("start", [(300.0, 0.0), (10.0, 5.0)])
def test_drift_law_reaches_mirrored_circles_in_strong_wind(start):
    ranges, p, momentum = flown(1.0, start, 2.0, (6.0, -3.0), seconds=200.0)
    _, mirrored_p, mirrored_momentum = flown(
        -1.0, (start[0], -start[1]), -2.0, (6.0, 3.0), seconds=200.0
    )
    assert ranges[-1] == pytest.approx(R_D, abs=0.1)
    assert momentum > 0 > mirrored_momentum
    assert mirrored_p == pytest.approx(p * (1.0, -1.0), abs=1e-6)


def swing(dead, known):
    """Return the largest radius error (m) in the last 60 s of a flight of 200 s without wind.
    `known`: share of the vehicle's dead time that the law takes into account."""
    dt = 0.02
    x = 1.15 * R_D
    y = 0.0
    psi = pi / 2
    rate = 0.0
    worst = 0.0
    response = Response(known * dead, LAG, 1 / LAG)
    under_way = PendingTurn()
    commands = [0.0] * (round(dead / dt) + 1)
    facts = {"V": V, "r_d": R_D, "max_turn_rate": LIMIT}
    gains = drift_gains(V, response.delay, response.settles)
    for i in range(10_000):
        pending = under_way.at(i * dt, response, rate)
        commands.append(
            clip(drift((x, y), (0.0, 0.0), psi, pending, gains=gains, **facts), -LIMIT, LIMIT)
        )
        under_way.command(i * dt, commands[-1])
        rate += (commands[-1 - round(dead / dt)] - rate) * dt / LAG
        east, north = chord(V, psi, rate * dt, dt)
        x = x + east
        y = y + north
        psi = psi + rate * dt
        worst = max(worst, abs(hypot(x, y) - R_D)) if i > 7000 else 0.0
    return worst


@pytest.mark.parametrize("under_way", [0.3, -0.3])
@pytest.mark.parametrize("beyond", [0.2, 0.4])
def test_drift_law_continues_turn_when_reversing_takes_longer(under_way, beyond):
    """The turn to the wanted heading is half a circle plus `beyond` in the present direction, and
    half a circle minus `beyond` in the other. The pending turn lengthens the latter."""
    p = (10 * R_D, 0.0)
    d = (0.0, 0.0)
    wanted = field_heading(p, d, V=V, r_d=R_D, k=GAINS.radial, max_turn_rate=LIMIT)
    psi = wanted - (pi + beyond) * np.sign(under_way)
    asked = drift(
        p, d, psi, Pending(under_way, LAG), V=V, r_d=R_D, max_turn_rate=LIMIT, gains=GAINS
    )
    assert np.sign(asked) == (
        np.sign(under_way) if beyond < abs(under_way) else -np.sign(under_way)
    )


@given(wind=st.floats(0, 6), blows=angles, at=angles)
def test_drift_law_continues_circle_when_pending_turns_follow_circle(wind, blows, at):
    d = wind * np.array([np.cos(blows), np.sin(blows)])
    ahead = 0.5
    dt = 0.005
    p = R_D * np.array([np.cos(at), np.sin(at)])
    psi = field_heading(p, d, V=V, r_d=R_D, k=GAINS.radial, max_turn_rate=LIMIT)
    turned = 0.0
    heading = psi
    for _ in range(round(ahead / dt)):
        step = dt * float(orbit_turn_rate(d, heading, V=V, r_d=R_D))
        turned = turned + step
        heading = heading + step
    gains = DriftGains(1.0, GAINS.radial)
    asked = drift(p, d, psi, Pending(turned, ahead), V=V, r_d=R_D, max_turn_rate=LIMIT, gains=gains)
    assert float(asked) == pytest.approx(float(orbit_turn_rate(d, heading, V=V, r_d=R_D)), abs=3e-4)


@given(beyond=st.floats(-0.3, 0.3))
def test_drift_law_subtracts_excess_of_pending_turn(beyond):
    """The vehicle is on the circle with the right heading."""
    here = ((R_D, 0.0), (0.0, 0.0), pi / 2)
    turn = V / R_D
    under_way = Pending(turn * 0.01 + beyond, 0.01)
    asked = drift(*here, under_way, V=V, r_d=R_D, max_turn_rate=LIMIT, gains=DriftGains(1.0, 0.0))
    assert float(asked) == pytest.approx(turn - beyond, abs=5e-3)


@given(
    at=angles,
    psi=angles,
    wind=st.floats(0, 10),
    blows=angles,
    r=st.floats(80, 130),
    turns=st.floats(-0.1, 0.1),
)
def test_drift_law_turns_nose_with_turning_wind(at, psi, wind, blows, r, turns):
    def blowing(time):
        return wind * np.array([np.cos(blows + turns * time), np.sin(blows + turns * time)])

    def wanted(time):
        return field_heading(p, blowing(time), V=V, r_d=R_D, k=GAINS.radial, max_turn_rate=LIMIT)

    p = r * np.array([np.cos(at), np.sin(at)])
    change = turns * wind * np.array([-np.sin(blows), np.cos(blows)])
    known = {"V": V, "r_d": R_D, "max_turn_rate": LIMIT, "gains": GAINS}
    without, with_it = (
        drift(p, blowing(0), psi, Pending(0.0, 0.0), **known, change=c)
        for c in (0 * change, change)
    )
    assert with_it - without == pytest.approx(wrap(wanted(0.05) - wanted(-0.05)) / 0.1, abs=2e-4)


def test_drift_law_oscillates_only_with_unknown_dead_time():
    assert swing(0.3, 1.0) < 0.05
    assert swing(1.0, 1.0) < 0.05
    assert swing(1.5, 0.0) > 2.0


@given(wind=st.floats(0, 8), blows=angles, at=angles)
def test_orbit_turn_rate_matches_drift_law_on_circle(wind, blows, at):
    """Compares two derivations of the turn rate on the circle: from the heading alone, and from the
    rotation of the field along the circle."""
    d = wind * np.array([np.cos(blows), np.sin(blows)])
    p = R_D * np.array([np.cos(at), np.sin(at)])
    psi = field_heading(p, d, V=V, r_d=R_D, k=GAINS.radial, max_turn_rate=LIMIT)
    alone = float(orbit_turn_rate(d, psi, V=V, r_d=R_D))
    asked = drift(p, d, psi, Pending(0.0, 0.0), V=V, r_d=R_D, max_turn_rate=LIMIT, gains=GAINS)
    assert float(asked) == pytest.approx(alone, abs=3e-4)
