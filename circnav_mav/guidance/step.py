"""One guidance step: from an estimate through the law to a turn rate within the vehicle's limit.

`auto` starts with feedforward on range and range rate. It changes to the drift law once the
relative motion is trusted. During acquisition it flies the most likely hypothesis of the target
position. Ranges then contradict a wrong hypothesis within seconds. The straight approach of a
range-only law would not separate the hypotheses. If the hypotheses stay ambiguous, a sinusoidal
excitation is added to the turn rate. A vehicle that flies away from the target during acquisition
turns at its limit. Every change of the law is bumpless: the step in the command decays to 0.
"""

from dataclasses import dataclass
from enum import IntEnum
from math import copysign, exp, inf, isfinite, pi, sin
from typing import NamedTuple

from circnav_mav.guidance import lap_plan
from circnav_mav.guidance.laws import LAWS, LEAST, Kind, Law
from circnav_mav.guidance.maths import clip
from circnav_mav.guidance.own_code import turn_rate_of
from circnav_mav.guidance.turn_response import Pending
from circnav_mav.guidance.types import (
    SAME_TIME,
    Orbit,
    OwnLaw,
    RangeEstimate,
    RelativeMotion,
    TurnCommand,
    TurnRate,
)
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
"""A command above this share of the turn-rate limit is reported as saturated. In a handover a
command only approaches the limit."""
NEAR = 0.3
"""Largest radius error, in units of the radius, of a vehicle that is already on its circle."""
ALONG = 0.4
"""Largest range rate, in units of V, of a vehicle that is already on its circle."""
CHANGE_TIME = 1.3
"""Time constant of the filter on the estimated drift, s. A few bad ranges in a row change the
estimated drift by 1 m/s for a moment. With a shorter time constant this error would be taken for a
change of the wind."""
PATIENCE = 6.0
"""Time, s, without a trusted target position after which the excitation starts."""
EXCITATION_SHARE = 0.7
"""Amplitude of the excitation, in units of the turn-rate limit. The heading oscillates by about 30
deg."""
EXCITATION_PERIOD = 6.0
"""Period of the excitation, s."""
FADE = 0.2
"""Time constant, s, with which the step in the command decays after a change of the law."""
LEAVES = 0.2
"""Range rate, in units of V, above which the vehicle flies away from the target. From here to
LEAVES_FAST the command is blended into a turn at the limit. Both bounds apply outside the circle
while the target position is not trusted."""
LEAVES_FAST = 0.4
"""Range rate, in units of V, above which the command is a turn at the limit."""


@dataclass(frozen=True, slots=True)
class LawChoice:
    """A law with its gain.

    name: of the law in `LAWS`.
    gain: magnitude of its gain.
    lag: delay from a command to its turn, s; sets the gains of the drift law.
    """

    name: str
    gain: float
    lag: float = 0.4


@dataclass(frozen=True, slots=True)
class StepSettings:
    """Constants of the steps on one circle.

    law: law that steers.
    sense: +1 counter-clockwise, -1 clockwise.
    V: speed, m/s.
    r_d: radius of the circle, m.
    gain: magnitude of the law's gain.
    limit: limit of the turn rate, rad/s.
    """

    law: Law
    sense: int
    V: float
    r_d: float
    gain: float
    limit: float

    @classmethod
    def of(cls, orbit: Orbit, choice: LawChoice) -> "StepSettings":
        """Return the settings for a circle and a law. Raises ValueError if the gain is not above 0,
        or is too small for a correction of the radius."""
        if not 0 < choice.gain < inf:
            raise ValueError(
                f"gain: must be a finite number above 0, not {choice.gain:g} (the direction of the"
                " circle, not the sign of the gain, selects clockwise or counter-clockwise)"
            )
        law = LAWS[choice.name]
        # Raises ValueError here, before the flight, if the gain is too small for a correction.
        law.fed_radius(orbit.speed, orbit.radius, choice.gain)
        sense = orbit.direction.turn_sign
        return cls(law, sense, orbit.speed, orbit.radius, choice.gain, orbit.max_turn_rate)

    def turn_rate(self, r: float, r_dot: float, share: float) -> float:
        """Return the law's turn rate, rad/s. share: factor on the gain, below 1 after a limit
        cycle."""
        law = self.law
        # The paper's laws converge only with a gain above their bound. So a reduction ends at LEAST
        # times the bound, and never raises a gain that the mission chose below it.
        least = min(self.gain, LEAST * law.gain_bound(self.V, self.r_d))
        gain = max(share * self.gain, least)
        fed = law.fed_radius(self.V, self.r_d, gain)
        # As in the paper, k > 0 flies clockwise.
        turn: float = law.function(r, r_dot, V=self.V, r_d=fed, k=-self.sense * gain)
        return turn


