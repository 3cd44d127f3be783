"""From an estimate to the bytes' meaning: law, turn-rate gain, choke point, the vehicle's message."""

from dataclasses import replace
from math import ceil, isfinite

from circnav_mav.guidance.circle_change import MIN_INTERVAL, NEAR, SPEED_SHARE, CircleRequest, LapCounter, obstacle
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.lean_limit import LeanLimit
from circnav_mav.guidance.step import Flies, Steering, compensate_turn_gain, holding
from circnav_mav.guidance.turn_response import Response, TurnAnswer
from circnav_mav.guidance.types import SAME_TIME, OwnMotion, RangeEstimate, TurnCommand
from circnav_mav.guidance.watches import next_trim
from circnav_mav.mav.autopilots.interface import Addressee
from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import YawRate, turn_rate_from_yaw_rate, yaw_rate_from_turn_rate
from circnav_mav.mav.session import Session
from circnav_mav.mav.setpoint_guard import Limits, SetpointGuard, Steer
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.pilot.settings import PilotSettings

SPEED_UP = 2.5
"""Time, s, of turning as commanded, after which a vehicle counts as flying at V: a multicopter needs it from standstill
to 5 m/s, and the path of before would be taken for a drift."""
LONGEST_GAP = 1.0
"""Gap between two reports of own motion, s, after which the vehicle may have stopped meanwhile."""
DEAF_AFTER = 1.0
"""Time of not turning as commanded, s, after which a vehicle counts as deaf: a reversed turn takes less."""
DOUBTED_AFTER = 0.7
"""Time of not turning as commanded, s, after which its path is not counted: a turn that swings through zero is
commanded and flown at different moments for as long."""
RELATIVE = ("auto", "drift")
"""Estimators of the relative motion."""
DRIFT = Flies.DRIFT.name.lower()
LONGEST_DELAY = 2.0
"""Most delay of the link, s, that the gains are made for."""
LONGEST_TRIM_STEP = 0.2
"""Most time, s, that the radius integral counts between two steps: a gap is not an error that lasted."""


