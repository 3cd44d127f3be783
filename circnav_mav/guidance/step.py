"""From an estimate to a turn rate: the law, then the vehicle's limit. One definition for the flight in the air, in
plain floats, and for B flights of an experiment, in arrays (B,).

`auto` flies feedforward on range and range rate at once, the drift law as soon as the relative motion can be trusted.
While the target is searched for, the likeliest guess is tried out: flying at a wrong guess contradicts it within
seconds, where the straight approach of a law on range alone would leave all guesses alive. When even that tells nothing
apart, the approach weaves. A vehicle that leaves the target behind meanwhile turns at its limit. Every change is
bumpless: the difference to the command before it fades out.
"""

from dataclasses import dataclass, replace
from enum import IntEnum
from math import inf, isfinite, pi
from typing import Any, NamedTuple

from circnav_mav.guidance import lap_plan, laws
from circnav_mav.guidance.laws import LAWS, Kind, Law
from circnav_mav.guidance.maths import (
    Array,
    Flag,
    Number,
    Pair,
    arctan2,
    clip,
    exp,
    logical_not,
    magnitude,
    maximum,
    minimum,
    sin,
    where,
)
from circnav_mav.guidance.pending_turn import Pending
from circnav_mav.guidance.types import SAME_TIME, Orbit, RangeEstimate, RelativeMotion, TurnCommand
from circnav_mav.guidance.vector_field import drift, drift_gains, mirrored, mirrored_pair, orbit_turn_rate

LONGEST_STEP = 0.5
"""A longer time between two commands counts as this, s: nothing may build up over a gap."""
AT_LIMIT = 0.99
"""Share of the limit from which a command counts as cut: while laws hand over, the limit is only approached."""
NEAR, ALONG = 0.3, 0.4
"""Radius error in units of the radius, and range rate in V, below which the vehicle is on its circle already."""
CHANGE_TIME = 1.3
"""Time constant, s, with which the law follows the change of the estimated drift. A few bad ranges in a row move the
estimate by 1 m/s for a moment; a shorter time constant takes that for a change of the wind."""
CIRCLING_PATIENCE = 10.0
"""Time, s, for which a search on the circle tries no guess."""
FIRST_GUESS = 1.0
"""Time, s, that a search needs before its likeliest guess is worth trying."""
PATIENCE = 6.0
"""Time, s, of trying after which the approach weaves."""
WEAVE_SHARE, WEAVE_PERIOD = 0.7, 6.0
"""Amplitude in units of the turn-rate limit, and period, s: some 30 deg to either side."""
FADE = 0.2
"""Time constant of a handover, s."""
LEAVES, LEAVES_FAST = 0.2, 0.4
"""Range rates, in V, from which a vehicle outside the circle that does not know where the target is turns harder than
it would, and at the limit."""


@dataclass(frozen=True, slots=True)
class LawChoice:
    """A law by name, the magnitude of its gain, and whether its radius is corrected to the one asked for.

    lag: of the vehicle's turn, s; the drift law makes its gains from it.
    """

    name: str
    gain: float
    correct_radius: bool = True
    lag: float = 0.4

    def eased(self, share: float, orbit: Orbit) -> "LawChoice":
        """The law with so much of its gain, but not so little that it would not reach its circle."""
        least = laws.LEAST * LAWS[self.name].gain_bound(orbit.speed, orbit.radius)
        return replace(self, gain=min(self.gain, max(share * self.gain, least)))


@dataclass(frozen=True, slots=True)
class StepSettings:
    """What a step needs to know. sense: +1 counter-clockwise. V: m/s. r_d: m. fed: the radius that the law is fed, m.
    k: gain with the sign of the sense (the paper: k > 0 flies clockwise). limit: of the turn rate, rad/s."""

    law: Law
    sense: Number
    V: Number
    r_d: Number
    fed: Number
    k: Number
    limit: Number

    @classmethod
    def of(cls, orbit: Orbit, choice: LawChoice) -> "StepSettings":
        """Of one mission. Raises ValueError when the radius correction does not exist for this gain."""
        law, sense = LAWS[choice.name], orbit.direction.turn_sign
        fed = law.fed_radius(orbit.speed, orbit.radius, choice.gain) if choice.correct_radius else orbit.radius
        return cls(law, sense, orbit.speed, orbit.radius, fed, -sense * choice.gain, orbit.max_turn_rate)


