"""Controller of the vehicle, and setpoints that may be sent. The operator always has priority.

`Authority.allowed` permits setpoints only while the controller of the vehicle (`Holder`) is
confirmed.
"""

from enum import Enum

from circnav_mav.mav.session import Session
from circnav_mav.mav.vehicle_state import Change
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot.airborne import Airborne
from circnav_mav.pilot.mission_state import NOT_OURS, Ending, MissionState, Outcome, Phase
from circnav_mav.pilot.mode_request import ModeRequest
from circnav_mav.pilot.stalls import Stalls
from circnav_mav.timers import Hysteresis

GIVEN_AFTER = 1.5
"""Time, s, for which all reports must show the guided mode before circnav takes control again. A
mode switch may pass through the guided mode, and older reports may arrive late over another
link."""
TAKEN_OVER = "taken over"
"""First words of all STATUSTEXTs about a takeover. Charts use them to mark the event."""
SILENT = 1.5
"""Age of the vehicle's newest mode report, s, above which the operator may have taken over."""


class Holder(Enum):
    """Controller of the vehicle once a flight has begun."""

    US = "circnav: in the guided mode it may steer"
    OPERATOR_IN_MODE = "the operator, without leaving the guided mode (disarmed, rebooted)"
    OPERATOR = (
        "the operator, after leaving the guided mode: entering that mode again gives control back"
        " to circnav"
    )


class Allowed(Enum):
    """Setpoint that may be sent now."""

    NOTHING = "nothing"
    SAFE = "the safe setpoint"
    STEER = "a steering setpoint"


TAKEOVERS = {
    (False, False): (Holder.OPERATOR_IN_MODE, "vehicle disarmed", Ending.ABORTED),
    (False, True): (Holder.OPERATOR, "{guided} left for {mode}", Ending.TAKEN_OVER),
    (True, False): (Holder.OPERATOR_IN_MODE, "autopilot rebooted", Ending.ABORTED),
    (True, True): (Holder.OPERATOR, "autopilot rebooted", Ending.ABORTED),
}
"""Controller, text and ending after a takeover. Key: the autopilot rebooted, the vehicle left the
guided mode."""


