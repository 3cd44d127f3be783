"""From an estimate to a turn rate: the law, then the vehicle's limit."""

from dataclasses import dataclass, replace
from math import isfinite
from typing import Protocol

from circnav_mav.guidance import floats
from circnav_mav.guidance.law_selector import ONE_AT_START, Flies, hand_over
from circnav_mav.guidance.laws import LAWS, Kind, pi
from circnav_mav.guidance.turn_response import Pending
from circnav_mav.guidance.types import SAME_TIME, Orbit, RangeEstimate, RelativeMotion, TurnCommand, TurnRate
from circnav_mav.guidance.vector_field import drift, drift_gains, mirrored, orbit_turn_rate

LONGEST_STEP = 0.5
"""A longer time between two commands counts as this, s: nothing may build up over a gap."""
DEFAULT_LAG = 0.4
AT_LIMIT = 0.99
"""Share of the limit from which a command counts as cut: while laws hand over, the limit is only approached."""
NEAR, ALONG = 0.3, 0.4
"""Radius error in units of the radius, and range rate in V, below which the vehicle is on its circle already."""
CIRCLING_PATIENCE = 10.0
"""Time, s, for which a search on the circle tries no guess."""


@dataclass(frozen=True, slots=True)
class LawChoice:
    """A law by name, the magnitude of its gain, and whether its radius is corrected to the one asked for.

    lag: of the vehicle's turn, s; the drift law makes its gains from it.
    """

    name: str
    gain: float
    correct_radius: bool = True
    lag: float = DEFAULT_LAG


class Steering(Protocol):
    """A law ready to steer."""

    def __call__(
        self, estimate: RangeEstimate, trim: float = 0.0, pending: Pending | None = None, share: float = 1.0
    ) -> TurnCommand:
        """The limited command. trim: m, added to the radius that the law is fed. pending: what is commanded but not
        turned yet; None: nothing, by a vehicle with the lag of the choice. share: of the gains that the rule gives."""
        ...


def steering(orbit: Orbit, choice: LawChoice) -> Steering:
    """The mission's guidance as one function from estimate to limited command.

    Some laws remember: give every flight its own. Raises ValueError when the radius correction does not exist for
    this gain.
    """
    law = LAWS[choice.name]
    if law.kind is Kind.MEMORY:
        return _Integrating(orbit, choice)
    if law.flies_relative_motion:
        return _HandingOver(orbit, choice)
    return _by_range(orbit, choice)


def holding(orbit: Orbit, motion: RelativeMotion | None, pending: Pending) -> TurnCommand:
    """The circle's own turn, which no range enters: V/r_d; where the drift is trusted, what drift and heading ask for.

    pending: what is commanded but not turned yet, by which the heading is looked ahead.
    """
    if motion is None or not motion.trusted or not _finite(motion):
        return limit(orbit.steady_turn_rate, orbit.max_turn_rate)
    s = orbit.direction.turn_sign
    d, V = (motion.drift_x, s * motion.drift_y), max(motion.airspeed, 0.1 * orbit.speed)
    heading = s * (motion.heading + pending.turn)
    turn = s * orbit_turn_rate(d, heading, V=V, r_d=orbit.radius, xp=floats)
    return limit(TurnRate(turn), orbit.max_turn_rate)


def _finite(motion: RelativeMotion) -> bool:
    """Whether all is a number that tells how the vehicle is carried."""
    carried = motion.drift_x, motion.drift_y, motion.heading, motion.turn_rate, motion.airspeed
    return all(map(isfinite, carried))


def limit(demanded: TurnRate, max_turn_rate: float) -> TurnCommand:
    """Cut a turn rate to the vehicle's limit, both in rad/s, and say whether it was cut."""
    cut = min(max(demanded, -max_turn_rate), max_turn_rate)
    return TurnCommand(TurnRate(cut), demanded, saturated=cut != demanded)


def through_gain(command: TurnCommand, max_turn_rate: float, gain: float) -> TurnCommand:
    """What to tell a vehicle that turns at `gain` times what it is told, within +-max_turn_rate (rad/s)."""
    told = command.turn_rate / gain
    cut = min(max(told, -max_turn_rate), max_turn_rate)
    return replace(command, turn_rate=TurnRate(cut), saturated=command.saturated or cut != told)