class Inputs(NamedTuple):
    """What a step goes by. time: s. r, r_dot: m, m/s. pending: what is commanded but not turned yet. relative: where
    the target is; None without grounds. trim: m, added to the radius that the law is fed. share: of the gains that the
    rule gives."""

    time: float
    r: Number
    r_dot: Number
    pending: Pending
    relative: RelativeMotion | None = None
    trim: Number = 0.0
    share: Number = 1.0


class Flies(IntEnum):
    """Who steers."""

    FEEDFORWARD = 0
    TRIAL = 1
    DRIFT = 2


WHY = {
    Flies.FEEDFORWARD: "feedforward: the target is not found yet",
    Flies.TRIAL: "trying the likeliest place of the target",
    Flies.DRIFT: "drift: target and drift are known",
}


class Handover(NamedTuple):
    """flies: who steered last; -1: nobody yet. favourite: which guess was on trial. command: what was flown, rad/s.
    offset: what is left of the last change, rad/s. untrusted: s since the target was last known. about: to which side
    it turns while it leaves the target behind, +1 to the left; else 0."""

    flies: Array = -1
    favourite: Array = -1
    command: Array = 0.0
    offset: Array = 0.0
    untrusted: Array = 0.0
    about: Array = 0.0


AT_START = Handover()


def hand_over(
    before: Handover, dt: Number, *, trusted: Flag, favourite: Number, by_range: Number, by_bank: Number,
    limit: Number, leaves: Number,
) -> Handover:  # fmt: skip
    """The command of this step, for the counter-clockwise orbit. favourite: number of the likeliest guess while the
    target is searched for, else -1.

    by_range, by_bank: what feedforward and the drift law ask for, rad/s; by_bank counts only where it has grounds.
    leaves: 0 where the vehicle does not leave the target behind, 1 where it does so fast.
    """
    untrusted = where(trusted, 0.0, before.untrusted + dt)
    trial = logical_not(trusted) & (favourite >= 0) & (untrusted >= FIRST_GUESS - SAME_TIME)
    flies = where(trusted, Flies.DRIFT, where(trial, Flies.TRIAL, Flies.FEEDFORWARD))
    on_trial = where(trial, favourite, -1)
    weave = WEAVE_SHARE * limit * sin(2 * pi * untrusted / WEAVE_PERIOD)
    by_bank = by_bank + where(trial & (untrusted > PATIENCE + SAME_TIME), weave, 0.0)
    wanted = clip(where(flies == Flies.FEEDFORWARD, by_range, by_bank), -limit, limit)
    # half a circle either way ends the leaving, and the tightest one leads away least; sides that go on changing with
    # the guesses and the weave would be a slalom straight away from the target
    leaves, keeps = where(trusted, 0.0, leaves), (before.about != 0) & (untrusted > PATIENCE + SAME_TIME)
    about = where(leaves == 0, 0.0, where(keeps, before.about, where(wanted < 0, -1.0, 1.0)))
    wanted = wanted + leaves * (about * limit - wanted)
    changed = (before.flies >= 0) & ((flies != before.flies) | (on_trial != before.favourite))
    offset = where(changed, before.command - wanted, before.offset * exp(-dt / FADE))
    return Handover(flies, on_trial, clip(wanted + offset, -limit, limit), offset, untrusted, about)


class StepState(NamedTuple):
    """What a step remembers. time: of the command before, s. memory: the integral of `pi`, m. drift_x, drift_y: the
    smoothed drift, m/s. offset: of what it steers to from the circle, outward, m."""

    time: Number = -inf
    memory: Number = 0.0
    handover: Handover = AT_START
    drift_x: Number = 0.0
    drift_y: Number = 0.0
    offset: Number = 0.0


