"""Law `drift`: guidance by the relative motion (position relative to the target, and drift), not by
range alone.

The law follows a vector field of ground courses. The wind triangle compensates the drift (Lyapunov
vector fields: Lawrence, Frew, Pisano 2008; wind: Frew 2007). The rotation of the field is the
feedforward. Unlike exact linearization of r, the law has no singular heading, and never demands a
closing speed that the wind makes impossible.

All functions assume a counter-clockwise orbit, omega > 0 to the left. `mirrored` converts a
clockwise orbit.
"""

from math import acos, asin, atan2, cos, hypot, pi, sin, sqrt
from typing import NamedTuple

from circnav_mav.guidance.lap_plan import Lap
from circnav_mav.guidance.maths import REACHABLE, Vector, chord, clip, wrap
from circnav_mav.guidance.turn_response import Pending

STEP = 0.05
"""Half the interval of the central difference of the field along the path, s."""
RADIAL_SHARE = 0.4
"""Gain of the radius loop over gain of the heading loop. At the margins of `drift_gains`, 0.4
suppresses slow errors best. On ArduPlane 4.6.3, wind and turbulence disturbed the radius at
frequencies below 0.4 rad/s."""
OUTWARD = 0.5 * pi
"""Preference for a turn away from the target, rad. The vehicle turns away from the target if this
turn is at most half a turn plus this angle. Otherwise the vehicle turns toward the target."""


class DriftGains(NamedTuple):
    """Gains of the drift law.

    heading: gain on the heading error, 1/s.
    radial: slope of the inward course angle at the circle, rad/m.
    """

    heading: float
    radial: float


def drift_gains(V: float, delay: float, settles: float, share: float = 1.0) -> DriftGains:
    """Return the gains of the drift law.

    V: speed, m/s.
    delay: total delay of link, autopilot and airframe, s.
    settles: settling rate of the response, 1/s.
    share: factor on the gains, below 1 after limit cycles.
    """
    # 0.95: highest crossover in units of the settling rate of the vehicle's response. A poorly
    # damped inner loop has a resonance that its delay does not show.
    # 1.8: highest crossover, rad/s. A faster radius loop follows the noise of ranges (0.5 m at 10
    # Hz).
    most = min(0.95 * settles, 1.8)
    # 0.85: crossover of the heading loop times the whole delay. The pending turn is subtracted, so
    # that only the error of the delay model remains in the loop. For models of real vehicles with
    # 20 % delay error, the gain margin is above 6 dB and the phase margin above 45 deg
    # (tests/guidance/test_margins.py).
    crossover = share * min(0.85 / max(delay, 1e-3), most)
    # The feedforward (rotation of the field ahead) adds radial V (1 + heading delay) to the gain of
    # the heading loop.
    heading = crossover / (1 + 1.5 * RADIAL_SHARE)
    return DriftGains(heading, RADIAL_SHARE * heading / V)


def inward_angle(r: float, *, r_d: float, k: float, sharpest: float) -> float:
    """Return the angle of the ground course inward of the circle's tangent, rad.

    Near the circle: k (r - r_d). Far outside: the straight line tangent to the circle, acos(r_d/r).
    Far inside: the tightest turn tangent to it from within, with the curvature `sharpest`, 1/m.
    """
    e = r - r_d
    line = acos(min(r_d / max(r, 1e-6), 1.0))
    turn = min(sqrt(2 * max(-e, 0.0) * max(sharpest - 1 / r_d, 0.1 / r_d)), 0.5 * pi)
    most = line if e > 0 else turn
    return k * e * most / sqrt(most**2 + (k * e) ** 2 + 1e-12)


def field_heading(
    p: Vector,
    d: Vector,
    *,
    V: float,
    r_d: float,
    k: float,
    max_turn_rate: float,
    lap: Lap | None = None,
) -> float:
    """Return the heading (rad) with a ground course along the field at p, m.

    d: drift, m/s.
    V: true airspeed, m/s.
    k: as in `inward_angle`, rad/m.
    lap: planned lap that replaces the circle, or None.
    """
    r = hypot(p[0], p[1])
    angle = atan2(p[1], p[0])
    outward = 0.0
    if lap is not None:
        r_d, slope = lap.at(angle)
        outward = atan2(slope, r_d)
    sharpest = max_turn_rate / (V + hypot(d[0], d[1]))
    course = angle + pi / 2 - outward + inward_angle(r, r_d=r_d, k=k, sharpest=0.7 * sharpest)
    across = cos(course) * d[1] - sin(course) * d[0]
    return course - asin(clip(across / V, -REACHABLE, REACHABLE))


