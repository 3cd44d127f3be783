"""From an estimate to a turn rate: the law, then the vehicle's limit. One definition for the flight in the air, in
plain floats, and for B flights of an experiment, in arrays."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, isfinite
from types import ModuleType

from circnav_mav.guidance import floats
from circnav_mav.guidance.floats import Flag, Number, magnitude
from circnav_mav.guidance.law_selector import ONE_AT_START, Flies, Handover, hand_over
from circnav_mav.guidance.laws import LAWS, Kind, Law, pi
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
DRIFT_TIME = 0.5
"""Time constant, s, with which the law follows the estimated drift. A few bad ranges in a row move the estimate by 1
m/s for a moment; followed at once, that moved the turn command by 20 deg/s."""
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


@dataclass(frozen=True, slots=True)
class StepSettings:
    """What a step needs to know: a law, and floats or arrays (B,). sense: +1 counter-clockwise. V: m/s. r_d: m. fed:
    the radius that the law is fed, m. k: gain with the sign of the sense (the paper: k > 0 flies clockwise). limit: of
    the turn rate, rad/s."""

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


@dataclass(frozen=True, slots=True)
class Found:
    """Position relative to the target x, y (m), drift (m/s), heading (rad), true airspeed (m/s): in the paper's frame.

    trusted: whether it may steer. trial: number of the guess where it is one, else -1. remembered: whether the drift
    was known before the search.
    """

    x: Number
    y: Number
    drift_x: Number
    drift_y: Number
    heading: Number
    airspeed: Number
    trusted: Flag
    trial: Number = -1
    remembered: Flag = False


@dataclass(frozen=True, slots=True)
class Inputs:
    """What a step goes by. time: s. r, r_dot: m, m/s. found: None without grounds. pending: what is commanded but not
    turned yet. trim: m, added to the radius that the law is fed. share: of the gains that the rule gives."""

    time: float
    r: Number
    r_dot: Number
    pending: Pending
    found: Found | None = None
    trim: Number = 0.0
    share: Number = 1.0


@dataclass(frozen=True, slots=True)
class StepState:
    """What a step remembers: time: of the command before, s, at first -inf; memory: the integral of `pi`, m. drift_x,
    drift_y: as the law follows it, m/s."""

    time: Number = -inf
    memory: Number = 0.0
    handover: Handover = ONE_AT_START
    drift_x: Number = 0.0
    drift_y: Number = 0.0


@dataclass(frozen=True, slots=True)
class Wanted:
    """turn: within the limit, rad/s. demanded: by the law that flies. cut: whether the limit cut it."""

    turn: Number
    demanded: Number
    cut: Flag


def step(
    before: StepState, settings: StepSettings, inputs: Inputs, xp: ModuleType = floats
) -> tuple[StepState, Wanted]:
    """One step of the guidance: what it remembers now, and the turn it wants."""
    gap = xp.clip(inputs.time - before.time, 0.0, LONGEST_STEP)
    dt = xp.where(before.time > -inf, gap, 0.0)
    if settings.law.flies_relative_motion:
        return _with_relative_motion(before, settings, inputs, dt, xp)
    V, k, radius, memory = settings.V, settings.k, settings.fed + inputs.trim, before.memory
    if settings.law.kind is Kind.MEMORY:
        demanded, memory = pi(inputs.r, inputs.r_dot, memory, dt, V=V, r_d=radius, k=k, xp=xp)
    else:
        demanded = settings.law.function(inputs.r, inputs.r_dot, V=V, r_d=radius, k=k, xp=xp)
    return StepState(inputs.time, memory, before.handover), limited(demanded, settings.limit, xp)


def _with_relative_motion(
    before: StepState, settings: StepSettings, inputs: Inputs, dt: Number, xp: ModuleType
) -> tuple[StepState, Wanted]:
    """`auto` and `drift`: see `circnav_mav.guidance.law_selector`. `drift` does not try guesses out. All is seen so
    that the orbit is counter-clockwise; only what leaves has its sense again."""
    s, found, V, radius = settings.sense, inputs.found, settings.V, settings.fed + inputs.trim
    by_range = s * settings.law.function(inputs.r, inputs.r_dot, V=V, r_d=radius, k=settings.k, xp=xp)
    by_drift, drift_x, drift_y = by_range, before.drift_x, before.drift_y
    trusted: Flag = False
    if found is not None:
        drift_x, drift_y = _followed(before, found, dt, xp)
        found = replace(found, drift_x=drift_x, drift_y=drift_y)
        by_drift, trusted = _by_drift(settings, found, inputs, xp), found.trusted
    handover = hand_over(
        before.handover, dt, trusted=trusted, favourite=_tried(before.handover, settings, inputs, xp),
        by_range=by_range, by_bank=by_drift, limit=settings.limit, r=inputs.r, r_d=settings.r_d, xp=xp,
    )  # fmt: skip
    demanded = xp.where(handover.flies == Flies.FEEDFORWARD, by_range, by_drift)
    cut = magnitude(handover.command) >= AT_LIMIT * settings.limit
    after = StepState(inputs.time, before.memory, handover, drift_x, drift_y)
    return after, Wanted(s * handover.command, s * demanded, cut)


def _followed(before: StepState, found: Found, dt: Number, xp: ModuleType) -> tuple[Number, Number]:
    """The drift that the law follows: smoothed while the relative motion is trusted, at once where it steers first."""
    goes_on, share = before.handover.flies == Flies.DRIFT, dt / (DRIFT_TIME + dt)
    x, y, now_x, now_y = before.drift_x, before.drift_y, found.drift_x, found.drift_y
    return (
        xp.where(goes_on, x + share * (now_x - x), now_x),
        xp.where(goes_on, y + share * (now_y - y), now_y),
    )


def _tried(before: Handover, settings: StepSettings, inputs: Inputs, xp: ModuleType) -> Number:
    """Number of the guess that is worth flying at; -1: none. On the circle, with the drift known from before, the
    circle itself soon tells the guesses apart, and trying a wrong one would leave it."""
    found = inputs.found
    if found is None or settings.law.kind is not Kind.AUTO:
        return -1
    near = magnitude(inputs.r - settings.r_d) < NEAR * settings.r_d
    circling = near & (magnitude(inputs.r_dot) < ALONG * settings.V)
    patient = before.untrusted < CIRCLING_PATIENCE - SAME_TIME
    waits = found.remembered & circling & patient
    return xp.where(waits, -1, found.trial)


def _by_drift(settings: StepSettings, found: Found, inputs: Inputs, xp: ModuleType) -> Number:
    """The drift law, seen so that the orbit is counter-clockwise."""
    p, d, sense = (found.x, found.y), (found.drift_x, found.drift_y), settings.sense
    here = mirrored(p, d, found.heading, inputs.pending, sense)
    V, r_d = xp.maximum(found.airspeed, 0.1 * settings.V), settings.r_d + inputs.trim
    gains = drift_gains(V, inputs.pending.ahead, inputs.pending.settles, inputs.share, xp)
    return drift(*here, V=V, r_d=r_d, max_turn_rate=settings.limit, gains=gains, xp=xp)


def hold(settings: StepSettings, found: Found | None, pending: Pending, xp: ModuleType = floats) -> Wanted:
    """The circle's own turn, which no range enters: V/r_d; where the drift is trusted, what drift and heading ask for.

    pending: what is commanded but not turned yet, by which the heading is looked ahead.
    """
    s, turn = settings.sense, settings.V / settings.r_d
    if found is not None:
        d, V = (found.drift_x, s * found.drift_y), xp.maximum(found.airspeed, 0.1 * settings.V)
        heading = s * (found.heading + pending.turn)
        turn = xp.where(found.trusted, orbit_turn_rate(d, heading, V=V, r_d=settings.r_d, xp=xp), turn)
    return limited(s * turn, settings.limit, xp)


def limited(demanded: Number, limit: Number, xp: ModuleType = floats) -> Wanted:
    """A demand cut to +-limit, both in rad/s."""
    turn = xp.clip(demanded, -limit, limit)
    return Wanted(turn, demanded, turn != demanded)


def compensated(wanted: Wanted, limit: Number, gain: Number, xp: ModuleType = floats) -> Wanted:
    """What to command to vehicles that turn at `gain` times what is commanded, within +-limit (rad/s)."""
    commanded = limited(wanted.turn / gain, limit, xp)
    return Wanted(commanded.turn, wanted.demanded, wanted.cut | commanded.cut)


Steering = Callable[[RangeEstimate, float, Pending | None, float], TurnCommand]
"""A law ready to steer: the limited command from an estimate, a trim (m, added to the radius that the law is fed), what
is commanded but not turned yet (None: nothing, by a vehicle with the lag of the choice) and a share of the gains."""


def steering(orbit: Orbit, choice: LawChoice) -> Steering:
    """The mission's guidance as one function from estimate to limited command.

    It remembers: give every flight its own. Raises ValueError when the radius correction does not exist for this gain.
    """
    settings, at_rest = StepSettings.of(orbit, choice), Pending(0.0, choice.lag)
    state = StepState()

    def steer(
        estimate: RangeEstimate, trim: float = 0.0, pending: Pending | None = None, share: float = 1.0
    ) -> TurnCommand:
        nonlocal state
        found = None if estimate.relative is None else _found(estimate.relative)
        inputs = Inputs(estimate.time, estimate.r, estimate.r_dot, pending or at_rest, found, trim, share)
        state, wanted = step(state, settings, inputs)
        if not settings.law.flies_relative_motion:
            return _command(wanted)
        flies = state.handover.flies
        return _command(wanted, flies.name.lower(), flies.why)

    return steer


def holding(orbit: Orbit, motion: RelativeMotion | None, pending: Pending) -> TurnCommand:
    """`hold` of one flight; without trusted, finite relative motion V/r_d."""
    found = None
    if motion is not None and motion.trusted:
        carried = motion.drift_x, motion.drift_y, motion.heading, motion.turn_rate, motion.airspeed
        found = _found(motion) if all(map(isfinite, carried)) else None
    return _command(hold(StepSettings.of(orbit, LawChoice("drift", 0.0)), found, pending))


def _found(motion: RelativeMotion) -> Found:
    return Found(
        motion.x, motion.y, motion.drift_x, motion.drift_y, motion.heading, motion.airspeed, motion.trusted,
        -1 if motion.trial is None else motion.trial, motion.drift_remembered,
    )  # fmt: skip


def _command(wanted: Wanted, flies: str = "", why: str = "") -> TurnCommand:
    turn, demanded = TurnRate(float(wanted.turn)), TurnRate(float(wanted.demanded))
    return TurnCommand(turn, demanded, bool(wanted.cut), flies=flies, why=why)


def limit(demanded: TurnRate, max_turn_rate: float) -> TurnCommand:
    """Cut a turn rate to the vehicle's limit, both in rad/s, and say whether it was cut."""
    return _command(limited(demanded, max_turn_rate))


def compensate_turn_gain(command: TurnCommand, max_turn_rate: float, gain: float) -> TurnCommand:
    """`compensated` of one command."""
    wanted = Wanted(command.turn_rate, command.demanded, command.saturated)
    return _command(compensated(wanted, max_turn_rate, gain), command.flies, command.why)