def step(before: StepState, settings: StepSettings, inputs: Inputs) -> tuple[StepState, TurnCommand]:
    """One step of the guidance: what it remembers now, and the turn within the limit."""
    dt = where(before.time > -inf, clip(inputs.time - before.time, 0.0, LONGEST_STEP), 0.0)
    if settings.law.flies_relative_motion:
        return _with_relative_motion(before, settings, inputs, dt)
    V, k, radius, memory = settings.V, settings.k, settings.fed + inputs.trim, before.memory
    if settings.law.kind is Kind.MEMORY:
        demanded, memory = laws.pi(inputs.r, inputs.r_dot, memory, dt, V=V, r_d=radius, k=k)
    else:
        demanded = settings.law.function(inputs.r, inputs.r_dot, V=V, r_d=radius, k=k)
    return StepState(inputs.time, memory, before.handover), limited(demanded, settings.limit)


def _with_relative_motion(
    before: StepState, settings: StepSettings, inputs: Inputs, dt: Number
) -> tuple[StepState, TurnCommand]:
    """`auto` and `drift`, seen so that the orbit is counter-clockwise; only what leaves has its sense again."""
    s, relative, radius = settings.sense, inputs.relative, settings.fed + inputs.trim
    by_range = s * settings.law.function(inputs.r, inputs.r_dot, V=settings.V, r_d=radius, k=settings.k)
    by_drift, trusted, drift_x, drift_y, offset = by_range, False, before.drift_x, before.drift_y, 0.0
    if relative is not None:
        # how far the drift is ahead of the smoothed one tells its change; smoothing begins where the drift law steers
        follows, share = before.handover.flies == Flies.DRIFT, dt / (CHANGE_TIME + dt)
        drift_x = where(follows, drift_x + share * (relative.drift_x - drift_x), relative.drift_x)
        drift_y = where(follows, drift_y + share * (relative.drift_y - drift_y), relative.drift_y)
        change = (relative.drift_x - drift_x) / CHANGE_TIME, (relative.drift_y - drift_y) / CHANGE_TIME
        (by_drift, offset), trusted = _by_drift(settings, relative, change, inputs), relative.trusted
    handover = hand_over(
        before.handover, dt, trusted=trusted, favourite=_tried(before.handover, settings, inputs),
        by_range=by_range, by_bank=by_drift, limit=settings.limit, leaves=_leaves(settings, inputs),
    )  # fmt: skip
    demanded = where(handover.flies == Flies.FEEDFORWARD, by_range, by_drift)
    cut: Any = magnitude(handover.command) >= AT_LIMIT * settings.limit
    after = StepState(inputs.time, before.memory, handover, drift_x, drift_y, where(trusted, offset, 0.0))
    return after, TurnCommand(s * handover.command, s * demanded, cut)


def _tried(before: Handover, settings: StepSettings, inputs: Inputs) -> Array:
    """Number of the guess that is worth flying at; -1: none. On the circle, with the drift known from before, the
    circle itself soon tells the guesses apart, and trying a wrong one would leave it."""
    relative = inputs.relative
    if relative is None or relative.trial is None or settings.law.kind is not Kind.AUTO:
        return -1
    near = magnitude(inputs.r - settings.r_d) < NEAR * settings.r_d
    circling = near & (magnitude(inputs.r_dot) < ALONG * settings.V)
    patient = before.untrusted < CIRCLING_PATIENCE - SAME_TIME
    return where(relative.drift_remembered & circling & patient, -1, relative.trial)


def _leaves(settings: StepSettings, inputs: Inputs) -> Array:
    """How far a vehicle leaves the target behind: 0 not at all, or it flies `drift`, which knows; 1 fast."""
    outside = (inputs.r > settings.r_d) & (settings.law.kind is Kind.AUTO)
    fast = clip((inputs.r_dot / settings.V - LEAVES) / (LEAVES_FAST - LEAVES), 0.0, 1.0)
    return where(outside, fast, 0.0)


