"""From an estimate to a turn rate: the law, then the vehicle's limit."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from circnav_mav.core.auto import Flies, at_start, hand_over
from circnav_mav.core.drift_law import drift, drift_gains, mirrored, orbit_turn_rate
from circnav_mav.core.laws import LAWS, Kind, pi
from circnav_mav.core.values import Orbit, RangeEstimate, RelativeMotion, TurnCommand, TurnRate

LONGEST_STEP = 0.5
"""A longer time between two commands counts as this, s: nothing may build up over a gap."""
DEFAULT_LAG = 0.4
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

    def __call__(self, estimate: RangeEstimate, trim: float = 0.0, delay: float = 0.0) -> TurnCommand:
        """The limited command. trim: m, added to the radius that the law is fed. delay: of the link, s, there and
        back, for which the drift law lowers its gains."""
        ...


def steering(orbit: Orbit, choice: LawChoice) -> Steering:
    """The mission's guidance as one function from estimate to limited command.

    Some laws remember: give every flight its own. Raises ValueError when the radius correction does not exist for
    this gain.
    """
    kind = LAWS[choice.name].kind
    if kind is Kind.MEMORY:
        return _Integrating(orbit, choice)
    if kind in (Kind.RELATIVE, Kind.AUTO):
        return _HandingOver(orbit, choice)
    return _by_range(orbit, choice)


def holding(orbit: Orbit, motion: RelativeMotion | None, lag: float) -> TurnCommand:
    """The circle's own turn, which no range enters: V/r_d; where the drift is known, what drift and heading ask for.

    lag: of the vehicle's turn, s, by which the heading is looked ahead.
    """
    if motion is None or motion.trial is not None:
        return limit(orbit.steady_turn_rate, orbit.max_turn_rate)
    s = orbit.direction.turn_sign
    d, V = np.array([motion.drift_x, s * motion.drift_y]), max(motion.airspeed, 0.1 * orbit.speed)
    heading = np.asarray(s * (motion.heading + lag * motion.turn_rate))
    turn = s * float(orbit_turn_rate(d, heading, V=V, r_d=orbit.radius))
    return limit(TurnRate(turn), orbit.max_turn_rate)


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

    def steer(estimate: RangeEstimate, trim: float = 0.0, delay: float = 0.0) -> TurnCommand:
        demanded = float(law.function(estimate.r, estimate.r_dot, V=orbit.speed, r_d=fed + trim, k=k))
        return limit(TurnRate(demanded), orbit.max_turn_rate)

    return steer


class _Integrating:
    """The PI law with its memory."""

    def __init__(self, orbit: Orbit, choice: LawChoice) -> None:
        self._orbit, self._k = orbit, -orbit.direction.turn_sign * choice.gain
        self._memory, self._time = 0.0, None

    _time: float | None

    def __call__(self, estimate: RangeEstimate, trim: float = 0.0, delay: float = 0.0) -> TurnCommand:
        orbit = self._orbit
        dt = 0.0 if self._time is None else min(max(estimate.time - self._time, 0.0), LONGEST_STEP)
        self._time = estimate.time
        radius = orbit.radius + trim
        demanded, memory = pi(estimate.r, estimate.r_dot, self._memory, dt, V=orbit.speed, r_d=radius, k=self._k)
        self._memory = float(memory)
        return limit(TurnRate(float(demanded)), orbit.max_turn_rate)


class _HandingOver:
    """`auto` and `drift`: see `circnav_mav.core.auto`. `drift` does not try guesses out."""

    def __init__(self, orbit: Orbit, choice: LawChoice) -> None:
        self._orbit, self._tries = orbit, LAWS[choice.name].kind is Kind.AUTO
        self._feedforward = _by_range(orbit, choice)
        self._lag, self._gains = choice.lag, drift_gains(orbit.speed, orbit.radius, choice.lag)
        self._handover = at_start()
        self._time: float | None = None

    def __call__(self, estimate: RangeEstimate, trim: float = 0.0, delay: float = 0.0) -> TurnCommand:
        if delay != self._gains.delay:
            self._gains = drift_gains(self._orbit.speed, self._orbit.radius, self._lag, delay=delay)
        dt = 0.0 if self._time is None else min(max(estimate.time - self._time, 0.0), LONGEST_STEP)
        self._time = estimate.time
        s, motion = self._orbit.direction.turn_sign, estimate.relative
        by_range = s * self._feedforward(estimate, trim).demanded
        by_bank = by_range if motion is None else self._by_bank(motion, trim)
        tried = self._tried(estimate)
        self._handover = hand_over(
            self._handover, dt,
            trusted=np.array([motion is not None and motion.trusted]), favourite=np.array([tried]),
            by_range=np.array([by_range]), by_bank=np.array([by_bank]), limit=self._orbit.max_turn_rate,
        )  # fmt: skip
        flies, command = Flies(int(self._handover.flies[0])), float(self._handover.command[0])
        demanded = by_range if flies is Flies.FEEDFORWARD else by_bank
        saturated = abs(command) >= self._orbit.max_turn_rate
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
        patient = self._handover.untrusted[0] < CIRCLING_PATIENCE
        return -1 if motion.drift_remembered and circling and patient else motion.trial

    def _by_bank(self, motion: RelativeMotion, trim: float) -> float:
        """The drift law, seen so that the orbit is counter-clockwise."""
        p, d = np.array([motion.x, motion.y]), np.array([motion.drift_x, motion.drift_y])
        sense = np.asarray(float(self._orbit.direction.turn_sign))
        here = mirrored(p, d, np.asarray(motion.heading), np.asarray(motion.turn_rate), sense)
        V = max(motion.airspeed, 0.1 * self._orbit.speed)
        orbit = self._orbit
        return float(drift(*here, V=V, r_d=orbit.radius + trim, max_turn_rate=orbit.max_turn_rate, gains=self._gains))
