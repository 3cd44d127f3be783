"""One guidance step: from an estimate through the law to a turn rate within the vehicle's limit.

The same code serves one real flight (plain floats) and B flights of an experiment (arrays (B,)).

`auto` starts with feedforward on range and range rate. It changes to the drift law once the
relative motion is trusted. During acquisition it flies the most likely hypothesis of the target
position: measurements contradict a wrong one within seconds, but the straight approach of a
range-only law would not separate the hypotheses. If they stay ambiguous, the approach adds a
sinusoidal excitation. A vehicle that flies away from the target meanwhile turns at its limit. Every
change is bumpless: the step in the command decays to 0.
"""

from dataclasses import dataclass
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
from circnav_mav.guidance.vector_field import (
    drift,
    drift_gains,
    mirrored,
    mirrored_pair,
    orbit_turn_rate,
)

LONGEST_STEP = 0.5
"""Longest time step, s. A longer gap between two commands counts as a step of this length, so that
no state builds up over the gap."""
AT_LIMIT = 0.99
"""Share of the limit from which a command counts as saturated: in a handover a command only
approaches the limit."""
NEAR = 0.3
ALONG = 0.4
"""Bounds for a vehicle already on its circle: radius error in units of the radius, range rate in
units of V."""
CHANGE_TIME = 1.3
"""Time constant of the filter on the estimated drift, s. A few bad ranges in a row move the
estimate by 1 m/s for a moment. With a shorter time constant this error would count as a change of
the wind."""
CIRCLING_PATIENCE = 10.0
"""Time, s, for which acquisition on the circle flies no hypothesis."""
FIRST_TRIAL = 1.0
"""Time of acquisition, s, before its most likely hypothesis is flown."""
PATIENCE = 6.0
"""Time, s, without a trusted target position after which the excitation starts."""
EXCITATION_SHARE = 0.7
EXCITATION_PERIOD = 6.0
"""Excitation: amplitude in units of the turn-rate limit, and period, s. The heading swings by about
30 deg."""
FADE = 0.2
"""Time constant of a handover, s."""
LEAVES = 0.2
LEAVES_FAST = 0.4
"""Range rates, in units of V, between which the command is blended towards the turn-rate limit, to
turn back a vehicle that flies away from the target. Both apply outside the circle while the target
position is not trusted."""


@dataclass(frozen=True, slots=True)
class LawChoice:
    """A law by name, with the magnitude of its gain.

    correct_radius: True if the law's radius bias is compensated. lag: of the vehicle's turn, s;
    sets the gains of the drift law.
    """

    name: str
    gain: float
    correct_radius: bool = True
    lag: float = 0.4


@dataclass(frozen=True, slots=True)
class StepSettings:
    """Constants of the steps on one circle. sense: +1 counter-clockwise, -1 clockwise. V: speed,
    m/s. r_d: radius, m. fed: the radius that the law is fed, m. k: signed gain (as in the paper, k
    > 0 flies clockwise). limit: of the turn rate, rad/s."""

    law: Law
    sense: Number
    V: Number
    r_d: Number
    fed: Number
    k: Number
    limit: Number

    @classmethod
    def of(cls, orbit: Orbit, choice: LawChoice) -> "StepSettings":
        """Return the settings for a circle and a law. Raises ValueError if this gain has no radius
        correction."""
        law = LAWS[choice.name]
        sense = orbit.direction.turn_sign
        fed = (
            law.fed_radius(orbit.speed, orbit.radius, choice.gain)
            if choice.correct_radius
            else orbit.radius
        )
        return cls(
            law, sense, orbit.speed, orbit.radius, fed, -sense * choice.gain, orbit.max_turn_rate
        )


class Inputs(NamedTuple):
    """Inputs of one step. time: s. r, r_dot: m, m/s. pending: commanded turn not flown yet.
    relative: relative motion, None if unknown. trim: m, added to the radius that the law is fed.
    share: factor on the drift law's gains."""

    time: float
    r: Number
    r_dot: Number
    pending: Pending
    relative: RelativeMotion | None = None
    trim: Number = 0.0
    share: Number = 1.0