def _by_drift(settings: StepSettings, relative: RelativeMotion, change: Pair, inputs: Inputs) -> tuple[Array, Array]:
    """The drift law, seen so that the orbit is counter-clockwise, and by how much what it steers to is outside of the
    circle here, m. change: of the drift, m/s^2."""
    p, d = (relative.x, relative.y), (relative.drift_x, relative.drift_y)
    here = mirrored(p, d, relative.heading, inputs.pending, settings.sense)
    V, r_d = maximum(relative.airspeed, 0.1 * settings.V), settings.r_d + inputs.trim
    gains = drift_gains(V, inputs.pending.ahead + inputs.pending.told_late, inputs.pending.settles, inputs.share)
    change = mirrored_pair(change, settings.sense)
    lap = lap_plan.plan(here[1], V=V, r_d=r_d, limit=minimum(settings.limit, inputs.pending.most))
    turn = drift(*here, V=V, r_d=r_d, max_turn_rate=settings.limit, gains=gains, change=change, lap=lap)
    return turn, 0.0 if lap is None else lap.at(arctan2(here[0][1], here[0][0]))[0] - r_d


def hold(settings: StepSettings, relative: RelativeMotion | None, pending: Pending) -> TurnCommand:
    """The circle's own turn, which no range enters: V/r_d; where the drift is trusted, what drift and heading ask for.

    pending: what is commanded but not turned yet, by which the heading is looked ahead.
    """
    s, turn = settings.sense, settings.V / settings.r_d
    if relative is not None:
        d, V = mirrored_pair((relative.drift_x, relative.drift_y), s), maximum(relative.airspeed, 0.1 * settings.V)
        heading = s * (relative.heading + pending.turn)
        turn = where(relative.trusted, orbit_turn_rate(d, heading, V=V, r_d=settings.r_d), turn)
    return limited(s * turn, settings.limit)


def limited(demanded: Array, limit: Number) -> TurnCommand:
    """A demand cut to +-limit, both in rad/s."""
    turn = clip(demanded, -limit, limit)
    return TurnCommand(turn, demanded, turn != demanded)


def compensate_turn_gain(command: TurnCommand, limit: Number, gain: Number) -> TurnCommand:
    """What to command to a vehicle that turns at `gain` times what is commanded, within +-limit (rad/s)."""
    cut = limited(command.turn_rate / gain, limit)
    return command._replace(turn_rate=cut.turn_rate, saturated=command.saturated | cut.saturated)


class Steering:
    """A law ready to steer: from an estimate to the limited command. It remembers: give every flight its own."""

    def __init__(self, orbit: Orbit, choice: LawChoice) -> None:
        """Raises ValueError if the radius correction does not exist for this gain."""
        self._state = StepState()
        self.change(orbit, choice)

    def change(self, orbit: Orbit, choice: LawChoice) -> None:
        """Steer to another circle from now on. What is known of drift and vehicle stays, so that a small change is
        smooth. Raises ValueError as above; then the circle stays as it was."""
        self._settings, self._at_rest = StepSettings.of(orbit, choice), Pending(0.0, choice.lag)

    def __call__(
        self, estimate: RangeEstimate, trim: float = 0.0, pending: Pending | None = None, share: float = 1.0
    ) -> TurnCommand:
        """Return the command. trim: m, added to the radius that the law is fed. pending: what is commanded but not
        turned yet; None: nothing, by a vehicle with the lag of the choice. share: of the gains."""
        inputs = Inputs(
            estimate.time, estimate.r, estimate.r_dot, pending or self._at_rest, estimate.relative, trim, share
        )
        self._state, command = step(self._state, self._settings, inputs)
        if not self._settings.law.flies_relative_motion:
            return command
        flies = self._state.handover.flies
        return command._replace(flies=flies.name.lower(), why=WHY[flies], offset=float(self._state.offset))


def holding(orbit: Orbit, motion: RelativeMotion | None, pending: Pending) -> TurnCommand:
    """`hold` of one flight; without trusted, finite relative motion V/r_d."""
    if motion is not None:
        carried = motion.drift_x, motion.drift_y, motion.heading, motion.turn_rate, motion.airspeed
        motion = motion if motion.trusted and all(map(isfinite, carried)) else None
    return hold(StepSettings.of(orbit, LawChoice("drift", 0.0)), motion, pending)
