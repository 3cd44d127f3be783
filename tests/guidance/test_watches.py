"""Alarms for a drift that exceeds the limit of the circle, and for a wrong airspeed."""

from math import cos, sin, sqrt

import pytest

from circnav_mav.guidance.types import Direction, Orbit, RangeEstimate
from circnav_mav.guidance.watches import AirspeedAlarm, DriftAlarm, watch_airspeed, watch_drift
from tests.guidance.relative import known

V = 15.0
R = 100.0
LIMIT = 0.35
ORBIT = Orbit(R, Direction.CLOCKWISE, V, LIMIT)
ALLOWED = sqrt(R * V * LIMIT) - V
"""(V + W)^2 = V omega_max r_d, solved for W: 7.91 m/s."""
QUIET = DriftAlarm()


def after(drifts, most_turn=LIMIT, *, alarm=QUIET, start=0.0, trusted=True):
    """Return the alarm after drift estimates at 10 Hz."""
    for at, drift in enumerate(drifts):
        motion = known(drift_x=0.6 * drift, drift_y=0.8 * drift, trusted=trusted)
        alarm = watch_drift(
            alarm,
            RangeEstimate(start + 0.1 * at, 100.0, 0.0, 0.5, 0.1, relative=motion),
            ORBIT,
            most_turn,
        )
    return alarm


@pytest.mark.parametrize(
    ("most", "allowed"), [(LIMIT, ALLOWED), (0.72 * LIMIT, sqrt(0.72 * R * V * LIMIT) - V)]
)
def test_drift_alarm_starts_at_drift_allowed_by_turn_rate(most, allowed):
    """Downwind the ground speed is at most V + W, and the course turns at V/(V + W) of the nose's
    rate."""
    assert not after([allowed - 0.01] * 100, most).on
    raised = after([allowed + 0.01] * 100, most)
    assert (raised.on, raised.allowed) == (True, pytest.approx(allowed))


def test_drift_alarm_ignores_gusts_lulls_and_untrusted_drift():
    assert not after(([ALLOWED + 2] * 25 + [ALLOWED - 0.1] * 5) * 4).on
    raised = after([ALLOWED + 2] * 40)
    assert after([0.95 * ALLOWED], alarm=raised, start=5.0).on
    assert not after([0.89 * ALLOWED], alarm=raised, start=5.0).on
    assert after([0.0] * 40, alarm=raised, trusted=False) == raised
    assert (
        after([ALLOWED + 2] * 40, trusted=False) == watch_drift(QUIET, None, ORBIT, LIMIT) == QUIET
    )


@pytest.mark.parametrize(
    ("wind", "excess", "is_raised"), [(0.0, 3.0, True), (5.0, 4.5, True), (5.0, 0.0, False)]
)
def test_airspeed_alarm_needs_drift_that_turns_with_nose(wind, excess, is_raised):
    """The estimator takes a measured airspeed that is too high as a drift against the nose."""
    alarm = AirspeedAlarm()
    for at in range(1500):
        time = 0.1 * at
        heading = -V / R * time
        motion = known(
            drift_x=wind - excess * cos(heading), drift_y=-excess * sin(heading), heading=heading
        )
        estimate = RangeEstimate(time, R, 0.0, 0.5, 0.1, relative=motion)
        alarm = watch_airspeed(alarm, estimate, ORBIT)
    assert alarm.on is is_raised
    assert alarm.excess == pytest.approx(excess, abs=1.0)