class ActiveLaw(IntEnum):
    """Law that steers."""

    FEEDFORWARD = 0
    TRIAL = 1
    DRIFT = 2


WHY = {
    ActiveLaw.FEEDFORWARD: "feedforward: no target position yet",
    ActiveLaw.TRIAL: "flying to the likeliest target position",
    ActiveLaw.DRIFT: "drift: target and drift are estimated",
}


class Handover(NamedTuple):
    """State of the handover between laws. flies: the law that steered last; -1: none. most_likely:
    number of the hypothesis flown last; -1: none. command: last command, rad/s. offset: decaying
    rest of the command's step at the last change, rad/s. untrusted: time since the target position
    was last trusted, s. about: side to which a vehicle that flies away from the target turns back,
    +1 left, -1 right, 0 if it does not fly away. searched: duration of the present search, s."""

    flies: Array = -1
    most_likely: Array = -1
    command: Array = 0.0
    offset: Array = 0.0
    untrusted: Array = 0.0
    about: Array = 0.0
    searched: Array = 0.0


AT_START = Handover()


def next_handover(
    before: Handover,
    dt: Number,
    *,
    trusted: Flag,
    most_likely: Number,
    by_range: Number,
    drift_turn: Number,
    limit: Number,
    leaves: Number,
) -> Handover:
    """Return the handover state with the command of this step, for the counter-clockwise orbit.

    most_likely: number of the most likely hypothesis during acquisition, else -1. by_range,
    drift_turn: turn rates of feedforward and of the drift law, rad/s; drift_turn is valid only
    while the relative motion is available. leaves: degree of flying away from the target, 0 to 1
    (`_leaves`).
    """
    untrusted = where(trusted, 0.0, before.untrusted + dt)
    trial = logical_not(trusted) & (most_likely >= 0) & (untrusted >= FIRST_TRIAL - SAME_TIME)
    flies = where(trusted, ActiveLaw.DRIFT, where(trial, ActiveLaw.TRIAL, ActiveLaw.FEEDFORWARD))
    on_trial = where(trial, most_likely, -1)
    excitation = EXCITATION_SHARE * limit * sin(2 * pi * untrusted / EXCITATION_PERIOD)
    drift_turn = drift_turn + where(trial & (untrusted > PATIENCE + SAME_TIME), excitation, 0.0)
    wanted = clip(where(flies == ActiveLaw.FEEDFORWARD, by_range, drift_turn), -limit, limit)
    # A vehicle that flies away from the target turns back by a half circle, to either side. The
    # tightest half circle costs the least distance. Keep the side: hypotheses and excitation change
    # the sign of the command, and alternating turns would lead straight away from the target.
    leaves = where(trusted, 0.0, leaves)
    keeps = (before.about != 0) & (untrusted > PATIENCE + SAME_TIME)
    about = where(leaves == 0, 0.0, where(keeps, before.about, where(wanted < 0, -1.0, 1.0)))
    wanted = wanted + leaves * (about * limit - wanted)
    changed = (before.flies >= 0) & ((flies != before.flies) | (on_trial != before.most_likely))
    offset = where(changed, before.command - wanted, before.offset * exp(-dt / FADE))
    searched = where(trusted, 0.0, before.searched + dt)
    return Handover(
        flies, on_trial, clip(wanted + offset, -limit, limit), offset, untrusted, about, searched
    )


class StepState(NamedTuple):
    """State between steps. time: of the last command, s. memory: the integral of the law `pi`, m.
    drift_x, drift_y: the smoothed drift, m/s."""

    time: Number = -inf
    memory: Number = 0.0
    handover: Handover = AT_START
    drift_x: Number = 0.0
    drift_y: Number = 0.0


