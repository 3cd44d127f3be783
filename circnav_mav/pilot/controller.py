"""From an estimate to a setpoint message: law, turn-rate gain, setpoint guard, adapter of the
vehicle."""

from collections.abc import Callable
from dataclasses import replace
from math import ceil, tan

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.air_drag import AirspeedHold
from circnav_mav.guidance.circle_change import (
    MIN_INTERVAL,
    SPEED_SHARE,
    CircleRequest,
    obstacle,
)
from circnav_mav.guidance.closed_loop import ClosedLoop
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.limits import LeanLimit
from circnav_mav.guidance.types import GRAVITY, SAME_TIME, Orbit, RangeEstimate, TurnCommand
from circnav_mav.guidance.vehicle_model import VehicleModel
from circnav_mav.mav.autopilots.interface import SetpointContext
from circnav_mav.mav.codec import Message
from circnav_mav.mav.commands import Command
from circnav_mav.mav.frames import (
    YawRate,
    turn_rate_from_yaw_rate,
    yaw_rate_from_turn_rate,
)
from circnav_mav.mav.session import Session
from circnav_mav.mav.setpoint_guard import Limits, SetpointGuard, Steer
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot.mission_state import Phase

RELATIVE = ("auto", "drift")
"""Names of the estimators that estimate the relative motion."""
FlownCommands = Callable[[float], YawRate | None]
"""Function from a time (s) to the last yaw rate that a recorded flight had sent by this time."""