class Inputs(NamedTuple):
    """Inputs of one step.

    time: time of the step, s.
    r: range, m.
    r_dot: range rate, m/s.
    pending: commanded turn that is not flown yet.
    relative: relative motion, None if unknown.
    share: factor on the law's gains.
    """

    time: float
    r: float
    r_dot: float
    pending: Pending
    relative: RelativeMotion | None = None
    share: float = 1.0


class ActiveLaw(IntEnum):
    """Law that steers. TRIAL: the drift law with the most likely hypothesis of the target
    position."""

    FEEDFORWARD = 0
    TRIAL = 1
    DRIFT = 2


WHY = {
    ActiveLaw.FEEDFORWARD: "feedforward: no target position yet",
    ActiveLaw.TRIAL: "flying to the likeliest target position",
    ActiveLaw.DRIFT: "drift: target and drift are estimated",
}
LOST = "feedforward: target position lost"
"""Reason for feedforward after the drift law has steered."""


class Handover(NamedTuple):
    """State of the handover between laws.

    flies: law that steered last; None before the first step.
    most_likely: number of the hypothesis flown last; None if no hypothesis was flown.
    command: last command, rad/s.
    offset: rest of the step in the command at the last change of the law, rad/s. It decays to 0.
    untrusted: time since the target position was last trusted, s.
    about: side to which a vehicle that flies away from the target turns back. +1: left, -1: right,
        0: the vehicle does not fly away.
    searched: duration of the present acquisition, s.
    """

    flies: ActiveLaw | None = None
    most_likely: int | None = None
    command: float = 0.0
    offset: float = 0.0
    untrusted: float = 0.0
    about: float = 0.0
    searched: float = 0.0


def next_handover(
    before: Handover,
    dt: float,
    *,
    trusted: bool,
    most_likely: int | None,
    by_range: float,
    drift_turn: float,
    limit: float,
    leaves: float,
) -> Handover:
    """Return the handover state with the command of this step, for the counter-clockwise orbit.

    dt: time since the last step, s.
    trusted: True if the target position may steer.
    most_likely: number of the most likely hypothesis during acquisition, else None.
    by_range: turn rate of feedforward, rad/s.
    drift_turn: turn rate of the drift law, rad/s; valid only while the relative motion is
        available.
    limit: limit of the turn rate, rad/s.
    leaves: degree of flying away from the target, 0 to 1 (`_leaves`).
    """
    if trusted:
        flies = ActiveLaw.DRIFT
        untrusted = searched = leaves = 0.0
        wanted = drift_turn
    else:
        untrusted = before.untrusted + dt
        searched = before.searched + dt
        # 1.0: duration of acquisition, s, after which its most likely hypothesis is flown.
        if most_likely is not None and untrusted >= 1.0 - SAME_TIME:
            flies = ActiveLaw.TRIAL
            wanted = drift_turn
            if untrusted > PATIENCE + SAME_TIME:
                wanted += EXCITATION_SHARE * limit * sin(2 * pi * untrusted / EXCITATION_PERIOD)
        else:
            flies = ActiveLaw.FEEDFORWARD
            wanted = by_range
    on_trial = most_likely if flies is ActiveLaw.TRIAL else None
    wanted = clip(wanted, -limit, limit)
    # A vehicle that flies away from the target turns back by a half circle, to either side. The
    # tightest half circle costs the least distance. Keep the chosen side, because hypotheses and
    # excitation change the sign of the command. Alternating turns would lead straight away from the
    # target.
    about = 0.0
    if leaves > 0:
        keeps = before.about != 0 and untrusted > PATIENCE + SAME_TIME
        about = before.about if keeps else copysign(1.0, wanted)
        wanted += leaves * (about * limit - wanted)
    changed = flies is not before.flies or on_trial != before.most_likely
    if changed and before.flies is not None:
        offset = before.command - wanted
    else:
        offset = before.offset * exp(-dt / FADE)
    command = clip(wanted + offset, -limit, limit)
    return Handover(flies, on_trial, command, offset, untrusted, about, searched)