def step(
    before: StepState, settings: StepSettings, inputs: Inputs
) -> tuple[StepState, TurnCommand]:
    """Run one guidance step. Return the new state and the turn within the limit."""
    dt = where(before.time > -inf, clip(inputs.time - before.time, 0.0, LONGEST_STEP), 0.0)
    if settings.law.flies_relative_motion:
        return _with_relative_motion(before, settings, inputs, dt)
    V = settings.V
    k = settings.k
    radius = settings.fed + inputs.trim
    memory = before.memory
    if settings.law.kind is Kind.MEMORY:
        demanded, memory = laws.pi(inputs.r, inputs.r_dot, memory, dt, V=V, r_d=radius, k=k)
    else:
        demanded = settings.law.function(inputs.r, inputs.r_dot, V=V, r_d=radius, k=k)
    return StepState(inputs.time, memory, before.handover), limited(demanded, settings.limit)


def _with_relative_motion(
    before: StepState, settings: StepSettings, inputs: Inputs, dt: Number
) -> tuple[StepState, TurnCommand]:
    """Run a step of `auto` or `drift`, mirrored to a counter-clockwise orbit. The result has the
    true sense."""
    s = settings.sense
    relative = inputs.relative
    by_range = s * settings.law.function(
        inputs.r, inputs.r_dot, V=settings.V, r_d=settings.fed, k=settings.k
    )
    by_drift = by_range
    trusted = False
    drift_x = before.drift_x
    drift_y = before.drift_y
    if relative is not None:
        # The difference between the drift and its low-pass gives its rate of change. The low-pass
        # starts when the drift law takes over.
        follows = before.handover.flies == ActiveLaw.DRIFT
        share = dt / (CHANGE_TIME + dt)
        drift_x = where(follows, drift_x + share * (relative.drift_x - drift_x), relative.drift_x)
        drift_y = where(follows, drift_y + share * (relative.drift_y - drift_y), relative.drift_y)
        change = (
            (relative.drift_x - drift_x) / CHANGE_TIME,
            (relative.drift_y - drift_y) / CHANGE_TIME,
        )
        by_drift = _by_drift(settings, relative, change, inputs)
        trusted = relative.trusted
    # Without relative motion there is no search. A vehicle without an airspeed sensor has none
    # while it does not follow its commands: its path is unknown. The search begins when the vehicle
    # follows again.
    last = before.handover if relative is not None else before.handover._replace(searched=0.0)
    handover = next_handover(
        last,
        dt,
        trusted=trusted,
        most_likely=_tried(last, settings, inputs),
        by_range=by_range,
        drift_turn=by_drift,
        limit=settings.limit,
        leaves=_leaves(settings, inputs),
    )
    demanded = where(handover.flies == ActiveLaw.FEEDFORWARD, by_range, by_drift)
    cut: Any = magnitude(handover.command) >= AT_LIMIT * settings.limit
    after = StepState(inputs.time, before.memory, handover, drift_x, drift_y)
    return after, TurnCommand(s * handover.command, s * demanded, cut)


def _tried(before: Handover, settings: StepSettings, inputs: Inputs) -> Array:
    """Number of the hypothesis to fly; -1: none."""
    # On the circle with a remembered drift, wait. Circling alone soon separates the hypotheses, and
    # flying a wrong one would leave the circle.
    relative = inputs.relative
    if relative is None or relative.trial is None or settings.law.kind is not Kind.AUTO:
        return -1
    near = magnitude(inputs.r - settings.r_d) < NEAR * settings.r_d
    circling = near & (magnitude(inputs.r_dot) < ALONG * settings.V)
    patient = before.searched < CIRCLING_PATIENCE - SAME_TIME
    return where(relative.drift_remembered & circling & patient, -1, relative.trial)


def _leaves(settings: StepSettings, inputs: Inputs) -> Array:
    """Degree of flying away from the target. 0: not at all, or the law is not `auto`. 1: at
    LEAVES_FAST or faster."""
    outside = (inputs.r > settings.r_d) & (settings.law.kind is Kind.AUTO)
    fast = clip((inputs.r_dot / settings.V - LEAVES) / (LEAVES_FAST - LEAVES), 0.0, 1.0)
    return where(outside, fast, 0.0)