def drift(
    p: Vector,
    d: Vector,
    psi: float,
    pending: Pending,
    *,
    V: float,
    r_d: float,
    max_turn_rate: float,
    gains: DriftGains,
    change: Vector = (0.0, 0.0),
    lap: Lap | None = None,
) -> float:
    """Return the turn rate (rad/s): rotation of the field after the response delay, plus gain times
    heading error. The pending turn is subtracted from the error. Outside the circle the law prefers
    a turn away from the target.

    p = vehicle - target, m. d = wind - target velocity, m/s.

    psi: heading, rad.
    pending: commanded turn not flown yet.
    V: true airspeed, m/s.
    change: rate of change of d, m/s^2.

    Condition: W = |d| < V, and r_d >= (V + W)^2/(V max_turn_rate) unless `lap` is given.
    """
    ahead = pending.ahead
    rate = pending.turn / max(pending.ahead, STEP)

    def wanted(time: float) -> float:
        x, y = chord(V, psi, rate * time, time)
        there = (p[0] + d[0] * time + x, p[1] + d[1] * time + y)
        then = (d[0] + change[0] * time, d[1] + change[1] * time)
        return field_heading(
            there, then, V=V, r_d=r_d, k=gains.radial, max_turn_rate=max_turn_rate, lap=lap
        )

    now = wanted(0.0)
    late = wanted(ahead + STEP)
    turns = wrap(late - wanted(ahead - STEP))
    # Subtract the rotation of the field during the delay from the pending turn. Use the whole
    # rotation, not rate times delay: in wind the rate changes along the lap.
    under_way = pending.turn - wrap(late - turns / 2 - now)
    # Prefer the side of the pending turn: a turn to the other side first has to cancel it.
    preferred = _outward(hypot(p[0], p[1]), V / max_turn_rate, r_d) + pending.turn
    error = wrap(now - psi - preferred) + preferred
    return turns / (2 * STEP) + gains.heading * (error - under_way)


def _outward(r: float, turn_radius: float, r_d: float) -> float:
    """Return the preference, rad, for a left turn (away from the target) over a right turn.

    The preference is OUTWARD where half a turn to the right may end inside the circle: from r_d to
    two turn radii outside. From there it decreases to 0 at three turn radii outside. It also
    decreases to 0 from r_d to 0.9 r_d.
    """
    beyond = clip((r_d + 3 * turn_radius - r) / turn_radius, 0.0, 1.0)
    outside = clip((r - 0.9 * r_d) / (0.1 * r_d), 0.0, 1.0)
    return OUTWARD * beyond * outside


def orbit_turn_rate(d: Vector, psi: float, *, V: float, r_d: float) -> float:
    """Return the turn rate (rad/s) that stays on the counter-clockwise circle in drift d,
    m/s, at heading psi, rad.

    The heading determines the position on the circle: no range is used. chi' = v_g/r_d for the
    ground course, psi' = chi' v_g/(V cos(psi - chi)) by the wind triangle; V/r_d in still air.
    Condition: |d| < V.
    """
    v = (V * cos(psi) + d[0], V * sin(psi) + d[1])
    ground = max(hypot(v[0], v[1]), 1e-9)
    across = (v[0] * d[1] - v[1] * d[0]) / ground
    along_nose = V * sqrt(1 - clip(across / V, -REACHABLE, REACHABLE) ** 2)
    return ground**2 / (r_d * along_nose)


def mirrored_pair(pair: Vector, sense: float) -> Vector:
    """Return a vector mirrored to the counter-clockwise orbit. sense: as in `mirrored`."""
    return pair[0], pair[1] * sense


def mirrored(
    p: Vector, d: Vector, psi: float, pending: Pending, sense: float
) -> tuple[Vector, Vector, float, Pending]:
    """Return position, drift, heading and pending turn, mirrored to a counter-clockwise orbit.

    sense: of the orbit that is flown: +1 counter-clockwise, -1 clockwise. The turn rate that a law
        computes from the mirrored values must be multiplied by it.
    """
    return (
        mirrored_pair(p, sense),
        mirrored_pair(d, sense),
        psi * sense,
        pending._replace(turn=pending.turn * sense),
    )