class StepState(NamedTuple):
    """State between steps.

    time: time of the last command, s.
    handover: state of the handover between laws.
    drift_x, drift_y: smoothed drift, m/s.
    """

    time: float = -inf
    handover: Handover = Handover()
    drift_x: float = 0.0
    drift_y: float = 0.0


def step(
    before: StepState, settings: StepSettings, inputs: Inputs
) -> tuple[StepState, TurnCommand]:
    """Run one guidance step. Return the new state and the turn within the limit."""
    by_range = settings.turn_rate(inputs.r, inputs.r_dot, inputs.share)
    if settings.law.flies_relative_motion:
        return _with_relative_motion(before, settings, inputs, by_range)
    return before._replace(time=inputs.time), limited(by_range, settings.limit)


def _with_relative_motion(
    before: StepState, settings: StepSettings, inputs: Inputs, by_range: float
) -> tuple[StepState, TurnCommand]:
    """Run a step of `auto` or `drift`. by_range: turn rate of feedforward, rad/s.

    The laws are written for the counter-clockwise orbit: their inputs are mirrored to it, and the
    result is mirrored back.
    """
    s = settings.sense
    by_range = s * by_range
    relative = inputs.relative
    last = before.handover
    dt = 0.0
    if before.time > -inf:
        dt = clip(inputs.time - before.time, 0.0, LONGEST_STEP)
    if relative is None:
        # Without relative motion there is no acquisition. For a vehicle without an airspeed sensor,
        # the relative motion is unknown while the vehicle does not follow its commands. Acquisition
        # begins when the vehicle follows again.
        last = last._replace(searched=0.0)
        drift_x = before.drift_x
        drift_y = before.drift_y
        drift_turn = by_range
    else:
        # The difference between the drift and its low-pass gives its rate of change. The low-pass
        # starts when the drift law takes over.
        share = dt / (CHANGE_TIME + dt) if last.flies is ActiveLaw.DRIFT else 1.0
        drift_x = before.drift_x + share * (relative.drift_x - before.drift_x)
        drift_y = before.drift_y + share * (relative.drift_y - before.drift_y)
        change = (
            (relative.drift_x - drift_x) / CHANGE_TIME,
            (relative.drift_y - drift_y) / CHANGE_TIME,
        )
        drift_turn = _by_drift(settings, relative, change, inputs)
    handover = next_handover(
        last,
        dt,
        trusted=relative is not None and relative.trusted,
        most_likely=_tried(last, settings, inputs),
        by_range=by_range,
        drift_turn=drift_turn,
        limit=settings.limit,
        leaves=_leaves(settings, inputs),
    )
    demanded = by_range if handover.flies is ActiveLaw.FEEDFORWARD else drift_turn
    cut = abs(handover.command) >= AT_LIMIT * settings.limit
    after = StepState(inputs.time, handover, drift_x, drift_y)
    return after, TurnCommand(TurnRate(s * handover.command), TurnRate(s * demanded), cut)


def _tried(before: Handover, settings: StepSettings, inputs: Inputs) -> int | None:
    """Return the number of the hypothesis to fly, or None."""
    # If the vehicle is on the circle and the drift is remembered, wait. Circling alone soon
    # separates the hypotheses. A vehicle that flies to a wrong hypothesis would leave the circle.
    relative = inputs.relative
    if relative is None or settings.law.kind is not Kind.AUTO:
        return None
    near = abs(inputs.r - settings.r_d) < NEAR * settings.r_d
    circling = near and abs(inputs.r_dot) < ALONG * settings.V
    # 10.0: duration of acquisition on the circle, s, before a hypothesis is flown.
    patient = before.searched < 10.0 - SAME_TIME
    if relative.drift_remembered and circling and patient:
        return None
    return relative.trial


def _leaves(settings: StepSettings, inputs: Inputs) -> float:
    """Return the degree of flying away from the target. 0: not at all, or the law is not `auto`. 1:
    at LEAVES_FAST or faster."""
    if settings.law.kind is not Kind.AUTO or inputs.r <= settings.r_d:
        return 0.0
    return clip((inputs.r_dot / settings.V - LEAVES) / (LEAVES_FAST - LEAVES), 0.0, 1.0)


