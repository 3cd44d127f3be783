"""Limits of an autopilot below those of the mission: the bank of a plane, the lean of a copter.

Both limits are found in flight. A vehicle at its limit banks or leans less than the command
requires, and keeps this smaller angle.
"""

from math import atan, exp, inf, pi, radians, remainder

from circnav_mav.guidance.types import GRAVITY, LONGEST_REPORT_GAP, OwnMotion
from circnav_mav.timers import Hysteresis, LowPass

SHORT = 0.95
"""A plane is limited if it turns less than this share of the commanded turn. A copter is limited if
its thrust acceleration is below this share of the required one. Both are smoothed
over 1 s. A smaller deficit may result from the response lag, or from the error of the fit in
turns."""
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
    part of the circle. The heading does not show this. The lean is at its limit if the copter leans
    less than its velocity requires, keeps this lean steady, and has hardly leaned more before.

    short: True if the copter leans less than required now, and has hardly leaned more before.
    found: thrust acceleration (horizontal acceleration by the lean) at the limit, m/s^2; inf while
        unknown.
    share: factor on the commanded speed. It is lowered each time that the lean is at its limit.
    """

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
    EVERY = 2.0
    """Least time between two reductions of the speed, s. The velocity loop needs 1 to 2 s to use
    the lean that a reduction makes available."""
    LOWERED = 0.95
    """Factor on the speed each time that the lean is at its limit."""

    def __init__(self) -> None:
        self.short = False
        self.found = inf
        self.share = 1.0
        # 1.0: time constant of the low-pass on the thrust acceleration, s. The low-pass suppresses
        # single gusts.
        self._thrust_acceleration = LowPass(1.0)
        self._required = LowPass(1.0)
        self._most = 0.0
        """Largest smoothed lean so far, rad."""
        self._steady = Hysteresis(raise_after=STEADY_FOR)
        self._stood: tuple[float, float] | None = None
        """Steady lean, rad, and the time from which it is a limit, s."""

    def update(
        self, now: float, step: float, thrust_acceleration: float, required: float | None
    ) -> None:
        """Process a report, while the copter follows its commands.

        step: time since the report before, s.
        thrust_acceleration: flown, m/s^2.
        required: thrust acceleration that the velocity requires, m/s^2; None while it is unknown.
        """
        smooth = self._thrust_acceleration.update(thrust_acceleration, step)
        lean = atan(smooth / GRAVITY)
        self._most = max(self._most, lean)
        if required is None:
            return
        misses = smooth < SHORT * self._required.update(required, step)
        self.short = misses and lean > self.NEAR_MOST * self._most
        is_steady = abs(atan(thrust_acceleration / GRAVITY) - lean) < self.STEADY
        if not self._steady.update(self.short and is_steady, now):
            return
        # In gusts a lean may be steady once by chance. At a limit the lean stays steady, or becomes
        # steady again at the same angle.
        if self._stood is None or abs(lean - self._stood[0]) > self.STEADY:
            self._stood = (lean, now + self.AGAIN)
        elif now >= self._stood[1]:
            self.found = smooth
            self.share = max(self.LOWERED * self.share, 0.5)
            self._stood = (lean, now + self.EVERY)
