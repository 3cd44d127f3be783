"""Whose the vehicle is, and what we may send to it. The operator always wins.

Who holds the vehicle (`Holder`) and whether that is known for certain now make one answer: `Authority.allowed`.
"""

from enum import Enum

from circnav_mav.mav.session import Session
from circnav_mav.pilot.mission_state import NOT_OURS, MissionState, Phase
from circnav_mav.pilot.mode_request import ModeRequest
from circnav_mav.pilot.settings import OutputMode, PilotSettings

GIVEN_AFTER = 1.5
"""Time, s, for which the vehicle must have reported nothing but the guided mode, from one report to a later one, before
it is given back: a switch may pass through that mode, and what was reported before it was left may come late by another
way, between newer reports."""
TAKEN_OVER = "taken over"
"""How texts of a takeover begin, on the link and as the reason of an end; charts mark by it."""
LANDED_PATIENCE = 1.5
"""Time, s, that a vehicle is given to report whether it flies before the first engagement."""
STALL = 0.5
"""Gap between two steps, s, after which everything that came in during it counts as stale."""
CATCH_UP = 0.2
"""Time after it, s, in which what comes in may still be from before: it takes a few turns to read it all."""
SILENT = 1.5
"""Age of the vehicle's newest report of its mode, s, above which it may be in other hands."""


class Holder(Enum):
    """Who holds the vehicle once a flight has begun."""

    US = "we: the guided mode means that we may steer"
    OPERATOR_IN_MODE = "the operator, and the guided mode was not left since (disarmed, rebooted)"
    OPERATOR = "the operator, and the guided mode was left since: entering it again gives the vehicle back"


class Allowed(Enum):
    """What setpoint may leave now."""

    NOTHING = "nothing"
    SAFE = "the safe setpoint"
    STEER = "one that steers"