class Controller:
    """Steers the vehicle of a session. Every message that it gives out has passed the setpoint guard."""

    def __init__(self, settings: PilotSettings) -> None:
        orbit, facts = settings.orbit, settings.facts
        self._settings = settings
        self.orbit = orbit
        """The circle that is flown now."""
        self._tuning = settings.tuning
        self._steer = Steering(orbit, settings.law)
        self._later, self._laps = list(settings.later_radii), LapCounter()
        self._changed_at = float("-inf")
        self._guard = SetpointGuard(
            Limits(
                max_yaw_rate=orbit.max_turn_rate,
                max_speed=orbit.speed * (1 if settings.circle_limits.keeps_speed else 1 + SPEED_SHARE),
                max_bank=facts.max_bank,
                max_stick=ceil(facts.stick(facts.max_bank)),
            )
        )
        lag, gain, link = settings.turn_lag, settings.turn_gain, settings.timing.tick
        self._answer = TurnAnswer(lag, orbit.max_turn_rate, gain=gain, link=link)
        self.turns = self._answer.monitor
        """Compares commanded and flown turns: not followed, or in a limit cycle."""
        self._followed_at = self._slow_at = float("-inf")
        self._height: float | None = None
        self.lean = LeanLimit()
        """Limit of a copter's lean, as found in flight, and the speed that it allows."""
        self.drag = 0.0
        """Of a copter, 1/s, as learnt in flight."""
        self._trim = 0.0
        self._steered: tuple[float, float] | None = None
        """Time, s, and range, m, of the last steered step."""

    @property
    def law(self) -> str:
        """Name of the law that was chosen."""
        return self._tuning.law

    @property
    def turn_gain(self) -> float:
        """Realised over commanded turn rate, as used now."""
        return self._answer.gain

    @property
    def most_turn(self) -> float:
        """Turn rate that the vehicle reaches, rad/s."""
        return self._answer.most

    @property
    def bank_limit(self) -> float | None:
        """Turn rate of the bank beyond which the vehicle does not go, rad/s; None while it does as commanded."""
        found = self._answer.bank_limit.bank
        return found if isfinite(found) else None

    @property
    def speed(self) -> float:
        """Speed to command, m/s: V, or what a copter's lean limit leaves of it."""
        return self.orbit.speed * self.lean.share

    @property
    def response(self) -> Response:
        """How the vehicle answers turn commands, as used now."""
        return self._answer.response

    @property
    def followed(self) -> bool:
        """Whether the vehicle turns as commanded."""
        return bool(self._answer.by_command.followed)

    @property
    def at_speed(self) -> bool:
        """Whether the vehicle has flown as commanded for long enough to have the commanded speed."""
        now = float(self._answer.by_command.time)
        return now - self._followed_at <= DOUBTED_AFTER and now - self._slow_at >= SPEED_UP - SAME_TIME

    def on_motion(self, own: OwnMotion, nose: OwnMotion) -> None:
        """Learn the turn-rate gain and the delay from the vehicle's heading, and whether it flies as commanded. nose:
        motion as it was reported."""
        before = self._answer.by_command.time
        if not self._answer.feel(own):
            return
        self._answer.watch(nose)
        if self.at_speed:
            self.lean = self.lean.follow(own)
        if own.time - before > LONGEST_GAP:
            self._slow_at = self._followed_at = own.time
        if self.followed:
            self._followed_at = own.time
        elif own.time - self._followed_at > DEAF_AFTER:
            self._slow_at = own.time

    def command(
        self, phase: Phase, estimate: RangeEstimate | None, round_trip: float | None, now: float
    ) -> TurnCommand | None:
        """The turn now: the law's while engaged, the circle's own while holding. round_trip: of the link, s."""
        orbit = self.orbit
        self._answer.link = min(self._settings.timing.tick if round_trip is None else round_trip, LONGEST_DELAY)
        motion = estimate.relative if estimate is not None else None
        pending = self._answer.pending(now, 0.0 if motion is None else motion.turn_rate)
        if phase is Phase.ENGAGED and estimate is not None:
            command = self._steer(estimate, self._trim, pending, self.turns.share)
            self._trim_radius(estimate, command)
            if self._later and self._laps.complete(estimate, orbit, command.turn_rate):
                self.change_circle(CircleRequest(radius=self._later.pop(0), by="mission"), now)
        elif phase is Phase.HOLDING:
            command = holding(orbit, motion, pending)
        else:
            return None
        return compensate_turn_gain(command, orbit.max_turn_rate, self.turn_gain)

    def change_circle(self, request: CircleRequest, now: float) -> str:
        """Fly another circle from now on. Return why it cannot be flown, empty if it is."""
        if now - self._changed_at < MIN_INTERVAL - SAME_TIME:
            return f"{now - self._changed_at:.2f} s after the last change, wait {MIN_INTERVAL:g} s"
        wanted = request.applied(self.orbit)
        if why := obstacle(request, self.orbit, self._settings.circle_limits):
            return why
        try:
            self._steer.change(wanted, self._tuning.choice(wanted))
        except ValueError as error:
            return str(error)
        if abs(wanted.radius / self.orbit.radius - 1) > NEAR or wanted.direction is not self.orbit.direction:
            self._trim = 0.0  # it was learned on the circle before
        self.orbit, self._changed_at = wanted, now
        return ""

    def change_law(self, name: str) -> str:
        """Fly another law from now on, with its default gain. Return why it cannot be flown, empty if it is."""
        if LAWS[name].flies_relative_motion and self._settings.estimator not in RELATIVE:
            return f"law {name} needs estimator auto, the mission has {self._settings.estimator}"
        tuning = replace(self._settings.tuning, law=name, gain=None)
        try:
            self._steer.change(self.orbit, tuning.choice(self.orbit))
        except ValueError as error:
            return str(error)
        self._tuning = tuning
        return ""

    def setpoint(self, command: TurnCommand, session: Session, now: float) -> tuple[Message, YawRate]:
        """The message that flies a command, and the yaw rate in it. Raises UnsafeSetpointError."""
        wanted = Steer(yaw_rate_from_turn_rate(command.turn_rate), self.speed)
        steer = self._guard.admit(wanted, now)
        state = self._state(session, now, engaged=True)
        message = self._guard.check_message(session.adapter.setpoint(steer, state, now), session.adapter.shapes)
        return message, steer.yaw_rate

    def commanded(self, sent: YawRate, now: float) -> None:
        """A turn has gone out in a setpoint: the vehicle's answer to it is expected from now on."""
        self._answer.command(now, turn_rate_from_yaw_rate(sent))

    def safe_setpoint(self, session: Session, now: float, *, engaged: bool = True) -> Message:
        """The vehicle's safe setpoint. `engaged` holds the height of the engagement. Raises UnsafeSetpointError."""
        state = self._state(session, now, engaged=engaged)
        return self._guard.check_message(session.adapter.safe_setpoint(state, now), session.adapter.shapes)

    def disengage(self) -> None:
        """End the stream: the next setpoint starts a new one, at a new height."""
        self._answer.reset()
        self._height, self._steered = None, None

    def _trim_radius(self, estimate: RangeEstimate, command: TurnCommand) -> None:
        """Let the slow integral run over the time since the last steered step, while the vehicle follows."""
        before, self._steered = self._steered, (estimate.time, estimate.r)
        # An approach that does not know where the target is closes slowly. Counted as a lasting error, it would be
        # held on the other side of the circle for half a minute afterwards.
        approaches = command.flies not in ("", DRIFT)
        if before is not None and self._settings.radius_trim > 0 and self.followed and not approaches:
            step = estimate.time - before[0]
            self._trim = next_trim(
                self._trim,
                rate=self._settings.radius_trim,
                r=estimate.r,
                change=estimate.r - before[1] if step <= LONGEST_TRIM_STEP else 0.0,
                r_d=self.orbit.radius + command.offset,
                V=self.orbit.speed,
                step=min(step, LONGEST_TRIM_STEP),
                saturated=command.saturated or self._answer.bank_limit.short,
            )

    def _state(self, session: Session, now: float, *, engaged: bool) -> Addressee:
        """What the adapter may know; the height to hold is that at which the vehicle became ours."""
        motion = session.motion.at(now)
        if engaged and self._height is None:
            self._height = motion.altitude
        return Addressee(*session.vehicle_ids, motion=motion, height=self._height, drag=self.drag)
