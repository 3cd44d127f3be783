"""Limits of an autopilot below those of the mission: the bank of a plane, the lean of a copter.

Both limits are found in flight. A vehicle at its limit banks or leans less than the command
requires, and keeps this smaller angle.
"""

from cmath import rect
from math import atan, exp, inf, pi, radians, remainder

from circnav_mav.guidance.recursive_least_squares import RecursiveLeastSquares
from circnav_mav.guidance.types import GRAVITY, LONGEST_REPORT_GAP, OwnMotion

SHORT = 0.95
"""A plane is limited if it turns less than this share of the commanded turn. A copter is limited if
its push is below this share of the required push. Both are smoothed over 1 s. A smaller deficit
may result from the response lag, or from the error of the fit in turns."""
STEADY_FOR = 1.0
"""Least duration, s, for which a bank or lean must be steady before it can be a limit. A bank that
still changes is no limit."""


class BankLimit:
    """Bank limit of a plane's autopilot. At the limit the bank stays constant, below the commanded
    bank.

    short: True if the plane banks less than commanded now.
    bank: coordinated turn rate at the limit, rad/s; inf while unknown.
    turn: turn rate of the nose at the limit, rad/s; inf while unknown.
    """

    STEADY = 0.03
    """Largest difference of a steady bank from its mean over 1 s, as a share of this mean."""
    AVERAGED = 20.0
    """Time constant, s, of the averaged turn rates of bank and nose at the bank limit. An error of
    1 % in these turn rates causes 0.3 m of radius error."""

    def __init__(self) -> None:
        self.short = False
        self._time = inf
        self._heading = 0.0
        self._steady_since = inf
        self._forget()

    def _forget(self) -> None:
        self._stood = 0.0
        """Time at the limit, s."""
        self._banked = 0.0
        self._turned = 0.0
        """Turn that belongs to the bank, and turn of the nose, during the time at the limit,
        rad."""

    @property
    def bank(self) -> float:
        return self._banked / self._stood if self._stood >= 0.5 else inf

    @property
    def turn(self) -> float:
        return self._turned / self._stood if self._stood >= 0.5 else inf

    def follow(self, own: OwnMotion, commanded: float, banked: float) -> None:
        """Update with a report.

        commanded: commanded turn rate, smoothed over 1 s, rad/s.
        banked: coordinated turn rate of the bank, smoothed over 1 s, rad/s.
        """
        bank_turn = own.bank_turn or 0.0
        step = own.time - self._time
        turned = abs(remainder(own.heading - self._heading, 2 * pi))
        self._time = own.time
        self._heading = own.heading
        self.short = abs(banked) < SHORT * abs(commanded)
        is_steady = abs(bank_turn - banked) < self.STEADY * abs(banked)
        if not (self.short and banked * commanded > 0 and is_steady):
            self._steady_since = own.time
        self._steady_since = min(self._steady_since, own.time)
        # Commands may exceed the found limit. A bank above the found limit shows that this limit
        # is too low: search for it again.
        if abs(banked) > (1 + self.STEADY) * self.bank:
            self._forget()
        elif own.time - self._steady_since >= STEADY_FOR and 0 < step <= LONGEST_REPORT_GAP:
            keep = exp(-step / self.AVERAGED)
            self._stood = keep * self._stood + step
            self._banked = keep * self._banked + abs(bank_turn) * step
            self._turned = keep * self._turned + turned