class Authority:
    """Watches who holds the vehicle: a mode that is not ours, disarming or a reboot takes it from us."""

    def __init__(self, settings: PilotSettings, session: Session, mission: MissionState) -> None:
        self._settings = settings
        self._session = session
        self._mission = mission
        self._flies = settings.output_mode is OutputMode.FLY
        self.holder = Holder.US
        self.rebooted = False
        """Whether the autopilot has rebooted before the last look at it."""
        self._departures = self._reboots = 0
        self._back_since: float | None = None
        """Since when the vehicle reports the guided mode that the operator had left, s."""
        self._stepped: float | None = None
        self._backlog_until = float("-inf")
        self._confirmed = True
        """Whether the vehicle has reported its mode since we last stood still."""
        self._heartbeats = 0
        self._request = ModeRequest()
        self._asked_in: int | None = None
        """The mode of the vehicle when the guided one was first asked for."""
        self._operator_chose = False
        """Whether the operator, or a failsafe, has chosen a mode since."""

    # --- what may be sent -------------------------------------------------------------------------------------------

    def allowed(self, now: float) -> Allowed:
        """What setpoint may leave in this step."""
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
        """Whether the vehicle is known to be the one of before, and in whose hands it is; who sends no setpoints need
        not know."""
        return not self._flies or (self._confirmed and not self._session.vehicle.unproven)

    @property
    def in_our_hands(self) -> bool:
        """Whether the vehicle obeys us, and may: once engaged, or at our own request."""
        may = self._mission.begun or self._came_at_our_request
        return may and self._flies and self.holder is Holder.US and self._session.vehicle.in_our_mode

    def may_be_ours(self, now: float) -> bool:
        """Whether the vehicle is to be given back at the end: it obeys us, or may in a moment, for it was just asked to
        and its next heartbeat will tell."""
        return self.in_our_hands or (self._came_at_our_request and self._request.pending(now))

    @property
    def _came_at_our_request(self) -> bool:
        """Whether the guided mode, if the vehicle is in it, is what we asked for."""
        return self._asked_in is not None and not self._operator_chose

    def may_say_last_words(self) -> bool:
        """Whether the safe setpoint may be sent by a shell whose pilot has failed."""
        return self.in_our_hands and self._mission.phase not in NOT_OURS and not self._session.vehicle.unproven

    def may_ask_for_exit(self, now: float) -> bool:
        """Whether that shell may ask for the exit action, too: a mode is obeyed whoever has the vehicle."""
        return self.certain and not self.may_be_backlog(now) and self._session.heartbeat_age(now) < SILENT

    # --- what it waits for ------------------------------------------------------------------------------------------

    def may_engage(self, now: float) -> bool:
        """Whether the vehicle may be steered from now on; a pilot that sends no setpoints needs nobody's leave. Once
        engaged, a slow link or a landing stops nothing."""
        return not self._flies or not self.obstacle(now)

    def obstacle(self, now: float) -> str:
        """What an engagement waits for, for people; empty for nothing."""
        vehicle, guided = self._session.vehicle, self._session.adapter.guided_name
        if self.holder is not Holder.US:
            enter = f"leave {guided} and enter it" if self.holder is Holder.OPERATOR_IN_MODE else f"enter {guided}"
            return f"the operator has the vehicle: {enter} again to hand it back"
        if hindrance := self._hindrance(now):
            return hindrance
        if vehicle.in_our_mode:
            return ""
        enter = "requested" if self._asks_for_mode else "the operator must enter it"
        return f"mode {guided}: {enter}" if vehicle.armed else "the vehicle is not armed"

    def _hindrance(self, now: float, *, over_slow_link: bool = False) -> str:
        """Why the vehicle cannot be steered, whoever has it and whatever its mode."""
        rivals = [] if self._mission.begun else self._session.identity.rivals.recent(now)
        disputed = f"{rivals[0]}: name yours with link.peer, or sign" if rivals else ""
        slow = "" if over_slow_link else self._slow_link(now)
        silent = unreported(self._session, now) or unwatched(self._settings, self._session, now)
        return disputed or slow or silent or self._not_flying(now)

    def _slow_link(self, now: float) -> str:
        """Question and answer must be within the mission's bound before the first engagement."""
        trip, most = self._session.timesync, self._settings.timing.round_trip
        if self._mission.begun or (trip.settled(now) and (trip.typical or 0.0) <= most):
            return ""
        if trip.typical is None:
            return "measuring the round trip to the vehicle (TIMESYNC)"
        return f"link too slow: round trip {trip.typical:.2f} s (at most {most:g} s, 1.2 times limits.stale_s)"

    def _not_flying(self, now: float) -> str:
        """An aircraft is not steered before it flies, for the first time or again; one that does not say whether it
        does is given a moment to, unless it was ours until the link was lost."""
        session, vehicle = self._session, self._session.vehicle
        if not session.adapter.flies:
            return ""
        if vehicle.on_ground:
            return "the vehicle is on the ground"
        if not vehicle.armed:
            return "the vehicle is not armed"
        goes_on = self._mission.begun and self._mission.phase is Phase.READY
        silent = vehicle.on_ground is None and not goes_on and now - session.identity.since < LANDED_PATIENCE
        return "the vehicle has not reported that it flies" if silent else ""

    def _streams_first(self, now: float) -> bool:
        """Whether setpoints go out before the engagement: PX4 enters our mode only while they flow, and does not fly
        them until then. Never after a takeover, on the ground or blind; over a slow link, it shall refuse the mode."""
        session = self._session
        if self._mission.phase is not Phase.READY or not session.adapter.wants_setpoints_in(session.vehicle.mode):
            return False
        return self.holder is Holder.US and not self._hindrance(now, over_slow_link=session.vehicle.in_our_mode)

    # --- asking for the guided mode ---------------------------------------------------------------------------------

    def ask_for_mode(self, now: float) -> str | None:
        """Ask for the guided mode in the air with all else ready, and never again once the flight has begun; answers
        with the reason why it is of no use."""
        session, adapter, mission = self._session, self._session.adapter, self._mission
        asks = self._asks_for_mode and self._flies and not mission.begun and mission.phase is Phase.READY
        if not asks or session.vehicle.mode == adapter.guided_mode or self._hindrance(now):
            session.drop_mode_requests()
            return None
        self._asked_in = session.vehicle.mode if self._asked_in is None else self._asked_in
        failure = self._request.ask(session, adapter.guided_mode, now)
        return None if failure is None else f"mode {adapter.guided_name} {failure}"

    @property
    def _asks_for_mode(self) -> bool:
        """Whether the mode is ours to ask for. Once any other was chosen since the first request, it is the operator's:
        asked for again, it would undo his word or a failsafe's."""
        return self._settings.request_mode and not self._operator_chose

    # --- who holds the vehicle --------------------------------------------------------------------------------------

    def watch_takeover(self) -> tuple[str, str] | None:
        """What took the vehicle from us, if it was ours until now: as STATUSTEXT, and for the record."""
        session, vehicle = self._session, self._session.vehicle
        # a vehicle that we held is ours also where it was lost, or was given back and cannot be steered yet
        ours = self.holder is Holder.US or self._mission.phase not in (Phase.WAIT_LINK, Phase.YIELDED)
        departed, self._departures = vehicle.departures > self._departures, vehicle.departures
        self.rebooted, self._reboots = vehicle.reboots > self._reboots, vehicle.reboots
        outside = session.up and vehicle.mode is not None and vehicle.mode != session.adapter.guided_mode
        left_for = vehicle.mode_name if outside else vehicle.left_for if departed else None
        in_mode = vehicle.in_our_mode and not departed
        if self._asked_in is not None:
            self._operator_chose |= departed or (outside and vehicle.mode != self._asked_in)
        self._watch_return(left=left_for is not None, in_mode=in_mode)
        if not (ours and self._mission.begun and self._flies and session.up) or (in_mode and not self.rebooted):
            return None
        self.holder = Holder.OPERATOR_IN_MODE if left_for is None else Holder.OPERATOR
        if self.rebooted or left_for is None:
            what = f"{TAKEN_OVER}, {'autopilot rebooted' if self.rebooted else 'vehicle disarmed'}"
            return what, what
        what = f"{TAKEN_OVER}, {session.adapter.guided_name} left for {left_for}"
        return what, f"{what}: operator or failsafe"

    def _watch_return(self, *, left: bool, in_mode: bool) -> None:
        """The operator gives the vehicle back: he leaves the guided mode, enters it again, and it lasts."""
        reported_at = self._session.vehicle.heard_at
        if left and self.holder is Holder.OPERATOR_IN_MODE:
            self.holder = Holder.OPERATOR
        if not in_mode or self.holder is not Holder.OPERATOR:
            self._back_since = None
        elif self._back_since is None:
            self._back_since = reported_at
        elif reported_at - self._back_since >= GIVEN_AFTER:
            self.holder = Holder.US

    # --- what we know of it -----------------------------------------------------------------------------------------

    def stepped(self, now: float) -> bool:
        """A step begins; tells whether what came in may have waited while we stood still. After that the vehicle may
        be in other hands until a heartbeat has reported its mode."""
        heartbeats, backlog = self._session.vehicle.heartbeats, self.may_be_backlog(now)
        if self._stood_still(now):
            self._backlog_until = now + CATCH_UP
        if backlog:
            self._confirmed, self._heartbeats = False, heartbeats
            self._session.drop_mode_requests()
        else:
            self._confirmed |= heartbeats > self._heartbeats
        self._stepped = now
        return backlog

    def may_be_backlog(self, now: float) -> bool:
        """Whether what comes in now may have waited while we stood still."""
        return now < self._backlog_until or self._stood_still(now)

    def _stood_still(self, now: float) -> bool:
        return self._stepped is not None and now - self._stepped > STALL


def unreported(session: Session, now: float) -> str:
    """What the vehicle does not report although it must, for people; empty where nothing is missing."""
    if not (missing := session.missing(now)):
        return ""
    name = session.adapter.name
    return f"no {' and no '.join(missing)} in VFR_HUD: a {name} cannot be flown without it{denied(session)}"


def unwatched(settings: PilotSettings, session: Session, now: float) -> str:
    """What the vehicle does not report although a bound of the mission goes by it, for people; empty where nothing is
    missing."""
    bounds = settings.bounds
    if (bounds.lowest, bounds.highest) != (None, None) and session.motion.at(now).altitude is None:
        return "no altitude in VFR_HUD: bounds.min_altitude_m and max_altitude_m go by it"
    if bounds.battery is not None and session.vehicle.battery(now) is None:
        return "no battery in SYS_STATUS: bounds.min_battery_percent goes by it"
    return ""


def denied(session: Session) -> str:
    """The streams that the vehicle has denied, for people, to be added to what is missing."""
    return f"; streams denied by the vehicle: {', '.join(session.streams.refused)}" if session.streams.refused else ""
