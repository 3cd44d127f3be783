"""The path through the air between reports of own motion, and for a short time after the newest
report."""

from math import cos, pi, sin

import pytest

from circnav_mav.guidance.estimators.dead_reckoning import EXTRAPOLATED, HOLE, FlownPath
from circnav_mav.guidance.types import OwnMotion

V = 15.0
OMEGA = 0.4


def circling(t: float, airspeed: float = V) -> OwnMotion:
    return OwnMotion(t, (OMEGA * t + 3.0 + pi) % (2 * pi) - pi, OMEGA, airspeed)


def arc(t: float) -> tuple[float, float]:
    """Displacement of a steady turn since t = 0, from the closed form."""
    return V / OMEGA * (sin(OMEGA * t + 3.0) - sin(3.0)), -V / OMEGA * (
        cos(OMEGA * t + 3.0) - cos(3.0)
    )


def path_of(*times: float) -> FlownPath:
    path = FlownPath()
    for t in times:
        path.move(circling(t))
    return path


@pytest.mark.parametrize("t", [0.0, 0.07, 0.2, 0.33, 1.0, 1.4, 1.4 + EXTRAPOLATED])
def test_flown_path_of_steady_turn_is_arc(t):
    """The heading wraps at pi after 0.35 s."""
    knot = path_of(0.0, 0.2, 0.4, 1.4).at(t)
    x, y = arc(t)
    assert (knot.x, knot.y) == pytest.approx((x, y), abs=1e-9)
    assert (knot.motion.time, knot.motion.turn_rate, knot.motion.airspeed) == pytest.approx(
        (t, OMEGA, V)
    )
    assert (knot.motion.heading - OMEGA * t - 3.0 + pi) % (2 * pi) == pytest.approx(pi)


@pytest.mark.parametrize("t", [-0.01, 0.41 + EXTRAPOLATED])
def test_flown_path_is_unknown_outside_reported_times(t):
    assert path_of(0.0, 0.2, 0.4).at(t) is None
    assert FlownPath().at(t) is None


@pytest.mark.parametrize(("every", "longest"), [(0.2, EXTRAPOLATED), (0.8, 1.28), (1.2, 1.6)])
def test_flown_path_is_extrapolated_longer_if_reports_are_rare(every, longest):
    path = path_of(0.0, every)
    assert path.at(every + longest - 0.01) is not None
    assert path.at(every + longest + 0.01) is None


def test_flown_path_interpolates_turn_rate_and_averages_airspeed():
    path = FlownPath()
    path.move(OwnMotion(0.0, 0.0, 0.0, 10.0))
    path.move(OwnMotion(1.0, 0.0, 0.2, 14.0))
    knot = path.at(0.25)
    assert (knot.motion.turn_rate, knot.motion.airspeed, knot.x) == pytest.approx((0.05, 12.0, 3.0))
    assert path.at(1.0).x == pytest.approx(12.0)


def test_flown_path_ignores_late_reports():
    path = path_of(0.0, 0.2, 0.4)
    late = path_of(0.0, 0.2, 0.4)
    for t in (0.4, 0.3, 0.0):
        late.move(circling(t, airspeed=3.0))
    assert [late.at(t) for t in (0.1, 0.3, 0.4, 0.6)] == [path.at(t) for t in (0.1, 0.3, 0.4, 0.6)]


def test_flown_path_is_interrupted_by_gap_in_reports():
    whole = path_of(0.0, HOLE)
    broken = path_of(0.0, HOLE + 0.01, HOLE + 0.2)
    assert whole.at(1.0).piece == whole.at(HOLE).piece == 0
    assert broken.at(1.0) is None
    assert (broken.at(HOLE + 0.1).piece, broken.at(HOLE + 0.3).piece) == (1, 1)
