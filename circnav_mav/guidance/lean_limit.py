"""Detection of a copter's lean limit, the counterpart of `bank_limit` for planes.

A copter leans against the air that it flies through: at ground speed V against a wind W it needs
the lean for V + W. If its autopilot allows less, the ground speed drops there. The heading does not
show this.

    push = kappa v + b + v',   least squares of kappa and b (complex; earth frame)

push: horizontal acceleration by the lean. v: velocity that the copter should have. kappa: drag
(1/s); its imaginary part is a push fixed to the nose (a trimmed attitude). b: push of the wind. The
lean is at its limit if the copter leans less than the fit requires, holds that lean, and has never
leaned more.
"""

from cmath import rect
from math import atan, exp, inf, pi, radians
from typing import NamedTuple

from circnav_mav.guidance.types import OwnMotion

GRAVITY = 9.80665
"""Standard gravity, m/s^2."""
MEMORY = 60.0
"""Time constant of the least squares, s: more than a lap, to separate wind from drag."""
SMOOTHING = 1.0
"""Time constant of the low-pass on the lean, s. It suppresses single gusts."""
LEARNT_AFTER = 2 * pi
"""Turn, rad, after which the least squares are used: half a lap cannot separate drag from wind."""
PRIOR = 1.0
"""Weight of the prior (a drag of 0), m^2/s. The prior keeps the fit defined on a straight path."""
SHORT = 0.95
"""Share of the required push below which a copter leans too little: the fit has a few percent of
error in turns."""
STEADY = radians(1.5)
STEADY_FOR = 1.0
"""A steady lean: largest difference from its mean over a second, rad, and least duration, s. PX4's
estimate of the lean varies by 1 deg RMS within seconds."""
AGAIN = 3.0
"""Time, s, from the first steady lean. After it, the lean must still, or again, be steady at the
same angle."""
NEAR_MOST = radians(2.5)
"""Largest difference, rad, by which a lean at its limit may be below the largest lean so far."""
LONGEST_STEP = 0.5
"""Longest gap between two reports, s. Longer ones are not counted."""
LOWERED = 0.95
EVERY = 2.0
LEAST = 0.5
"""Reduction of the speed at the lean limit: factor of each step, time between steps, s, and least
share of the speed. The velocity loop needs 1 to 2 s to use the lean that a step makes available."""


class LeanLimit(NamedTuple):
    """State after a report. time: s. turned: turn so far, rad. sums: of the least squares. push:
    smoothed magnitude, m/s^2. asked: smoothed magnitude required by the fit, m/s^2. most: largest
    lean, rad. since: start of the steady lean, s; inf without one. found: push at the limit, m/s^2;
    inf while unknown. share: allowed share of the speed. lowered_at: time of the last reduction, s.
    stood, stood_at: first steady lean, rad, and its time, s."""

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
        """Return the state after a report, while the copter follows its commands.

        own: motion with the velocity that the copter should have.
        """
        if own.push is None:
            return self
        v = rect(own.airspeed, own.heading)
        push = complex(*own.push)
        step = own.time - self.time
        if not 0 < step <= LONGEST_STEP:
            return self._replace(time=own.time, since=inf, push=abs(push), asked=abs(push))
        turn = 1j * own.turn_rate * v
        kept = exp(-step / SMOOTHING)
        size = abs(push) + kept * (self.push - abs(push))
        asked = abs(self._asked(v) + turn)
        asked += kept * (self.asked - asked)
        short = self.turned >= LEARNT_AFTER and size < SHORT * asked
        lean = atan(size / GRAVITY)
        steady = (
            short
            and abs(atan(abs(push) / GRAVITY) - lean) < STEADY
            and lean > self.most - NEAR_MOST
        )
        after = self._replace(
            time=own.time, turned=self.turned + abs(own.turn_rate) * step, push=size, asked=asked,
            most=max(self.most, lean), since=min(self.since, own.time) if steady else inf,
            # A limited push does not show drag and wind.
            sums=self.sums if short else self._learnt(v, push - turn, step),
        )  # fmt: skip
        if own.time - after.since < STEADY_FOR or own.time - self.lowered_at < EVERY:
            return after
        # In gusts a lean may be steady once by chance. At a limit it is steady again at the same
        # angle, or stays steady.
        if abs(lean - self.stood) > STEADY or own.time - self.stood_at < AGAIN:
            return (
                after
                if abs(lean - self.stood) <= STEADY
                else after._replace(stood=lean, stood_at=own.time)
            )
        return after._replace(
            found=size, share=max(LOWERED * self.share, LEAST), lowered_at=own.time
        )

    def _learnt(self, v: complex, push: complex, step: float) -> tuple[complex, ...]:
        now = (1.0, v, push, abs(v) ** 2, v.conjugate() * push)
        keep = exp(-step / MEMORY)
        return tuple(old * keep + new * step for old, new in zip(self.sums, now, strict=True))

    def _asked(self, v: complex) -> complex:
        """Return the push that the fit requires at a velocity in straight flight, m/s^2."""
        n, mean_v, mean_push, square, product = self.sums
        if n == 0:
            return 0j
        mean_v = mean_v / n
        mean_push = mean_push / n
        spread = (square - n * abs(mean_v) ** 2).real
        kappa = (product - n * mean_v.conjugate() * mean_push) / (spread + PRIOR)
        return mean_push + kappa * (v - mean_v)