class Authority:
    """Tracks the controller of the vehicle. Another mode, disarming or a reboot ends our
    control."""

    def __init__(
        self,
        settings: Mission,
        session: Session,
        mission: MissionState,
        airborne: Airborne,
        *,
        flies: bool,
    ) -> None:
        self._settings = settings
        self._airborne = airborne
        self._session = session
        self._mission = mission
        self._flies = flies
        self.holder = Holder.US
        self._given_back = Hysteresis(GIVEN_AFTER)
        """Reports of the guided mode after the operator had left it."""
        self._stalls = Stalls()
        self._backlog_at: float | None = None
        """Time of the newest step whose data may date from a gap between steps, s."""
        self.broken_bound: str | None = None
        """Description of a bound of the mission that is violated now, or None."""
        self._request = ModeRequest()
        self._asked_in: int | None = None
        """Mode of the vehicle when the guided mode was first requested."""
        self._operator_chose = False
        """True if the operator, or a failsafe, has changed the mode since that request."""

    # --- setpoints that may be sent

    def allowed(self, now: float) -> Allowed:
        """Return the setpoint that may be sent in this step."""
        if not self._flies or not self.certain:
            return Allowed.NOTHING
        if self._mission.steering:
            return Allowed.STEER
        leaves = self._mission.phase is Phase.LEAVING and (self._mission.begun or self.in_our_hands)
        if leaves or self._streams_first(now):
            return Allowed.SAFE
        return Allowed.NOTHING

    @property
    def certain(self) -> bool:
        """True if the vehicle's identity and its controller are confirmed. Always true in a dry
        run."""
        return not self._flies or (self._reported and not self._session.vehicle.unproven)

    @property
    def _reported(self) -> bool:
        """True if the vehicle has reported its mode since the last gap between steps."""
        return self._backlog_at is None or self._session.vehicle.heartbeat_at > self._backlog_at

    @property
    def in_our_hands(self) -> bool:
        """True if the vehicle is in the guided mode and under our control: it was engaged, or we
        requested the mode."""
        may = self._mission.begun or self._came_at_our_request
        return (
            may and self._flies and self.holder is Holder.US and self._session.vehicle.in_our_mode
        )

    def may_be_ours(self, now: float) -> bool:
        """True if the mission must end with the exit action: the vehicle is under our control, or
        its next heartbeat may confirm our mode request."""
        return self.in_our_hands or (self._came_at_our_request and self._request.pending(now))

    @property
    def _came_at_our_request(self) -> bool:
        """True if a vehicle that is in the guided mode now has entered it at our request."""
        return self._asked_in is not None and not self._operator_chose

    def may_send_last_frames(self) -> bool:
        """True if the caller may send the safe setpoint after an internal error of `Pilot`."""
        return (
            self.in_our_hands
            and self._mission.phase not in NOT_OURS
            and not self._session.vehicle.unproven
        )

    def may_request_exit(self, now: float) -> bool:
        """True if the caller may also request the exit action. The vehicle obeys a mode request
        even after a takeover, so its controller must be confirmed."""
        return (
            self.certain
            and not self.may_be_backlog(now)
            and self._session.heartbeat_age(now) < SILENT
        )

    # --- conditions of an engagement

    def obstacle(self, now: float) -> str:
        """Return the first of the obstacles, or an empty string."""
        return next(iter(self.obstacles(now)), "")

    def obstacles(self, now: float) -> list[str]:
        """Return texts about the conditions that must be met before the vehicle is engaged."""
        texts = (self._operator_control(), *self._hindrances(now), self._missing_mode())
        return [text for text in texts if text]

    def _operator_control(self) -> str:
        """Return a text if the operator has control, else an empty string."""
        if self.holder is Holder.US:
            return ""
        guided = self._session.adapter.guided_name
        leave = f"leave {guided} and enter it" if self.holder is Holder.OPERATOR_IN_MODE else ""
        enter = leave or f"enter {guided}"
        return f"the operator has control: {enter} again to give control to circnav"

    def _missing_mode(self) -> str:
        """Return a text if the vehicle is not armed in the guided mode, else an empty string."""
        vehicle = self._session.vehicle
        if vehicle.in_our_mode:
            return ""
        if not vehicle.armed:
            return "the vehicle is not armed"
        enter = "requested" if self._asks_for_mode else "the operator must enter it"
        return f"mode {self._session.adapter.guided_name}: {enter}"

    def _hindrances(self, now: float, *, over_slow_link: bool = False) -> list[str]:
        """Return the reasons why the vehicle cannot be steered, regardless of its controller and
        mode."""
        session = self._session
        begun = self._mission.begun
        rivals = [] if begun else session.identity.second_senders.recent(now)[:1]
        disputed = [f"{one}: select yours by link.peer, or sign" for one in rivals]
        # Do not engage outside a bound: an engagement would command the exit action at once, and a
        # vehicle that hovers too far away would land or fly home. A flight that resumes after a
        # lost link is under our control and ends by the exit action.
        outside = "" if self._goes_on or not self.broken_bound else f"[bounds]: {self.broken_bound}"
        texts = (
            *disputed,
            "" if begun else session.contested(now),
            "" if over_slow_link else self._slow_link(now),
            unreported(session, now),
            unwatched(self._settings, session, now),
            outside,
            self._not_flying(now),
        )
        return [text for text in texts if text]

    def _slow_link(self, now: float) -> str:
        """Return a text if the round trip exceeds the mission's bound before the first engagement,
        else an empty string."""
        trip = self._session.timesync
        most = self._settings.slowest_answer
        if self._mission.begun or (trip.settled(now) and (trip.typical or 0.0) <= most):
            return ""
        if trip.typical is None:
            return "measuring the round-trip time of the link (TIMESYNC)"
        return (
            f"link too slow: round trip {trip.typical:.2f} s (at most {most:g} s, 1.2 times"
            " limits.stale_s)"
        )

    def _not_flying(self, now: float) -> str:
        """Return a text if an aircraft does not fly yet, else an empty string."""
        vehicle = self._session.vehicle
        # The vehicle was under our control before the link was lost, so its flight is established.
        if self._goes_on and vehicle.armed and not vehicle.on_ground(now):
            return self._airborne.resumes(now)
        obstacle = self._airborne.obstacle(now)
        return "" if obstacle is None else obstacle.long

    @property
    def _goes_on(self) -> bool:
        """True if a flight resumes after a lost link."""
        return self._mission.begun and self._mission.phase is Phase.READY

    def _streams_first(self, now: float) -> bool:
        """True if setpoints are sent before the engagement. False after a takeover, on the ground
        or without required telemetry."""
        # PX4 enters OFFBOARD only while it receives setpoints, and ignores them in other modes.
        # Over a slow link no setpoints are sent, so that PX4 rejects OFFBOARD.
        session = self._session
        if self._mission.phase is not Phase.READY or not session.adapter.wants_setpoints_in(
            session.vehicle.mode
        ):
            return False
        return self.holder is Holder.US and not self._hindrances(
            now, over_slow_link=session.vehicle.in_our_mode
        )

    # --- request of the guided mode

    def ask_for_mode(self, now: float) -> str | None:
        """Request the guided mode if only the mode is missing for the first engagement. Return the
        reason if the autopilot has finally refused the mode, else None."""
        session = self._session
        adapter = self._session.adapter
        mission = self._mission
        asks = (
            self._asks_for_mode
            and self._flies
            and not mission.begun
            and mission.phase is Phase.READY
        )
        if not asks or session.vehicle.mode == adapter.guided_mode or self._hindrances(now):
            session.drop_mode_requests()
            return None
        self._asked_in = session.vehicle.mode if self._asked_in is None else self._asked_in
        failure = self._request.ask(session, adapter.guided_mode, now)
        return None if failure is None else f"mode {adapter.guided_name} {failure}"

    @property
    def _asks_for_mode(self) -> bool:
        """True if the guided mode may be requested. If another mode was chosen since the first
        request, a new request would override the operator or a failsafe."""
        return self._settings.file.engage.request_mode and not self._operator_chose

    # --- controller of the vehicle

    def watch_takeover(self, changes: set[Change], now: float) -> tuple[str, Outcome] | None:
        """Return a takeover detected in this step, as STATUSTEXT and as outcome, or None. changes:
        changes of the vehicle's state since the last step."""
        session = self._session
        vehicle = session.vehicle
        rebooted = Change.REBOOTED in changes
        departed = not changes.isdisjoint((Change.LEFT, Change.DISARMED))
        outside = session.up and vehicle.mode not in (None, *session.adapter.our_modes)
        left_for = vehicle.mode_name if outside else vehicle.left_for if departed else None
        in_mode = vehicle.in_our_mode and not departed
        if self._asked_in is not None:
            self._operator_chose |= departed or (outside and vehicle.mode != self._asked_in)
        was_ours = self._has_control
        self._watch_return(left=left_for is not None, in_mode=in_mode)
        if not was_ours or (in_mode and not rebooted):
            return None
        self.holder, text, ending = TAKEOVERS[rebooted, left_for is not None]
        what = f"{TAKEN_OVER}, {text.format(guided=session.adapter.guided_name, mode=left_for)}"
        if ending is Ending.ABORTED:
            return what, Outcome(ending, what)
        # The heartbeat does not show the cause of a mode change. `report.html` contains the
        # autopilot's message about a failsafe.
        flown = now - (self._mission.engaged_at or now)
        return what, Outcome(
            ending, f"pilot or failsafe switched to {left_for} after {flown:.0f} s"
        )

    @property
    def _has_control(self) -> bool:
        """True if circnav controls a vehicle that it has engaged.

        circnav keeps the control while the link is lost. It also has the control if the operator
        has given it back but the vehicle cannot be steered yet.
        """
        ours = self.holder is Holder.US or self._mission.phase not in (
            Phase.WAIT_LINK,
            Phase.YIELDED,
        )
        return ours and self._mission.begun and self._flies and self._session.up

    def _watch_return(self, *, left: bool, in_mode: bool) -> None:
        """Detect that the operator gives control back: the vehicle leaves the guided mode, enters
        it again and stays in it for GIVEN_AFTER."""
        if left and self.holder is Holder.OPERATOR_IN_MODE:
            self.holder = Holder.OPERATOR
        again = in_mode and self.holder is Holder.OPERATOR
        if self._given_back.update(again, self._session.vehicle.received_at):
            self.holder = Holder.US
            self._given_back.clear()

    # --- confirmation after gaps

    def stepped(self, now: float) -> bool:
        """Begin a step. Return True if received data may date from a gap between steps.

        After such a gap, assume that the operator may have taken over, until a heartbeat reports
        the vehicle's mode.
        """
        backlog = self.may_be_backlog(now)
        self._stalls.step(now)
        if backlog:
            self._backlog_at = now
            self._session.drop_mode_requests()
        return backlog

    def stalled(self, now: float) -> float:
        """Return the length of the newest stall, s, as long as it has effects, else 0."""
        return self._stalls.length(now)

    def may_be_backlog(self, now: float) -> bool:
        """True if data received now may date from a gap between steps."""
        return self._stalls.may_be_backlog(now)


def unreported(session: Session, now: float) -> str:
    """Return a text about required telemetry that is missing, or an empty string."""
    if not (missing := session.missing(now)):
        return ""
    name = session.adapter.name
    return (
        f"no {' and no '.join(missing)} in VFR_HUD: a {name} cannot be flown without"
        f" it{denied(session)}"
    )


def unwatched(settings: Mission, session: Session, now: float) -> str:
    """Return a text about missing telemetry that a bound of the mission needs, or an empty
    string."""
    bounds = settings.file.bounds
    if (bounds.min_altitude_m, bounds.max_altitude_m) != (None, None) and session.motion.at(
        now
    ).altitude is None:
        return "no altitude above sea level: bounds.min_altitude_m and max_altitude_m need it"
    if bounds.min_battery_percent is not None and session.vehicle.battery(now) is None:
        return "no battery in SYS_STATUS: bounds.min_battery_percent needs it"
    return ""


def denied(session: Session) -> str:
    """Return a text about the streams that the vehicle denied, to be appended to a text about
    missing telemetry."""
    return (
        f"; streams denied by the vehicle: {', '.join(session.streams.refused)}"
        if session.streams.refused
        else ""
    )
