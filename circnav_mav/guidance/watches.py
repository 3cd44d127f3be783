"""What goes on over a flight beside the law: a slow integral that holds the mean radius, the mission's bounds, and a
drift that the circle does not allow."""

from dataclasses import dataclass
from typing import NamedTuple

from circnav_mav.guidance.laws import tolerated_drift
from circnav_mav.guidance.types import Orbit, RangeEstimate

TRIM_NEAR = 0.2
"""The radius trim grows only within this fraction of the radius, where the law is linear, and while nothing saturates;
farther off it only unwinds, for what it holds may be what keeps the vehicle there."""
MOST_TRIM = 0.15
"""Bound of the trim, as a fraction of the radius."""
CLOSES = 0.4
"""Time in units of r_d/V in which an approach closes an error: of one that shrinks so fast nothing is counted. Counted
whole, the approach left 3.6 m of trim, and a metre of radius for half a minute (150 m, 22 m/s)."""
PERSISTS = 3.0
"""Time, s, for which the drift must be too strong before the alarm is raised: the estimate follows single gusts."""
ALLOWED_AGAIN = 0.9
"""Share of the allowed drift below which the alarm ends."""


def next_trim(
    trim: float, *, rate: float, r: float, change: float, r_d: float, V: float, step: float, saturated: bool
) -> float:
    """The trim (m), added to the radius that the law is fed, after `step` seconds to range r (m) in which it changed by
    `change` (m), growing with `rate` (1/s) against the error that does not close by itself. It goes by
    the change of the range: a lasting error of the estimated range rate would become one of the radius.

    A law's radius rests on V and on the turn rate being what they are told to be; a vehicle whose true airspeed is 6 %
    above the indicated one flies 2 m outside a circle of 150 m.
    """
    after = trim - rate * ((r - r_d) * step + CLOSES * r_d / V * change)
    if saturated:
        return trim
    if abs(r - r_d) > TRIM_NEAR * r_d:
        unwound = after if trim * after > 0 else 0.0
        return unwound if abs(unwound) < abs(trim) else trim
    return min(max(after, -MOST_TRIM * r_d), MOST_TRIM * r_d)


@dataclass(frozen=True, slots=True)
class Bounds:
    """None: no such bound. Ranges in m, altitudes in m above sea level, battery in percent."""

    closest: float | None = None
    farthest: float | None = None
    lowest: float | None = None
    highest: float | None = None
    battery: float | None = None


def breach(bounds: Bounds, *, r: float | None, altitude: float | None, battery: float | None) -> str | None:
    """What bound is broken, in words; what is not known breaks none."""
    limits = (
        (r, bounds.closest, -1, "range {:.1f} m is nearer than {:.1f} m"),
        (r, bounds.farthest, 1, "range {:.1f} m is farther than {:.1f} m"),
        (altitude, bounds.lowest, -1, "altitude {:.1f} m is below {:.1f} m"),
        (altitude, bounds.highest, 1, "altitude {:.1f} m is above {:.1f} m"),
        (battery, bounds.battery, -1, "battery {:.0f} % is below {:.0f} %"),
    )
    for value, bound, side, words in limits:
        if value is not None and bound is not None and side * (value - bound) > 0:
            return words.format(value, bound)
    return None


class DriftAlarm(NamedTuple):
    """Whether the drift (wind less target motion) is more than the circle allows. on: whether it is raised. since: when
    the drift became too strong, s; None while it is not. drift: as estimated last, m/s. allowed: the most in which the
    circle can be held, m/s."""

    on: bool = False
    since: float | None = None
    drift: float = 0.0
    allowed: float = 0.0


def watch_drift(alarm: DriftAlarm, estimate: RangeEstimate | None, orbit: Orbit, most_turn: float) -> DriftAlarm:
    """The alarm after an estimate; unchanged by one that does not know the drift. most_turn: turn rate that the vehicle
    reaches, as learnt, rad/s."""
    motion = estimate.relative if estimate is not None else None
    if estimate is None or motion is None or not motion.trusted:
        return alarm
    V = max(motion.airspeed, 0.1 * orbit.speed)
    allowed = max(tolerated_drift(V, orbit.radius, most_turn), 0.0)
    drift = motion.drift
    if not drift > allowed * (ALLOWED_AGAIN if alarm.on else 1.0):
        return DriftAlarm(False, None, drift, allowed)
    since = estimate.time if alarm.since is None else alarm.since
    return DriftAlarm(alarm.on or estimate.time - since >= PERSISTS, since, drift, allowed)
