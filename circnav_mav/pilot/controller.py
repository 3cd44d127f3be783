"""From an estimate to the bytes' meaning: law, turn-rate gain, choke point, the vehicle's message."""

from dataclasses import replace
from math import ceil, isfinite

from circnav_mav.guidance.circle_change import MIN_INTERVAL, NEAR, SPEED_SHARE, CircleRequest, LapCounter, obstacle
from circnav_mav.guidance.closed_loop import ClosedLoop
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.lean_limit import LeanLimit
from circnav_mav.guidance.turn_answer import TurnAnswer
from circnav_mav.guidance.turn_response import Response
from circnav_mav.guidance.types import SAME_TIME, Orbit, OwnMotion, RangeEstimate, TurnCommand, TurnRate
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
LONGEST_DELAY = 2.0
"""Most delay of the link, s, that the gains are made for."""


class Controller:
    """Steers the vehicle of a session. Every message that it gives out has passed the setpoint guard."""

    def __init__(self, settings: PilotSettings) -> None:
        orbit, facts = settings.orbit, settings.facts
        self._settings = settings
        self.circle = orbit
        """The circle of the mission, or the one that was asked for since."""
        self._spacing = 0.0, 1.0
        """Offset, m, and factor of the speed, by which a fleet spaces itself."""
        self._tuning = settings.tuning
        lag, gain, link = settings.turn_lag, settings.turn_gain, settings.timing.tick
        self._answer = TurnAnswer(lag, orbit.max_turn_rate, gain=gain, link=link)
        self._loop = ClosedLoop(orbit, settings.law, self._answer, settings.radius_trim)
        self._later, self._laps = list(settings.later_radii), LapCounter()
        self._changed_at = self._spaced_at = float("-inf")
        self._guard = SetpointGuard(
            Limits(
                max_yaw_rate=orbit.max_turn_rate,
                max_speed=orbit.speed * (1 if settings.circle_limits.keeps_speed else 1 + SPEED_SHARE),
                max_bank=facts.max_bank,
                max_stick=ceil(facts.stick(facts.max_bank)),
            )
        )
        self.turns = self._answer.monitor
        """Compares commanded and flown turns: not followed, or in a limit cycle."""
        self._followed_at = self._slow_at = float("-inf")
        self._height: float | None = None
        self.lean = LeanLimit()
        """Limit of a copter's lean, as found in flight, and the speed that it allows."""
        self.drag = 0.0
        """Of a copter, 1/s, as learnt in flight."""

    @property
    def orbit(self) -> Orbit:
        """The circle that is flown now, with the spacing of a fleet."""
        return self._loop.orbit

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
        if not self._loop.feel(own, nose):
            return
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
        """Return the turn now: of the law while engaged, of the circle while holding. round_trip: of the link, s."""
        self._answer.link = min(self._settings.timing.tick if round_trip is None else round_trip, LONGEST_DELAY)
        if phase is Phase.HOLDING:
            return self._loop.hold(estimate, now)
        if phase is not Phase.ENGAGED or estimate is None:
            return None
        command = self._loop.command(estimate, now)
        if self._later and self._laps.complete(estimate, self.orbit, TurnRate(command.turn_rate * self.turn_gain)):
            self.change_circle(CircleRequest(radius=self._later.pop(0), by="mission"), now)
        return command

    def change_circle(self, request: CircleRequest, now: float) -> str:
        """Fly another circle from now on. Return why it cannot be flown, empty if it is."""
        # Spacing and other changes have clocks of their own: a fleet never makes the operator wait.
        changed_at = self._spaced_at if request.spaces else self._changed_at
        if now - changed_at < MIN_INTERVAL - SAME_TIME:
            return f"{now - changed_at:.2f} s after the last change, wait {MIN_INTERVAL:g} s"
        offset, pace = self._spacing
        offset = offset if request.offset is None else request.offset
        pace = pace if request.pace is None else request.pace
        spaces, request = request.spaces, request._replace(offset=offset, pace=pace)
        wanted, circle = request.applied(self.circle), request.circle(self.circle)
        if why := obstacle(request, self.circle, self._settings.circle_limits):
            return why
        near = abs(circle.radius / self.circle.radius - 1) <= NEAR and circle.direction is self.circle.direction
        try:
            self._loop.change(wanted, self._tuning.choice(wanted), keeps_trim=near)
        except ValueError as error:
            return str(error)
        self.circle, self._spacing = circle, (offset, pace)
        if spaces:
            self._spaced_at = now
        else:
            self._changed_at = now
        return ""

    def change_law(self, name: str) -> str:
        """Fly another law from now on, with its default gain. Return why it cannot be flown, empty if it is."""
        if LAWS[name].flies_relative_motion and self._settings.estimator not in RELATIVE:
            return f"law {name} needs estimator auto, the mission has {self._settings.estimator}"
        tuning = replace(self._settings.tuning, law=name, gain=None)
        try:
            self._loop.change(self.orbit, tuning.choice(self.orbit), keeps_trim=True)
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
        """Expect the vehicle's reaction to a yaw rate that was sent."""
        self._answer.command(now, turn_rate_from_yaw_rate(sent))

    def safe_setpoint(self, session: Session, now: float, *, engaged: bool = True) -> Message:
        """The vehicle's safe setpoint. `engaged` holds the height of the engagement. Raises UnsafeSetpointError."""
        state = self._state(session, now, engaged=engaged)
        return self._guard.check_message(session.adapter.safe_setpoint(state, now), session.adapter.shapes)

    def disengage(self) -> None:
        """End the stream: the next setpoint starts a new one, at a new height."""
        self._loop.reset()
        self._height = None

    def _state(self, session: Session, now: float, *, engaged: bool) -> Addressee:
        """What the adapter may know; the height to hold is that at which the vehicle became ours."""
        motion = session.motion.at(now)
        if engaged and self._height is None:
            self._height = motion.altitude
        return Addressee(*session.vehicle_ids, motion=motion, height=self._height, drag=self.drag)