class LeanLimit:
    """Lean limit of a copter's autopilot, and the share of the speed that it allows.

    A copter leans against the air that it flies through: at ground speed V against a wind W it
    needs the lean for V + W. If its autopilot allows less, the ground speed drops on the upwind
    part of the circle. The heading does not show this.

        push = kappa v + b + v',   least squares of kappa and b (complex; earth frame)

    push: horizontal acceleration by the lean. v: velocity that the copter should have. kappa: drag
    (1/s); its imaginary part is a push fixed to the nose (a trimmed attitude). b: push of the wind.
    The lean is at its limit if the copter leans less than the fit requires, keeps this lean steady,
    and has hardly leaned more before.

    found: push at the limit, m/s^2; inf while unknown.
    share: factor on the commanded speed. It is lowered each time that the lean is at its limit.
    """

    MEMORY = 60.0
    """Time constant of the least squares, s: more than a lap, to separate wind from drag."""
    SMOOTHING = 1.0
    """Time constant of the low-pass on the lean, s. The low-pass suppresses single gusts."""
    STEADY = radians(1.5)
    """Largest difference of a steady lean from its mean over a second, rad. PX4's estimate of the
    lean varies by 1 deg RMS within seconds."""
    AGAIN = 3.0
    """Least time, s, from the first steady lean to a steady lean at the same angle that confirms a
    limit."""
    NEAR_MOST = 0.93
    """A lean at its limit is at least this share of the largest lean so far. With 0.8, a limit of
    11 deg was found on a circle of 10 m radius in wind. The copter had leaned 12 deg one lap
    before."""
    LOWERED = 0.95
    """Factor on the speed each time that the lean is at its limit."""
    EVERY = 2.0
    """Least time between two reductions of the speed, s. The velocity loop needs 1 to 2 s to use
    the lean that a reduction makes available."""

    def __init__(self) -> None:
        self.found = inf
        self.share = 1.0
        self._fit = RecursiveLeastSquares(self.MEMORY)
        self._time = inf
        self._turned = 0.0
        self._push = 0.0
        self._required = 0.0
        """Magnitudes of push and required push, smoothed, m/s^2."""
        self._most = 0.0
        """Largest smoothed lean so far, rad."""
        self._steady_since = inf
        self._lowered_at = -inf
        self._stood: tuple[float, float] | None = None
        """First steady lean, rad, and its time, s."""

    def follow(self, own: OwnMotion) -> None:
        """Update with a report, while the copter follows its commands.

        own: motion with the velocity that the copter should have.
        """
        if own.push is None:
            return
        push = complex(*own.push)
        step = own.time - self._time
        self._time = own.time
        if not 0 < step <= LONGEST_REPORT_GAP:
            self._steady_since = inf
            self._push = abs(push)
            self._required = abs(push)
            return
        v = rect(own.airspeed, own.heading)
        turn = 1j * own.turn_rate * v
        keep = exp(-step / self.SMOOTHING)
        self._push = abs(push) + keep * (self._push - abs(push))
        required = abs(self._straight_push(v) + turn)
        self._required = required + keep * (self._required - required)
        # Before a full turn the fit cannot separate drag from wind.
        short = self._turned >= 2 * pi and self._push < SHORT * self._required
        lean = atan(self._push / GRAVITY)
        is_steady = abs(atan(abs(push) / GRAVITY) - lean) < self.STEADY
        if not (short and is_steady and lean > self.NEAR_MOST * self._most):
            self._steady_since = inf
        else:
            self._steady_since = min(self._steady_since, own.time)
        self._turned += abs(own.turn_rate) * step
        self._most = max(self._most, lean)
        if not short:  # a limited push does not show drag and wind
            self._fit.add(v, push - turn, step, step)
        self._judge(own.time, lean)

    def _judge(self, now: float, lean: float) -> None:
        """Lower the speed if the lean stays at its limit."""
        if now - self._steady_since < STEADY_FOR or now - self._lowered_at < self.EVERY:
            return
        # In gusts a lean may be steady once by chance. At a limit the lean stays steady, or becomes
        # steady again at the same angle.
        if self._stood is None or abs(lean - self._stood[0]) > self.STEADY:
            self._stood = (lean, now)
        elif now - self._stood[1] >= self.AGAIN:
            self.found = self._push
            self.share = max(self.LOWERED * self.share, 0.5)
            self._lowered_at = now

    def _straight_push(self, v: complex) -> complex:
        """Return the push that the fit requires at a velocity in straight flight, m/s^2."""
        fit = self._fit
        if fit.n == 0:
            return 0j
        # The prior, a drag of 0 with a weight of 1 m^2/s, keeps the fit defined on a straight path.
        kappa = fit.product() / (fit.spread() + 1.0)
        return complex(fit.y / fit.n + kappa * (v - fit.x / fit.n))
