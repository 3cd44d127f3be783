"""Guidance for a loop of one's own (a ROS node, a notebook): ranges and own motion in, turn rates out. No MAVLink.

Promised: the names of `circnav_mav.__all__`, which are imported from `circnav_mav`. SI units, radians, x right, y up,
turn rates and headings counter-clockwise positive. Time is an argument: any clock, in seconds.
"""

from collections.abc import Callable, Mapping

from circnav_mav.guidance.estimators.interface import Estimator, EstimatorSettings, Fused
from circnav_mav.guidance.estimators.table import ESTIMATORS, default_estimator
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.step import LawChoice, Steering, compensate_turn_gain, limited
from circnav_mav.guidance.tuning import LawTuning
from circnav_mav.guidance.turn_response import TurnAnswer
from circnav_mav.guidance.types import SAME_TIME, Orbit, OwnMotion, RangeEstimate, RangeSample, TurnCommand

OwnLaw = Callable[[RangeEstimate], float]
"""A law of one's own: from the estimate to a turn rate, rad/s, counter-clockwise positive."""


def tune(
    orbit: Orbit, law: str = "auto", *, turn_lag: float = 0.4, sigma: float = 0.5, rate: float = 10.0
) -> LawChoice:
    """The law with the gain that a mission would fly.

    turn_lag: from a command to its turn, s. sigma: standard deviation of a range, m. rate: of the ranges, Hz. Raises
    ValueError for a law that does not exist.
    """
    _known("law", law, LAWS)
    settings = EstimatorSettings(orbit.speed, orbit.max_turn_rate)
    return LawTuning(law, settings, turn_lag, sigma, 1 / rate).choice(orbit)


class Guidance:
    """Guides one vehicle. Every flight needs its own: it remembers ranges, commands, and how the vehicle answers."""

    def __init__(
        self,
        orbit: Orbit,
        law: str | LawChoice | OwnLaw = "auto",
        estimator: str | Estimator | None = None,
        *,
        turn_lag: float = 0.4,
        stale: float = 0.5,
    ) -> None:
        """law: by name, as `tune` returns it, or a function of one's own. estimator: by name, or an object of one's
        own; None: the one that the law wants. turn_lag: from a command to its turn, s. stale: age from which the
        newest range steers no more, s. Raises ValueError for a name that does not exist."""
        if isinstance(law, str):
            law = tune(orbit, law, turn_lag=turn_lag)
        if isinstance(law, LawChoice):
            _known("law", law.name, LAWS)
            name, turn_lag = law.name, law.lag
            self._steer: Callable[..., TurnCommand] = Steering(orbit, law)
        else:
            name, self._steer = "", _own(law, orbit)
        self._orbit, self._stale = orbit, stale
        wanted = estimator or default_estimator(name)
        if isinstance(wanted, str):
            _known("estimator", wanted, ESTIMATORS)
            wanted = ESTIMATORS[wanted](EstimatorSettings(orbit.speed, orbit.max_turn_rate))
        self._estimator = wanted
        self._newest: float | None = None
        self._answer = TurnAnswer(turn_lag, orbit.max_turn_rate)

    def observe(self, sample: RangeSample) -> bool:
        """Take in a range; tells whether it was accepted, or rejected as an outlier."""
        if self._estimator.observe(sample) is Fused.GATED:
            return False
        self._newest = sample.time
        return True

    def move(self, own: OwnMotion) -> None:
        """Take in own motion, as often as it is known. Without it only laws on range alone fly."""
        self._estimator.move(own)
        self._answer.feel(own._replace(bank_turn=None))

    def estimate(self, now: float) -> RangeEstimate | None:
        """Range and range rate now, and in `relative` where the target is, where the estimator knows; None before the
        first range."""
        return self._estimator.at(now)

    def command(self, now: float) -> TurnCommand | None:
        """The turn rate to command now, within the vehicle's limit. None where there is no estimate that may steer:
        before enough ranges came, and once the newest is stale."""
        estimate = self.estimate(now)
        fresh = self._newest is not None and now - self._newest <= self._stale + SAME_TIME
        if estimate is None or not fresh or not self._estimator.ready:
            self._answer.reset()
            return None
        turning = estimate.relative.turn_rate if estimate.relative is not None else 0.0
        wanted = self._steer(estimate, 0.0, self._answer.pending(now, turning), 1.0)
        command = compensate_turn_gain(wanted, self._orbit.max_turn_rate, self._answer.gain)
        self._answer.command(now, command.turn_rate)
        return command


def _own(law: OwnLaw, orbit: Orbit) -> Callable[..., TurnCommand]:
    return lambda estimate, *_: limited(float(law(estimate)), orbit.max_turn_rate)


def _known(what: str, name: str, table: Mapping[str, object]) -> None:
    if name not in table:
        raise ValueError(f"{what} {name!r} is not one of {', '.join(table)}")
