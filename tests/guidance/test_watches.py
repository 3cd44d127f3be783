"""What watches a flight: a drift that the circle does not allow, and a turn command that swings from limit to limit."""

from math import pi, sin, sqrt

import pytest

from circnav_mav.guidance.types import Direction, Orbit, RangeEstimate
from circnav_mav.guidance.watches import CommandWatch, DriftAlarm, watch_drift
from tests.guidance.relative import known

V, R, LIMIT = 15.0, 100.0, 0.35
ORBIT = Orbit(R, Direction.CLOCKWISE, V, LIMIT)
ALLOWED = sqrt(R * V * LIMIT) - V
"""(V + W)^2 = V omega_max r_d, solved for W: 7.91 m/s."""
QUIET = DriftAlarm()


def after(drifts, most_turn=LIMIT, *, alarm=QUIET, start=0.0, trusted=True):
    """The alarm after estimates of drift, 10 a second."""
    for at, drift in enumerate(drifts):
        motion = known(drift_x=0.6 * drift, drift_y=0.8 * drift, trusted=trusted)
        alarm = watch_drift(
            alarm, RangeEstimate(start + 0.1 * at, 100.0, 0.0, 0.5, 0.1, relative=motion), ORBIT, most_turn
        )
    return alarm


@pytest.mark.parametrize(("most", "allowed"), [(LIMIT, ALLOWED), (0.72 * LIMIT, sqrt(0.72 * R * V * LIMIT) - V)])
def test_it_is_raised_at_the_drift_that_the_turn_rate_really_reached_allows(most, allowed):
    """Most downwind the ground speed is V + W and the course turns by V/(V + W) of the nose's rate."""
    assert not after([allowed - 0.01] * 100, most).on
    raised = after([allowed + 0.01] * 100, most)
    assert (raised.on, raised.allowed) == (True, pytest.approx(allowed))


def test_a_gust_raises_nothing_a_lull_does_not_end_it_and_what_is_not_trusted_changes_nothing():
    assert not after(([ALLOWED + 2] * 25 + [ALLOWED - 0.1] * 5) * 4).on
    raised = after([ALLOWED + 2] * 40)
    assert after([0.95 * ALLOWED], alarm=raised, start=5.0).on
    assert not after([0.89 * ALLOWED], alarm=raised, start=5.0).on
    assert after([0.0] * 40, alarm=raised, trusted=False) == raised
    assert after([ALLOWED + 2] * 40, trusted=False) == watch_drift(QUIET, None, ORBIT, LIMIT) == QUIET


def test_its_words_fit_a_statustext_with_our_name():
    assert after([ALLOWED + 2] * 40).text == "drift 9.9 m/s, this circle allows 7.9"
    assert len("circnav: " + DriftAlarm(drift=99.9, allowed=99.9).text) <= 50


def watched(command, seconds=60.0):
    """After a command given in units of the limit as a function of time, cut to it."""
    watch = CommandWatch()
    for i in range(round(seconds / 0.05)):
        watch = watch.watch(0.05 * i, LIMIT * min(max(command(0.05 * i), -1.0), 1.0), LIMIT)
    return watch


@pytest.mark.parametrize("period", [1.0, 2.5, 4.6])  # as seen on firmware
def test_a_command_that_swings_between_its_limits_is_a_cycle_and_lowers_the_gains_but_not_without_end(period):
    watch = watched(lambda t: 0.4 + 1.3 * sin(2 * pi * t / period))
    assert watch.cycles >= 1 and watch.share < 1
    assert watched(lambda t: 2 * sin(2 * pi * t / period), 1000.0).share == 0.3


@pytest.mark.parametrize(
    "command",
    [
        lambda t: 0.3 + 0.2 * sin(2 * pi * t / 40),
        lambda t: 0.3 + 0.3 * sin(2 * pi * t / 1.5),
        lambda t: 0.7 * sin(2 * pi * t / 6),
        lambda t: 0.3 if t > 16 else 1.0 if t // 2.5 % 2 == 0 else -1.0,
    ],
    ids=[
        "the circle in wind",
        "restless, but far from the limits",
        "the weave of a search",
        "an approach, six times to and fro",
    ],
)
def test_what_a_flight_needs_is_no_cycle(command):
    assert watched(command).share == 1.0


def test_a_cycle_that_stops_lowers_the_gains_no_further():
    shares = [watched(lambda t: 1.3 * sin(2 * pi * t) if t < 8 else 0.3, seconds).share for seconds in (30.0, 300.0)]
    assert shares[0] == shares[1] < 1.0
