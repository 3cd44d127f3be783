"""Alarms for a drift that exceeds the limit of the circle, for a wrong airspeed, and for ranges
that contradict the turns."""

from math import asin, cos, pi, sin, sqrt

import pytest

from circnav_mav.guidance.monitors import (
    AirspeedAlarm,
    ClosingMonitor,
    DriftMonitor,
    LapAlarm,
    watch_airspeed,
    watch_lap,
)
from circnav_mav.guidance.types import Direction, Orbit, RangeEstimate
from tests.guidance.relative import known

V = 15.0
R = 100.0
LIMIT = 0.35
ORBIT = Orbit(R, Direction.CLOCKWISE, V, LIMIT)
ALLOWED = sqrt(R * V * LIMIT) - V
"""Largest drift W at which the vehicle can fly the circle: (V + W)^2 = V omega_max r_d gives 7.91
m/s."""


def after(drifts, most_turn=LIMIT, *, watch=None, start=0.0, trusted=True):
    """Return the watch after drift estimates at 10 Hz."""
    watch = watch or DriftMonitor()
    for at, drift in enumerate(drifts):
        motion = known(drift_x=0.6 * drift, drift_y=0.8 * drift, trusted=trusted)
        estimate = RangeEstimate(start + 0.1 * at, 100.0, 0.0, 0.5, 0.1, relative=motion)
        watch.update(estimate, ORBIT, most_turn)
    return watch


@pytest.mark.parametrize(
    ("most", "allowed"), [(LIMIT, ALLOWED), (0.72 * LIMIT, sqrt(0.72 * R * V * LIMIT) - V)]
)
def test_drift_alarm_starts_at_drift_allowed_by_turn_rate(most, allowed):
    """Downwind the ground speed is at most V + W. The course then turns at V/(V + W) times the turn
    rate of the nose."""
    assert not after([allowed - 0.01] * 100, most).alarm.on
    raised = after([allowed + 0.01] * 100, most).alarm
    assert (raised.on, raised.allowed) == (True, pytest.approx(allowed))


def test_drift_alarm_ignores_gusts_lulls_and_untrusted_drift():
    assert not after(([ALLOWED + 2] * 25 + [ALLOWED - 0.1] * 5) * 4).alarm.on
    assert not after([ALLOWED + 2] * 40, trusted=False).alarm.on
    raised = after([ALLOWED + 2] * 40)
    assert after([0.0] * 200, watch=raised, start=4.0, trusted=False).alarm.on
    assert after([0.95 * ALLOWED] * 90, watch=raised, start=24.0).alarm.on
    assert not after([0.95 * ALLOWED] * 20, watch=raised, start=33.0).alarm.on


def test_drift_alarm_needs_trusted_drift_throughout_hold_time():
    """The vehicle is engaged 2 s after the drift was trusted, and the trust is lost for a step."""
    watch = after([ALLOWED + 2] * 20)
    watch.update(None, ORBIT, LIMIT)
    after([ALLOWED + 2] * 20, watch=watch, start=2.0)
    after([0.0], watch=watch, start=4.0, trusted=False)
    assert not after([ALLOWED + 2] * 20, watch=watch, start=4.1).alarm.on


@pytest.mark.parametrize(
    ("wind", "before", "after", "is_raised"),
    [
        (0.0, 0.0, 1.4, False),
        (0.0, 0.0, 2.6, True),
        (0.0, 4.0, 4.0, False),
        (5.0, 0.0, 5.0, True),
        (5.0, 4.0, 4.0, False),
    ],
)
def test_airspeed_alarm_needs_change_of_drift_along_nose(wind, before, after, is_raised):
    """The estimator interprets a measured airspeed that is too high as a drift against the nose,
    which turns with the vehicle."""
    alarm = AirspeedAlarm()
    for at in range(2000):
        heading = -V / R * 0.1 * at
        excess = before if at < 1000 else after
        motion = known(
            drift_x=wind - excess * cos(heading), drift_y=-excess * sin(heading), heading=heading
        )
        estimate = RangeEstimate(0.1 * at, R, 0.0, 0.5, 0.1, relative=motion)
        alarm = watch_airspeed(alarm, estimate, ORBIT)
    assert alarm.on is is_raised


