"""`drift`: guidance on the relative motion (position relative to the target and drift), not only on its length.

A vector field of ground courses with the drift taken out by the wind triangle (Lyapunov vector fields: Lawrence,
Frew, Pisano 2008; wind: Frew 2007), followed with the field's own rotation as feedforward. Unlike exact linearisation
of r it has no singular heading and can never ask for a closing speed that the wind forbids.

All of this is for a counter-clockwise orbit, omega > 0 to the left; `mirrored` gives the clockwise one.
"""

from math import pi
from typing import NamedTuple

from circnav_mav.guidance.lap_plan import Lap
from circnav_mav.guidance.maths import (
    Array,
    Number,
    Pair,
    arccos,
    arcsin,
    arctan2,
    chord_parts,
    clip,
    cos,
    hypot,
    maximum,
    minimum,
    sin,
    sqrt,
    where,
    wrap,
)
from circnav_mav.guidance.pending_turn import Pending

STEP = 0.05
"""Half the interval of the central difference of the field along the path, s."""
REACHABLE = 0.98
"""Largest sine of the drift angle: above it the ground course cannot be held, and the nose points nearly across."""
CROSSOVER = 0.85
"""Crossover of the heading loop times the whole delay. What is under way is taken off, so only what the model of the
delay leaves is felt: over the plants of real vehicles, delays known to a fifth, the gain margin stays above 6 dB and
the phase margin above 45 deg (tests/guidance/test_margins.py)."""
SETTLING_SHARE = 0.95
"""Highest crossover in units of how fast the vehicle's answer settles: near its own frequency an inner loop that rings
is louder than its delay tells."""
FASTEST = 1.8
"""Highest crossover, rad/s: a quicker radius loop follows ranges of .5 m at 10 Hz that tell nothing."""
RADIAL_SHARE = 0.4
"""Radius loop over heading loop: of all shares at these margins, two fifths hold slow errors down most: wind and
turbulence push the radius below .4 rad/s, as flown on ArduPlane 4.6.3."""
OUTWARD = 0.5 * pi
"""How much longer, rad, a turn may be than one the other way because it leads away from the target, not past it."""


class DriftGains(NamedTuple):
    """heading: of the heading error, 1/s. radial: slope of the inward course angle at the circle, rad/m."""

    heading: Array
    radial: Array


def drift_gains(V: Number, delay: Number, settles: Number, share: Number = 1.0) -> DriftGains:
    """The gains at speed V (m/s) of a vehicle that answers after `delay` (s; all of link, autopilot and airframe) and
    settles so fast (1/s). share: of the gains that the rule gives, where the command was found swinging."""
    most = minimum(SETTLING_SHARE * settles, FASTEST)
    crossover = share * minimum(CROSSOVER / maximum(delay, 1e-3), most)
    # the feedforward of the field's own rotation ahead adds radial V (1 + heading delay) to the heading loop
    heading = crossover / (1 + 1.5 * RADIAL_SHARE)
    return DriftGains(heading, RADIAL_SHARE * heading / V)


def inward_angle(r: Number, *, r_d: Number, k: Number, sharpest: Number) -> Array:
    """Angle of the ground course inward of the circle's tangent, rad.

    k (r - r_d) near the circle; far outside the straight line that touches the circle, acos(r_d/r); far inside the
    tightest turn that touches it from within, where `sharpest` is that turn's curvature, 1/m.
    """
    e = r - r_d
    line = arccos(minimum(r_d / maximum(r, 1e-6), 1.0))
    turn = minimum(sqrt(2 * maximum(-e, 0.0) * maximum(sharpest - 1 / r_d, 0.1 / r_d)), 0.5 * pi)
    most = where(e > 0, line, turn)
    return k * e * most / sqrt(most**2 + (k * e) ** 2 + 1e-12)


def field_heading(
    p: Pair, d: Pair, *, V: Number, r_d: Number, k: Number, max_turn_rate: Number, lap: Lap | None = None
) -> Array:
    """Heading (rad) whose ground course follows the field at p (2, ...), drift d (2, ...), true airspeed V. lap: flown
    in the place of the circle."""
    r, angle, outward = hypot(p[0], p[1]), arctan2(p[1], p[0]), 0.0
    if lap is not None:
        r_d, slope = lap.at(angle)
        outward = arctan2(slope, r_d)
    sharpest = max_turn_rate / (V + hypot(d[0], d[1]))
    course = angle + pi / 2 - outward + inward_angle(r, r_d=r_d, k=k, sharpest=0.7 * sharpest)
    across = cos(course) * d[1] - sin(course) * d[0]
    return course - arcsin(clip(across / V, -REACHABLE, REACHABLE))