def _by_drift(
    settings: StepSettings, relative: RelativeMotion, change: Pair, inputs: Inputs
) -> Array:
    """Return the turn rate (rad/s) of the drift law, for the counter-clockwise orbit. change: of
    the drift, m/s^2."""
    p = (relative.x, relative.y)
    d = (relative.drift_x, relative.drift_y)
    here = mirrored(p, d, relative.heading, inputs.pending, settings.sense)
    V = maximum(relative.airspeed, 0.1 * settings.V)
    r_d = settings.r_d
    gains = drift_gains(
        V,
        inputs.pending.ahead + inputs.pending.measurement_delay,
        inputs.pending.settles,
        inputs.share,
    )
    change = mirrored_pair(change, settings.sense)
    lap = lap_plan.plan(here[1], V=V, r_d=r_d, limit=minimum(settings.limit, inputs.pending.most))
    return drift(
        *here, V=V, r_d=r_d, max_turn_rate=settings.limit, gains=gains, change=change, lap=lap
    )


def hold(settings: StepSettings, relative: RelativeMotion | None, pending: Pending) -> TurnCommand:
    """Return the steady turn of the circle, without any range: V/r_d, or from drift and heading if
    they are trusted.

    pending: commanded turn not flown yet; it predicts the heading.
    """
    s = settings.sense
    turn = settings.V / settings.r_d
    if relative is not None:
        d = mirrored_pair((relative.drift_x, relative.drift_y), s)
        V = maximum(relative.airspeed, 0.1 * settings.V)
        heading = s * (relative.heading + pending.turn)
        turn = where(relative.trusted, orbit_turn_rate(d, heading, V=V, r_d=settings.r_d), turn)
    return limited(s * turn, settings.limit)


def limited(demanded: Array, limit: Number) -> TurnCommand:
    """Return the demand limited to +-limit, both in rad/s."""
    turn = clip(demanded, -limit, limit)
    return TurnCommand(turn, demanded, turn != demanded)


def compensate_turn_gain(command: TurnCommand, limit: Number, gain: Number) -> TurnCommand:
    """Return the command divided by the vehicle's turn-rate gain, within +-limit (rad/s)."""
    cut = limited(command.turn_rate / gain, limit)
    return command._replace(turn_rate=cut.turn_rate, saturated=command.saturated | cut.saturated)


class Steering:
    """A law with its state: from an estimate to the limited command. Use one instance per
    flight."""

    def __init__(self, orbit: Orbit, choice: LawChoice) -> None:
        """Set the circle and the law. Raises ValueError if this gain has no radius correction."""
        self._state = StepState()
        self.change(orbit, choice)

    def change(self, orbit: Orbit, choice: LawChoice) -> None:
        """Steer to another circle from now on. The state is kept, so that a small change is smooth.
        Raises ValueError if this gain has no radius correction, and then keeps the circle."""
        self._settings = StepSettings.of(orbit, choice)
        self._at_rest = Pending(0.0, choice.lag)

    def __call__(
        self,
        estimate: RangeEstimate,
        trim: float = 0.0,
        pending: Pending | None = None,
        share: float = 1.0,
    ) -> TurnCommand:
        """Return the command. trim: m, added to the radius that a law on range alone is fed.
        pending: commanded turn not flown yet; None: no such turn, and the lag of the law choice.
        share: factor on the gains."""
        inputs = Inputs(
            estimate.time,
            estimate.r,
            estimate.r_dot,
            pending or self._at_rest,
            estimate.relative,
            trim,
            share,
        )
        self._state, command = step(self._state, self._settings, inputs)
        if not self._settings.law.flies_relative_motion:
            return command
        flies = self._state.handover.flies
        return command._replace(flies=flies.name.lower(), why=WHY[flies])


def holding(orbit: Orbit, motion: RelativeMotion | None, pending: Pending) -> TurnCommand:
    """Return `hold` for one flight: V/r_d unless the relative motion is trusted and finite."""
    if motion is not None:
        carried = motion.drift_x, motion.drift_y, motion.heading, motion.turn_rate, motion.airspeed
        motion = motion if motion.trusted and all(map(isfinite, carried)) else None
    return hold(StepSettings.of(orbit, LawChoice("drift", 0.0)), motion, pending)
