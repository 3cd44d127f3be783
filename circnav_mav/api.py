"""Guidance for your own control loop (a ROS node, a notebook): ranges and own motion in, turn rates
out. No MAVLink.

The names in `circnav_mav.__all__` are stable: import them from `circnav_mav`. SI units, radians.
Frame: x right, y up, turn rates and headings counter-clockwise positive. Time is an argument, in
seconds of any clock.
"""

from collections.abc import Iterable
from math import inf, isfinite, pi
from typing import Any

from circnav_mav.guidance.closed_loop import ClosedLoop
from circnav_mav.guidance.estimators.interface import Estimator, EstimatorSettings
from circnav_mav.guidance.estimators.table import ESTIMATORS, default_estimator
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.own_code import NameTable
from circnav_mav.guidance.step import LawChoice
from circnav_mav.guidance.tuning import LawTuning
from circnav_mav.guidance.types import (
    SAME_TIME,
    Direction,
    Orbit,
    OwnLaw,
    OwnMotion,
    RangeEstimate,
    RangeSample,
    TurnCommand,
)
from circnav_mav.guidance.vehicle_model import VehicleModel

LONGEST_GAP = 60.0
"""Longest gap between ranges, s, over which an estimate is predicted. After a longer gap the
estimate starts again."""
LONGEST_LAG = 10.0
"""Longest delay of a vehicle's turn, s, as in missions. A larger value was probably meant in ms."""


def tune(
    orbit: Orbit,
    law: str = "auto",
    *,
    turn_lag: float = 0.4,
    sigma: float = 0.5,
    rate: float = 10.0,
) -> LawChoice:
    """Return a law with the default gain of a mission.

    turn_lag: delay from a command to its turn, s.
    sigma: standard deviation of a range, m.
    rate: rate of the ranges, Hz.

    Raises ValueError for an unknown law, and for a value that is impossible for a vehicle or radio.
    """
    _known("law", law, LAWS)
    _check_circle(orbit)
    _check_lag(turn_lag)
    _check_above_zero("sigma", sigma)
    _check_above_zero("rate", rate)
    settings = EstimatorSettings(orbit.speed, orbit.max_turn_rate)
    return LawTuning(law, settings, turn_lag, sigma, 1 / rate).choice(orbit)


