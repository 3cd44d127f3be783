"""The path through the air, from heading, turn rate and airspeed that come at their own times."""

from collections import deque
from dataclasses import dataclass, replace
from typing import NamedTuple

from circnav_mav.guidance import floats
from circnav_mav.guidance.air_path import chord_parts, wrap
from circnav_mav.guidance.types import FeltVelocity, OwnMotion

KEPT = 64
"""Reports kept: more than a second at the fastest rate, and ranges are younger than that."""
EXTRAPOLATED = 0.5
"""Longest time, s, that the newest report is carried on by its turn rate."""
HOLE = 3.0
"""A longer silence, s, breaks the path: where the vehicle went meanwhile is not known."""


class FeltStep(NamedTuple):
    """What was felt over a step, see `relative_ekf.Felt`: change of the velocity, of the air velocity by nose and
    airspeed, m/s, integral of the nose, s, and airspeed times turn rate, m/s^2."""

    change: tuple[float, float]
    air: tuple[float, float]
    nose: tuple[float, float]
    across: float


@dataclass(frozen=True, slots=True)
class Knot:
    """A report and how far the path had come: x, y in m at the measured airspeed. piece: counts the holes before.
    nose_x, nose_y: integral of the unit vector of the nose, s. report: the newest report that it is made from, for
    accelerations are not carried on."""

    motion: OwnMotion
    x: float
    y: float
    piece: int
    nose_x: float = 0.0
    nose_y: float = 0.0
    report: OwnMotion | None = None

    def felt_since(self, before: "Knot") -> FeltStep | None:
        """What was felt from a knot to this one; None where the accelerations do not cover it."""
        new, old = self.report or self.motion, before.report or before.motion
        if new.felt is None or old.felt is None or new.felt.since != old.felt.since:
            return None
        (x, y), (old_x, old_y) = (_along(m.heading, m.airspeed) for m in (new, old))
        return FeltStep(
            (new.felt.x - old.felt.x, new.felt.y - old.felt.y),
            (x - old_x, y - old_y),
            (self.nose_x - before.nose_x, self.nose_y - before.nose_y),
            new.airspeed * new.turn_rate,
        )


class OwnPath:
    """Integrates arcs between reports. Late and repeated reports are dropped; a hole starts a new piece of path."""

    def __init__(self) -> None:
        self._knots: deque[Knot] = deque(maxlen=KEPT)

    def move(self, motion: OwnMotion) -> None:
        """Take in a report."""
        if not self._knots:
            self._knots.append(Knot(motion, 0.0, 0.0, 0))
            return
        last = self._knots[-1]
        step = motion.time - last.motion.time
        if step <= 0:
            return
        if step > HOLE:
            self._knots.append(Knot(motion, last.x, last.y, last.piece + 1))
            return
        turned = float(wrap(motion.heading - last.motion.heading))
        x, y = _arc(last, (last.motion.airspeed + motion.airspeed) / 2, turned, step)
        self._knots.append(Knot(motion, x, y, last.piece, *_nose(last, turned, step)))

    def at(self, time: float) -> Knot | None:
        """Where the path was, or will soon be; None outside of what is known."""
        if not self._knots:
            return None
        newest = self._knots[-1]
        ahead = time - newest.motion.time
        if ahead >= 0:
            if ahead > EXTRAPOLATED:
                return None
            carried = _carried(newest, newest.motion.turn_rate * ahead, ahead)
            return replace(carried, nose_x=newest.nose_x, nose_y=newest.nose_y, report=newest.motion)
        for after, before in zip(reversed(self._knots), list(self._knots)[-2::-1], strict=False):
            if before.motion.time <= time:
                return _between(before, after, time) if before.piece == after.piece else None
        return None


def _between(before: Knot, after: Knot, time: float) -> Knot:
    step = time - before.motion.time
    share = step / (after.motion.time - before.motion.time)
    turned = float(wrap(after.motion.heading - before.motion.heading)) * share
    airspeed = (before.motion.airspeed + after.motion.airspeed) / 2
    knot = _carried(
        before, turned, step, airspeed, after.motion.turn_rate * share + before.motion.turn_rate * (1 - share)
    )
    new, old = after.motion.felt, before.motion.felt
    if new is None or old is None or new.since != old.since:
        return knot
    felt = FeltVelocity(old.x + share * (new.x - old.x), old.y + share * (new.y - old.y), new.since)
    return replace(knot, motion=replace(knot.motion, felt=felt))


def _carried(knot: Knot, turned: float, step: float, airspeed: float | None = None, rate: float | None = None) -> Knot:
    """The knot after `step` seconds along an arc through the angle `turned`."""
    m = knot.motion
    V = m.airspeed if airspeed is None else airspeed
    x, y = _arc(knot, V, turned, step)
    motion = OwnMotion(m.time + step, m.heading + turned, m.turn_rate if rate is None else rate, V)
    return Knot(motion, x, y, knot.piece, *_nose(knot, turned, step))


def _nose(knot: Knot, turned: float, step: float) -> tuple[float, float]:
    """The integral of the nose's direction at the end of the arc, its middle standing for it."""
    x, y = _along(knot.motion.heading + turned / 2, step)
    return knot.nose_x + x, knot.nose_y + y


def _along(angle: float, length: float) -> tuple[float, float]:
    return length * floats.cos(angle), length * floats.sin(angle)


def _arc(knot: Knot, V: float, turned: float, step: float) -> tuple[float, float]:
    """Where the arc ends."""
    x, y = chord_parts(V, knot.motion.heading, turned, step, floats)
    return knot.x + x, knot.y + y