class Controller:
    """Steers the vehicle of a session. Every message that it returns has passed the setpoint
    guard."""

    def __init__(self, settings: Mission) -> None:
        orbit = settings.orbit
        facts = settings.facts
        self._settings = settings
        self.circle = orbit
        """Circle of the mission, or the circle of the newest accepted request."""
        self._spacing = 0.0, 1.0
        """Radius offset, m, and speed factor of the spacing in a fleet."""
        self._tuning = settings.tuning
        lag = settings.tuning.turn_lag
        gain = settings.turn_gain
        link = settings.file.limits.tick
        self.vehicle = VehicleModel(lag, orbit.max_turn_rate, gain=gain, link=link)
        """Model of the vehicle, learned in flight."""
        self._loop = ClosedLoop(orbit, settings.tuning.choice(orbit), self.vehicle)
        self._changed_at = dict.fromkeys((False, True), float("-inf"))
        """Times of the newest change of the circle and of the newest spacing in a fleet, s."""
        stick = ceil(facts.stick(facts.max_bank))
        tilts_by_stick = any(one.tilts_by_stick for one in settings.vehicles)
        if tilts_by_stick:
            stick = ceil(facts.tilt_stick(GRAVITY * tan(facts.max_bank)))
        self._guard = SetpointGuard(
            Limits(
                max_yaw_rate=orbit.max_turn_rate,
                max_speed=orbit.speed
                * (1 if settings.circle_limits.keeps_speed else 1 + SPEED_SHARE),
                max_bank=facts.max_bank,
                max_stick=stick,
                max_pitch_stick=stick if tilts_by_stick else 0,
                max_yaw_stick=1000 if tilts_by_stick else 0,
            )
        )
        self._height: float | None = None
        self.flown: FlownCommands | None = None
        """Commands of the recorded flight, in a replay with another law or estimator. The recorded
        vehicle responded to these commands, not to the replayed commands."""
        self._airspeed = orbit.speed
        """Airspeed that the autopilot was last commanded to hold, m/s."""
        self._wind = 0.0
        """Newest trusted drift, m/s."""
        self.drag = 0.0
        """Drag coefficient of a copter, 1/s, measured in flight."""
        self.drag_coefficient = facts.drag
        """Coefficient of `air_drag` from the mission, 1/s."""
        self.airspeed_hold = AirspeedHold(facts.drag)

    @property
    def orbit(self) -> Orbit:
        """The circle flown now, including the spacing in a fleet."""
        return self._loop.orbit

    @property
    def law(self) -> str:
        """Name of the law: from the mission, or changed by the operator."""
        return self._tuning.law

    @property
    def speed(self) -> float:
        """Speed to command, m/s: V, reduced by the lean limit of a copter."""
        return self.orbit.speed * self.vehicle.lean_limit.share

    def command(
        self, phase: Phase, estimate: RangeEstimate | None, round_trip: float | None, now: float
    ) -> TurnCommand | None:
        """Return the turn command: the command of the law while engaged, the circle's turn rate
        while coasting, else None. round_trip: delay of the link in both directions, s."""
        # 2.0: largest link delay, s, that the gains are tuned for.
        self.vehicle.link = min(
            self._settings.file.limits.tick if round_trip is None else round_trip, 2.0
        )
        motion = None if estimate is None else estimate.relative
        if motion is not None and motion.trusted:
            self._wind = motion.drift
        if phase is Phase.COASTING:
            return self._loop.hold(estimate, now)
        if phase is not Phase.ENGAGED or estimate is None:
            return None
        return self._loop.command(estimate, now)

    def change_circle(self, request: CircleRequest, now: float) -> str:
        """Fly another circle from now on. Return the reason if it cannot be flown, else an empty
        string."""
        # Spacing in a fleet and other changes of the circle have separate timers, so that spacing
        # never delays a change by the operator.
        changed_at = self._changed_at[request.spaces]
        if now - changed_at < MIN_INTERVAL - SAME_TIME:
            ago = f"{now - changed_at:.2f} s ago"
            return (
                f"the last change of the circle was {ago}: wait until {MIN_INTERVAL:g} s have"
                " passed"
            )
        offset, pace = self._spacing
        offset = offset if request.offset is None else request.offset
        pace = pace if request.pace is None else request.pace
        spaces = request.spaces
        request = request._replace(offset=offset, pace=pace)
        wanted = request.applied(self.circle)
        circle = request.circle(self.circle)
        limits = self._settings.circle_limits
        if why := obstacle(request, self.circle, limits, self._wind, self.vehicle.most):
            return why
        try:
            self._loop.change(wanted, self._tuning.choice(wanted))
        except ValueError as error:
            return str(error)
        self.circle = circle
        self._spacing = (offset, pace)
        self._changed_at[spaces] = now
        return ""

    def change_law(self, name: str) -> str:
        """Fly another law from now on, with its default gain. Return the reason if it cannot be
        flown, else an empty string."""
        if LAWS[name].flies_relative_motion and self._settings.estimator not in RELATIVE:
            return f"law {name} needs estimator auto, the mission has {self._settings.estimator}"
        tuning = replace(self._settings.tuning, law=name, gain=None)
        try:
            self._loop.change(self.orbit, tuning.choice(self.orbit))
        except ValueError as error:
            return str(error)
        self._tuning = tuning
        return ""

    def setpoint(
        self, command: TurnCommand, session: Session, now: float
    ) -> tuple[Message, YawRate]:
        """Return the setpoint message for a command, and its yaw rate. Raises
        UnsafeSetpointError."""
        wanted = Steer(yaw_rate_from_turn_rate(command.turn_rate), self.speed)
        steer = self._guard.admit(wanted, now)
        state = self._state(session, now, engaged=True)
        message = self._guard.check_message(
            session.adapter.setpoint(steer, state, now), session.adapter.shapes
        )
        self._command_airspeed(session)
        return message, steer.yaw_rate

    def _command_airspeed(self, session: Session) -> None:
        """Queue the command for a new airspeed, if the autopilot holds the airspeed by such a
        command. A newer command replaces an older command without an answer."""
        if self.speed == self._airspeed:
            return
        self._airspeed = self.speed
        if (number := session.adapter.airspeed_command) is not None:
            session.commands.drop(number)
            session.commands.send(Command(number, (dialect.SPEED_TYPE_AIRSPEED, self.speed)))

    def commanded(self, sent: YawRate, now: float) -> None:
        """Record a yaw rate that was sent, to compare the vehicle's turn with it."""
        responds_to = sent if self.flown is None else self.flown(now)
        if responds_to is not None:
            self.vehicle.command(now, turn_rate_from_yaw_rate(responds_to))

    def safe_setpoint(self, session: Session, now: float, *, engaged: bool = True) -> Message:
        """Return the vehicle's safe setpoint. engaged: True to hold the height of the engagement.
        Raises UnsafeSetpointError."""
        state = self._state(session, now, engaged=engaged)
        return self._guard.check_message(
            session.adapter.safe_setpoint(state, now), session.adapter.shapes
        )

    def hold_airspeed(self, scale: float) -> None:
        """Hold the airspeed from now on. Before, the autopilot held the speed over the ground."""
        self.airspeed_hold.reset(scale)
        self.vehicle.lean_limit = LeanLimit()

    def disengage(self) -> None:
        """End the stream of setpoints. The next setpoint starts a new stream, at a new height."""
        self._loop.reset()
        self._height = None
        self._airspeed = self._settings.orbit.speed  # a mode change restores this airspeed
        self.airspeed_hold.reset(self.airspeed_hold.scale)

    def _state(self, session: Session, now: float, *, engaged: bool) -> SetpointContext:
        """Return the context of a setpoint for the adapter. The height to hold is the altitude at
        the engagement."""
        motion = session.motion.at(now)
        if engaged and self._height is None:
            self._height = motion.altitude
        push = self.airspeed_hold.push(self.speed)
        return SetpointContext(
            *session.vehicle_ids, motion=motion, height=self._height, drag=self.drag, push=push
        )