class Guidance:
    """Guidance of one vehicle. It stores ranges, commands and the learned response: use one per
    flight."""

    def __init__(
        self,
        orbit: Orbit,
        law: str | LawChoice | OwnLaw = "auto",
        estimator: str | Estimator | None = None,
        *,
        turn_lag: float = 0.4,
        stale: float = 0.5,
        coast: float = 0.0,
    ) -> None:
        """law: name, result of `tune`, or your function. The name of a user-defined law is an entry
            point or `module:name`.
        estimator: name, or your object. None: the default estimator of the law.
        turn_lag: delay from a command to its turn, s.
        stale: age of the newest range, s, above which the law does not steer.
        coast: time after `stale`, s, in which the turn rate of the circle is commanded, corrected
            for the estimated drift.

        Raises ValueError for an unknown name, and for a value that is impossible for a vehicle.
        """
        _check_circle(orbit)
        _check_lag(turn_lag)
        for name, value in (("stale", stale), ("coast", coast)):
            if not value >= 0:
                raise ValueError(f"{name}: must be at least 0 s, not {value:g}")
        if isinstance(law, str):
            law = tune(orbit, law, turn_lag=turn_lag)
        name = ""
        if isinstance(law, LawChoice):
            _known("law", law.name, LAWS)
            name = law.name
            turn_lag = law.lag
            _check_lag(turn_lag)
        self._loop = ClosedLoop(orbit, law, VehicleModel(turn_lag, orbit.max_turn_rate))
        self._stale = stale
        self._coast = coast
        wanted = estimator or default_estimator(name)
        if isinstance(wanted, str):
            _known("estimator", wanted, ESTIMATORS)
            wanted = ESTIMATORS[wanted](EstimatorSettings(orbit.speed, orbit.max_turn_rate))
        self._estimator = wanted
        self._newest: RangeSample | None = None

    def update_range(self, sample: RangeSample) -> bool:
        """Add a range. Return True if it was accepted, False for an outlier or an invalid
        sample."""
        # Radios and ROS drivers report NaN, an infinity, 0 or -1 where no range was measured. One
        # NaN in the filter would make every later estimate NaN.
        numbers = (sample.stamp, sample.time, sample.r, sample.sigma)
        if not _are_plausible(numbers) or sample.r <= 0 or sample.sigma < 0:
            return False
        if sample.r_dot is not None and not _are_plausible((sample.r_dot, sample.r_dot_sigma)):
            sample = sample._replace(r_dot=None)
        newest = self._newest
        stepped = newest is not None and abs(sample.stamp - newest.stamp) > LONGEST_GAP
        if stepped or self._is_far(sample.time):
            self._restart()
        if not self._estimator.observe(sample):
            return False
        self._newest = sample
        return True

    def update_motion(self, own: OwnMotion) -> bool:
        """Add a report of own motion. Reports may have any rate. Without reports only range-only
        laws work. Return False, and ignore the report, if a value is not finite or the airspeed is
        0, which is unknown."""
        numbers = (*own[:4], own.bank_turn or 0.0, *(own.acceleration or ()))
        if not _are_plausible(numbers):
            return False
        # Odometry without a twist reports 0 for every velocity. The estimator would take the whole
        # motion of the vehicle for drift.
        if own.airspeed == 0:
            return False
        if self._is_far(own.time):
            self._restart()
        self._estimator.move(own)
        nose = own._replace(bank_turn=None)
        self._loop.vehicle.on_motion(nose, nose)
        return True

    def estimate(self, now: float) -> RangeEstimate | None:
        """Return range and range rate now. `relative` is the relative motion if the estimator has
        one. Return None before the first range, and a minute after the newest range."""
        return None if self._is_far(now) else self._estimator.at(now)

    def command(self, now: float) -> TurnCommand | None:
        """Return the turn rate to command now, finite and within the vehicle's limit.

        None without a valid estimate (too few ranges, or the newest one is older than `stale` and
        `coast`), and if your law returns NaN or an infinity.

        Raises OwnCodeError, a ValueError with file and line, if your law fails or returns no
        number.
        """
        estimate = self.estimate(now)
        # abs: a range with a timestamp in the future would otherwise steer until that time.
        age = inf if self._newest is None else abs(now - self._newest.time)
        known = age <= self._stale + self._coast + SAME_TIME
        if estimate is None or not known or not self._estimator.ready:
            self._loop.reset()
            return None
        if age <= self._stale + SAME_TIME:
            command = self._loop.command(estimate, now)
        else:
            command = self._loop.hold(estimate, now)
        if not isfinite(command.demanded):
            self._loop.reset()
            return None
        self._loop.vehicle.command(now, command.turn_rate)
        return command

    def _is_far(self, time: float) -> bool:
        """True if a time is more than a minute away from the newest range, or NaN."""
        return self._newest is not None and not abs(time - self._newest.time) <= LONGEST_GAP

    def _restart(self) -> None:
        """Start the estimate again. The clock of a computer without a battery-backed clock, or of a
        simulator before its first clock message, jumps by years. No estimate can be predicted over
        such a jump."""
        self._estimator.reset()
        self._loop.reset()
        self._newest = None


def _are_plausible(numbers: Iterable[float]) -> bool:
    """True if no number is NaN, infinite, or so large that its square overflows. Some drivers
    report the largest double for an unknown value."""
    return all(abs(number) < 1e12 for number in numbers)


def _known(what: str, name: str, table: NameTable[Any]) -> None:
    if not table.knows(name):
        raise ValueError(f"{what} {name!r} is not one of {', '.join(table.names())}")


def _check_circle(orbit: Orbit) -> None:
    """Raise ValueError with name and unit for an impossible circle."""
    for name in ("radius", "speed", "max_turn_rate"):
        _check_above_zero(f"orbit.{name}", getattr(orbit, name))
    if not isinstance(orbit.direction, Direction):
        raise ValueError(
            "orbit.direction: must be Direction.CLOCKWISE or COUNTERCLOCKWISE, not"
            f" {orbit.direction!r}"
        )
    if orbit.max_turn_rate > 2 * pi:
        raise ValueError(
            f"orbit.max_turn_rate: {orbit.max_turn_rate:g} rad/s is more than a turn a second: not"
            " deg/s"
        )
    if orbit.speed / orbit.radius > orbit.max_turn_rate:
        raise ValueError(
            f"orbit: {orbit.words()} needs {orbit.speed / orbit.radius:.3g} rad/s, more than"
            f" max_turn_rate = {orbit.max_turn_rate:.3g} rad/s"
        )


def _check_lag(lag: float) -> None:
    if not 0 <= lag <= LONGEST_LAG:
        raise ValueError(f"turn_lag: must be 0 to {LONGEST_LAG:g} s, not {lag:g}")


def _check_above_zero(name: str, value: float) -> None:
    if not (isfinite(value) and value > 0):
        raise ValueError(f"{name}: must be a finite number above 0, not {value:g}")
