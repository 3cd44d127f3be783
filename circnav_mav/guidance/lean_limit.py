"""Finds the lean beyond which a copter does not go, as `turn_response.BankLimit` finds a plane's bank.

A copter leans against the air that it flies through: at V against a wind W it needs the lean for V + W. Where its
autopilot allows less, its speed over the ground sags there, which no heading shows.

    push = kappa v + b + v',   least squares of kappa and b (complex; earth frame)

push: horizontal acceleration by the lean. v: velocity that the copter should have. kappa: drag (1/s) and, as an
imaginary part, what is fixed to the nose (a trimmed attitude). b: the wind's. The lean is at its limit where the copter
leans less than this asks for, holds that lean, and has never leant more.
"""

from cmath import rect
from math import atan, exp, inf, pi, radians
from typing import NamedTuple

from circnav_mav.guidance.types import OwnMotion

GRAVITY = 9.80665
"""m/s^2."""
MEMORY = 60.0
"""Time constant of the least squares, s: more than a lap tells wind from drag."""
SMOOTHING = 1.0
"""Time constant, s, over which leans are averaged: a gust that passes is no limit."""
LEARNT_AFTER = 2 * pi
"""Turn, rad, after which the least squares are believed: half a lap cannot tell drag from wind."""
PRIOR = 1.0
"""Weight of no drag, m^2/s: keeps the fit defined on a straight way."""
SHORT = 0.95
"""Share of the lean asked for below which a copter leans too little: the fit is a few percent off in turns."""
STANDS, STANDS_FOR = radians(1.5), 1.0
"""A lean stands where it differs by less than this from its mean over a second, rad, for so long, s. PX4's estimate of
it wanders by 1 deg rms within seconds."""
AGAIN = 3.0
"""Time, s, after which the same lean must stand again, or still."""
NEAR_MOST = radians(2.5)
"""Lean below the largest one seen so far, rad, at which a limit may still be: farther below, it is none."""
LONGEST_STEP = 0.5
"""Gap between two reports, s, that is not counted."""
LOWERED, EVERY, LEAST = 0.95, 2.0, 0.5
"""What is left of the speed after it was found at its limit, how often it is lowered, s, and the least of it: the loop
that holds the velocity needs 1 to 2 s to make use of the lean that this frees."""


class LeanLimit(NamedTuple):
    """State after a report. time: s. turned: rad. sums: of the least squares. push: smoothed, as a size, m/s^2.
    asked: smoothed size of what the fit asks for. most: largest lean, rad. since: when the copter last leant as asked,
    s. found: push of the limit, m/s^2; inf while none is known. share: of the speed that the limit allows. lowered_at:
    s. stood, stood_at: lean that stood first, rad, and when, s."""

    time: float = inf
    turned: float = 0.0
    sums: tuple[complex, ...] = (0j,) * 5
    push: float = 0.0
    asked: float = 0.0
    most: float = 0.0
    since: float = inf
    found: float = inf
    share: float = 1.0
    lowered_at: float = -inf
    stood: float = 0.0
    stood_at: float = -inf

    def follow(self, own: OwnMotion) -> "LeanLimit":
        """Take in a report of a copter that flies as commanded, with the velocity that it should have."""
        if own.push is None:
            return self
        v, push, step = rect(own.airspeed, own.heading), complex(*own.push), own.time - self.time
        if not 0 < step <= LONGEST_STEP:
            return self._replace(time=own.time, since=inf, push=abs(push), asked=abs(push))
        turn = 1j * own.turn_rate * v
        kept = exp(-step / SMOOTHING)
        size = abs(push) + kept * (self.push - abs(push))
        asked = abs(self._asked(v) + turn)
        asked += kept * (self.asked - asked)
        short = self.turned >= LEARNT_AFTER and size < SHORT * asked
        lean = atan(size / GRAVITY)
        stands = short and abs(atan(abs(push) / GRAVITY) - lean) < STANDS and lean > self.most - NEAR_MOST
        after = self._replace(
            time=own.time, turned=self.turned + abs(own.turn_rate) * step, push=size, asked=asked,
            most=max(self.most, lean), since=min(self.since, own.time) if stands else inf,
            # a push that was cut says nothing of drag and wind
            sums=self.sums if short else self._learnt(v, push - turn, step),
        )  # fmt: skip
        if own.time - after.since < STANDS_FOR or own.time - self.lowered_at < EVERY:
            return after
        # In gusts a lean may stand once by chance. At a limit it does again, at the same angle, or for longer.
        if abs(lean - self.stood) > STANDS or own.time - self.stood_at < AGAIN:
            return after if abs(lean - self.stood) <= STANDS else after._replace(stood=lean, stood_at=own.time)
        return after._replace(found=size, share=max(LOWERED * self.share, LEAST), lowered_at=own.time)

    def _learnt(self, v: complex, push: complex, step: float) -> tuple[complex, ...]:
        now = (1.0, v, push, abs(v) ** 2, v.conjugate() * push)
        keep = exp(-step / MEMORY)
        return tuple(old * keep + new * step for old, new in zip(self.sums, now, strict=True))

    def _asked(self, v: complex) -> complex:
        """Push that the fit asks for at a velocity, without that of a turn."""
        n, mean_v, mean_push, square, product = self.sums
        if n == 0:
            return 0j
        mean_v, mean_push = mean_v / n, mean_push / n
        spread = (square - n * abs(mean_v) ** 2).real
        kappa = (product - n * mean_v.conjugate() * mean_push) / (spread + PRIOR)
        return mean_push + kappa * (v - mean_v)