@pytest.mark.parametrize(
    ("radii", "closing", "drift", "seconds", "is_raised"),
    [
        (5.0, 0.0, 3.0, 20.0, False),
        (5.0, 0.0, 3.0, 35.0, True),
        (5.0, 0.035, 3.0, 35.0, True),
        (5.0, 0.07, 3.0, 100.0, False),
        (5.0, 0.0, 1.1 * V, 8.0, False),
        (5.0, 0.0, 1.1 * V, 14.0, True),
        (1.1, 0.0, 3.0, 100.0, False),
        (1.8, 0.0, 3.0, 35.0, True),
    ],
)
def test_closing_alarm_needs_vehicle_that_stays_away(radii, closing, drift, seconds, is_raised):
    """The vehicle is outside its circle. radii: range over radius. closing: speed toward the
    target, as a share of V. drift: estimated drift, m/s."""
    watch = ClosingMonitor()
    for at in range(round(10 * seconds)):
        motion = known(drift_x=drift)
        r = max(radii * R - 0.1 * at * closing * V, 1.3 * R if radii > 1.3 else 0.0)
        estimate = RangeEstimate(0.1 * at, r, -closing * V, 0.5, 0.1, relative=motion)
        watch.update(estimate, ORBIT)
    assert watch.alarm.on is is_raised


def after_laps(radius, ranges, wind=0.0, laps=1.2, new_wind=None, gap=0.0):
    """Return the alarm after laps on a circle of a true radius (m), with estimates at 10 Hz. The
    ranges (m) have another length, and the estimated airspeed scale has adapted to them. The wind
    blows to the north. After 0.9 laps it may have a new strength (m/s). gap: time without
    estimates after 20 s, s."""
    alarm = LapAlarm()
    angle = 0.0
    for at in range(100_000):
        if new_wind is not None and angle > 0.9 * 2 * pi:
            wind = new_wind
        # ground speed along the circle, which the wind increases on its eastern side
        ground = sqrt(V**2 - (wind * sin(angle)) ** 2) + wind * cos(angle)
        if angle > laps * 2 * pi:
            break
        heading = angle + pi / 2 + asin(wind * sin(angle) / V)
        motion = known(heading=heading, airspeed=0.9 * V, scale=0.9, drift_y=wind)
        if not 20.0 < 0.1 * at < 20.0 + gap:
            estimate = RangeEstimate(0.1 * at, ranges, 0, 0.5, 0.1, relative=motion)
            alarm = watch_lap(alarm, estimate, 0.1)
        angle += 0.1 * ground / radius
    return alarm


@pytest.mark.parametrize("wind", [0.0, 5.0])
@pytest.mark.parametrize(("radius", "ranges"), [(192.0, 150.0), (80.0, 272.0), (150.0, 150.0)])
def test_lap_alarm_finds_true_radius_by_turn_rate(radius, ranges, wind):
    alarm = after_laps(radius, ranges, wind)
    assert alarm.on == (radius != ranges)
    assert alarm.by_turns == pytest.approx(radius, rel=0.02) and alarm.by_ranges == ranges


@pytest.mark.parametrize(("gap", "is_raised"), [(4.0, True), (7.0, False)])
def test_lap_alarm_restarts_lap_after_long_gap(gap, is_raised):
    assert after_laps(192.0, 150.0, gap=gap).on is is_raised


def test_lap_alarm_stays_silent_when_wind_rises():
    alarm = after_laps(150.0, 150.0, wind=3.0, new_wind=9.0)
    assert not alarm.on and alarm.by_turns == pytest.approx(150.0, rel=0.05)


def test_lap_alarm_needs_whole_lap_around_target():
    assert after_laps(192.0, 150.0, laps=0.9) == after_laps(192.0, 150.0, laps=0.9)._replace(
        on=False
    )
    passing = LapAlarm()
    for at in range(1000):
        motion = known(heading=0.1 * at)
        estimate = RangeEstimate(0.1 * at, 300.0 - at / 5, 0, 0.5, 0.1, relative=motion)
        passing = watch_lap(passing, estimate, 0.1)
    assert not passing.on and watch_lap(passing, None, 0.1) == LapAlarm()