def drift(
    p: Pair, d: Pair, psi: Number, pending: Pending, *, V: Number, r_d: Number, max_turn_rate: Number,
    gains: DriftGains, change: Pair = (0.0, 0.0), lap: Lap | None = None,
) -> Array:  # fmt: skip
    """Turn rate (rad/s): the field's rotation, seen as far ahead as the vehicle's answer takes, plus the heading error
    times its gain, of which what is already under way is taken off. Outside the circle it turns away from the target
    rather than past it.

    p = vehicle - target (2, ...), m. d = wind - target velocity (2, ...), m/s. psi: heading, rad. pending: what is
    commanded but not turned yet. V: true airspeed, m/s. change: of d (2, ...), m/s^2. Condition: W < V; and r_d >=
    (V + W)^2/(V max_turn_rate), or a lap that is flown instead.
    """
    ahead, rate = pending.ahead, pending.turn / maximum(pending.ahead, STEP)

    def wanted(time: Number) -> Array:
        x, y = chord_parts(V, psi, rate * time, time)
        there = p[0] + d[0] * time + x, p[1] + d[1] * time + y
        then = d[0] + change[0] * time, d[1] + change[1] * time
        return field_heading(there, then, V=V, r_d=r_d, k=gains.radial, max_turn_rate=max_turn_rate, lap=lap)

    now, late = wanted(0.0 * ahead), wanted(ahead + STEP)
    turns = wrap(late - wanted(ahead - STEP))
    # under way is what was commanded beyond the rotation meanwhile: its mean, for in wind it changes round the lap
    under_way = pending.turn - wrap(late - turns / 2 - now)
    # a turn the other way would first have to undo what is under way
    favoured = _outward(hypot(p[0], p[1]), V / max_turn_rate, r_d) + pending.turn
    error = wrap(now - psi - favoured) + favoured
    return turns / (2 * STEP) + gains.heading * (error - under_way)


def _outward(r: Number, turn_radius: Number, r_d: Number) -> Array:
    """By how much a left turn, away from the target, is favoured over a right turn, rad. In full where half a turn to
    the right ends inside the circle; none one turn radius farther out, and none inside .9 r_d."""
    beyond = clip((r_d + 3 * turn_radius - r) / turn_radius, 0.0, 1.0)
    outside = clip((r - 0.9 * r_d) / (0.1 * r_d), 0.0, 1.0)
    return OUTWARD * beyond * outside


def orbit_turn_rate(d: Pair, psi: Number, *, V: Number, r_d: Number) -> Array:
    """Turn rate (rad/s) that stays on the counter-clockwise circle in drift d (2, ...), m/s, at heading psi, rad.

    The heading alone tells where on the circle a vehicle is: no range is used. chi' = v_g/r_d for the ground course,
    psi' = chi' v_g/(V cos(psi - chi)) by the wind triangle; V/r_d in still air. Condition: |d| < V.
    """
    v = V * cos(psi) + d[0], V * sin(psi) + d[1]
    ground = maximum(hypot(v[0], v[1]), 1e-9)
    across = (v[0] * d[1] - v[1] * d[0]) / ground
    along_nose = V * sqrt(1 - clip(across / V, -REACHABLE, REACHABLE) ** 2)
    return ground**2 / (r_d * along_nose)


def mirrored_pair(pair: Pair, sense: Number) -> tuple[Array, Array]:
    """A vector (2, ...) seen so that the orbit is counter-clockwise."""
    return pair[0], pair[1] * sense


def mirrored(p: Pair, d: Pair, psi: Number, pending: Pending, sense: Number) -> tuple[Pair, Pair, Array, Pending]:
    """The same situation seen so that the orbit is counter-clockwise; sense: +1 counter-clockwise, -1 clockwise.

    The turn rate that follows is multiplied by sense on the way out.
    """
    return mirrored_pair(p, sense), mirrored_pair(d, sense), psi * sense, pending._replace(turn=pending.turn * sense)