def _by_drift(
    settings: StepSettings, relative: RelativeMotion, change: tuple[float, float], inputs: Inputs
) -> float:
    """Return the turn rate (rad/s) of the drift law, for the counter-clockwise orbit. change: rate
    of change of the drift, m/s^2."""
    pending = inputs.pending
    p, d, psi, pending = mirrored(
        (relative.x, relative.y),
        (relative.drift_x, relative.drift_y),
        relative.heading,
        inputs.pending,
        settings.sense,
    )
    V = max(relative.airspeed, 0.1 * settings.V)
    delay = pending.ahead + pending.measurement_delay
    return drift(
        p,
        d,
        psi,
        pending,
        V=V,
        r_d=settings.r_d,
        max_turn_rate=settings.limit,
        gains=drift_gains(V, delay, pending.settles, inputs.share),
        change=mirrored_pair(change, settings.sense),
        lap=lap_plan.plan(d, V=V, r_d=settings.r_d, limit=min(settings.limit, pending.most)),
    )


def coasting(orbit: Orbit, motion: RelativeMotion | None, pending: Pending) -> TurnCommand:
    """Return the steady turn of the circle without any range. If drift and heading are trusted and
    finite, the turn follows from them, else it is V/r_d.

    pending: commanded turn not flown yet; it predicts the heading.
    """
    s = orbit.direction.turn_sign
    turn = orbit.speed / orbit.radius
    if motion is not None and motion.trusted:
        d = mirrored_pair((motion.drift_x, motion.drift_y), s)
        V = max(motion.airspeed, 0.1 * orbit.speed)
        heading = s * (motion.heading + pending.turn)
        if all(map(isfinite, (*d, V, heading))):
            turn = orbit_turn_rate(d, heading, V=V, r_d=orbit.radius)
    return limited(s * turn, orbit.max_turn_rate)


def limited(demanded: float, limit: float) -> TurnCommand:
    """Return the command for a demanded turn rate, limited to +-limit (both in rad/s)."""
    turn = clip(demanded, -limit, limit)
    return TurnCommand(TurnRate(turn), TurnRate(demanded), turn != demanded)


def compensate_turn_gain(command: TurnCommand, limit: float, gain: float) -> TurnCommand:
    """Return the command divided by the vehicle's turn-rate gain, within +-limit (rad/s)."""
    cut = limited(command.turn_rate / gain, limit)
    return command._replace(turn_rate=cut.turn_rate, saturated=command.saturated or cut.saturated)


class Steering:
    """A law with its state: from an estimate to the limited command. Use one instance per
    flight."""

    def __init__(self, orbit: Orbit, law: LawChoice | OwnLaw) -> None:
        """Set the circle and the law. Raises ValueError as `StepSettings.of`, and if a user-defined
        law does not fit."""
        self._state = StepState()
        self._located = False
        """True once the drift law has steered."""
        self._own = None if isinstance(law, LawChoice) else law
        self._limit = orbit.max_turn_rate
        if isinstance(law, LawChoice):
            self.change(orbit, law)

    def change(self, orbit: Orbit, choice: LawChoice) -> None:
        """Steer to another circle from now on. The state is kept, so that a small change is smooth.
        Raises ValueError as `__init__`, and then keeps the circle."""
        settings = StepSettings.of(orbit, choice)
        self._own = settings.law.function(orbit) if settings.law.kind is Kind.OWN else None
        self._settings = settings
        self._at_rest = Pending(0.0, choice.lag)

    def __call__(
        self, estimate: RangeEstimate, pending: Pending | None = None, share: float = 1.0
    ) -> TurnCommand:
        """Return the command. Raises OwnCodeError if a user-defined law fails.

        pending: commanded turn not flown yet. None: there is no such turn, and the delay is the lag
            of the law choice.
        share: factor on the gains.
        """
        if self._own is not None:
            return limited(turn_rate_of(self._own, estimate), self._limit)
        inputs = Inputs(
            estimate.time,
            estimate.r,
            estimate.r_dot,
            pending or self._at_rest,
            estimate.relative,
            share,
        )
        self._state, command = step(self._state, self._settings, inputs)
        flies = self._state.handover.flies
        self._located |= flies is ActiveLaw.DRIFT
        if flies is None or not self._settings.law.flies_relative_motion:
            return command
        lost = self._located and flies is ActiveLaw.FEEDFORWARD
        return command._replace(flies=flies.name.lower(), why=LOST if lost else WHY[flies])