def _by_range(orbit: Orbit, choice: LawChoice) -> Steering:
    law = LAWS[choice.name]
    k = -orbit.direction.turn_sign * choice.gain  # the paper: k > 0 flies clockwise
    fed = law.fed_radius(orbit.speed, orbit.radius, choice.gain) if choice.correct_radius else orbit.radius

    def steer(
        estimate: RangeEstimate, trim: float = 0.0, pending: Pending | None = None, share: float = 1.0
    ) -> TurnCommand:
        demanded = float(law.function(estimate.r, estimate.r_dot, V=orbit.speed, r_d=fed + trim, k=k))
        return limit(TurnRate(demanded), orbit.max_turn_rate)

    return steer


class _Integrating:
    """The PI law with its memory."""

    def __init__(self, orbit: Orbit, choice: LawChoice) -> None:
        self._orbit, self._k = orbit, -orbit.direction.turn_sign * choice.gain
        self._memory, self._time = 0.0, None

    _time: float | None

    def __call__(
        self, estimate: RangeEstimate, trim: float = 0.0, pending: Pending | None = None, share: float = 1.0
    ) -> TurnCommand:
        orbit = self._orbit
        dt = 0.0 if self._time is None else min(max(estimate.time - self._time, 0.0), LONGEST_STEP)
        self._time = estimate.time
        radius = orbit.radius + trim
        demanded, memory = pi(estimate.r, estimate.r_dot, self._memory, dt, V=orbit.speed, r_d=radius, k=self._k)
        self._memory = float(memory)
        return limit(TurnRate(float(demanded)), orbit.max_turn_rate)


class _HandingOver:
    """`auto` and `drift`: see `circnav_mav.guidance.law_selector`. `drift` does not try guesses out."""

    def __init__(self, orbit: Orbit, choice: LawChoice) -> None:
        self._orbit, self._tries = orbit, LAWS[choice.name].kind is Kind.AUTO
        self._feedforward = _by_range(orbit, choice)
        self._lag = choice.lag
        self._handover = ONE_AT_START
        self._time: float | None = None

    def __call__(
        self, estimate: RangeEstimate, trim: float = 0.0, pending: Pending | None = None, share: float = 1.0
    ) -> TurnCommand:
        pending = pending or Pending(0.0, self._lag)
        dt = 0.0 if self._time is None else min(max(estimate.time - self._time, 0.0), LONGEST_STEP)
        self._time = estimate.time
        s, motion = self._orbit.direction.turn_sign, estimate.relative
        if motion is not None and motion.trusted:
            by_bank = by_range = self._by_bank(motion, trim, pending, share)
        else:
            by_range = s * self._feedforward(estimate, trim).demanded
            by_bank = by_range if motion is None else self._by_bank(motion, trim, pending, share)
        self._handover = hand_over(
            self._handover, dt, trusted=motion is not None and motion.trusted, favourite=self._tried(estimate),
            by_range=by_range, by_bank=by_bank, limit=self._orbit.max_turn_rate, r=estimate.r, r_d=self._orbit.radius,
            xp=floats,
        )  # fmt: skip
        flies, command = self._handover.flies, self._handover.command
        demanded = by_range if flies is Flies.FEEDFORWARD else by_bank
        saturated = abs(command) >= AT_LIMIT * self._orbit.max_turn_rate
        return TurnCommand(
            TurnRate(s * command), TurnRate(s * demanded), saturated, flies=flies.name.lower(), why=flies.why
        )

    def _tried(self, estimate: RangeEstimate) -> int:
        """Number of the guess that is worth flying at; -1: none. On the circle, with the drift known from before, the
        circle itself soon tells the guesses apart, and trying a wrong one would leave it."""
        orbit, motion = self._orbit, estimate.relative
        if not self._tries or motion is None or motion.trial is None:
            return -1
        circling = abs(estimate.r - orbit.radius) < NEAR * orbit.radius and abs(estimate.r_dot) < ALONG * orbit.speed
        patient = self._handover.untrusted < CIRCLING_PATIENCE - SAME_TIME
        return -1 if motion.drift_remembered and circling and patient else motion.trial

    def _by_bank(self, motion: RelativeMotion, trim: float, pending: Pending, share: float) -> float:
        """The drift law, seen so that the orbit is counter-clockwise."""
        orbit = self._orbit
        p, d, sense = (motion.x, motion.y), (motion.drift_x, motion.drift_y), orbit.direction.turn_sign
        here = mirrored(p, d, motion.heading, pending, sense)
        V, limit = max(motion.airspeed, 0.1 * orbit.speed), orbit.max_turn_rate
        gains = drift_gains(V, pending.ahead, pending.settles, share, floats)
        return float(drift(*here, V=V, r_d=orbit.radius + trim, max_turn_rate=limit, gains=gains, xp=floats))
