"""Whose the vehicle is, and what we may send to it. The operator always wins.

Two small tables beside the mission's phases: who holds the vehicle (`Holder`), and how well we know it now (`View`).
`Authority.allowed` makes one answer of them: nothing, the safe setpoint, or setpoints that steer.
"""

from dataclasses import dataclass
from enum import Enum

from circnav_mav.mav.session import Session
from circnav_mav.pilot.mission_state import NOT_OURS, MissionState, Phase
from circnav_mav.pilot.mode_request import ModeRequest
from circnav_mav.pilot.settings import OutputMode, PilotSettings

GIVEN_AFTER = 1.5
"""Time, s, for which the vehicle must have told nothing but the guided mode, from one word to a later one, before it is
given back: a switch may pass through that mode, and what was said before it was left may come late by another way,
between newer words."""
LANDED_PATIENCE = 1.5
"""Time, s, that a vehicle is given to tell whether it flies before the first engagement."""
STALL = 0.5
"""Gap between two steps, s, after which everything that came in during it counts as stale."""
CATCH_UP = 0.2
"""Time after it, s, in which what comes in may still be from before: it takes a few turns to read it all."""
SILENT = 1.5
"""Age of the vehicle's last word about its mode, s, above which it may be in other hands."""


class Holder(Enum):
    """Who holds the vehicle once a flight has begun."""

    US = "we: the guided mode means that we may steer"
    OPERATOR_IN_MODE = "the operator, and the guided mode was not left since (disarmed, rebooted)"
    OPERATOR = "the operator, and the guided mode was left since"
    RETURNING = "the operator, and the guided mode was entered again, not long ago"


class Sight(Enum):
    """What a look at the vehicle shows."""

    IN_MODE = "armed in the guided mode since the last look"
    LEFT = "in another mode, or was since the last look"
    GONE = "disarmed or silent, or was since the last look"
    BACK = "in the guided mode for long enough"
    TAKEN_BY_MODE = "the guided mode was left while the vehicle was ours"
    TAKEN_IN_MODE = "disarmed or rebooted while the vehicle was ours"


HOLDERS: dict[tuple[Holder, Sight], Holder] = {
    (Holder.OPERATOR_IN_MODE, Sight.LEFT): Holder.OPERATOR,
    (Holder.OPERATOR, Sight.IN_MODE): Holder.RETURNING,
    (Holder.RETURNING, Sight.LEFT): Holder.OPERATOR,
    (Holder.RETURNING, Sight.GONE): Holder.OPERATOR,
    (Holder.RETURNING, Sight.BACK): Holder.US,
    **{(holder, Sight.TAKEN_BY_MODE): Holder.OPERATOR for holder in Holder},
    **{(holder, Sight.TAKEN_IN_MODE): Holder.OPERATOR_IN_MODE for holder in Holder},
}
"""A pair that is not listed changes nothing."""


class View(Enum):
    """How well we know the vehicle since we last stood still."""

    CURRENT = "its newest heartbeat tells who has it"
    BACKLOG = "what comes in may have waited while we stood still"
    UNCONFIRMED = "no heartbeat has told its mode since"


class Allowed(Enum):
    """What setpoint may leave now."""

    NOTHING = "nothing"
    SAFE = "the safe setpoint"
    STEER = "one that steers"


@dataclass(frozen=True, slots=True)
class Takeover:
    """The vehicle was taken from us. what: for the air, as STATUSTEXT. reason: for the record."""

    what: str
    reason: str


class Authority:
    """Watches who holds the vehicle: a mode that is not ours, disarming or a reboot takes it from us."""

    def __init__(self, settings: PilotSettings, session: Session, mission: MissionState) -> None:
        self._settings = settings
        self._session = session
        self._mission = mission
        self._flies = settings.output_mode is OutputMode.FLY
        self.holder = Holder.US
        self._departures = self._reboots = 0
        self._back_since = 0.0
        """When the vehicle told the guided mode again, s."""
        self.view = View.CURRENT
        self._stepped: float | None = None
        self._caught_up = float("-inf")
        self._heartbeats = 0
        self._request = ModeRequest()
        self._left_before: int | None = None
        """How often the guided mode had been left when it was first asked for."""

    # --- what may be sent -------------------------------------------------------------------------------------------

    def allowed(self, now: float) -> Allowed:
        """What setpoint may leave in this step."""
        if not self._flies or not self.certain:
            return Allowed.NOTHING
        if self._mission.steering:
            return Allowed.STEER
        if self._mission.phase is Phase.LEAVING or self._streams_first(now):
            return Allowed.SAFE
        return Allowed.NOTHING

    @property
    def certain(self) -> bool:
        """Whether the vehicle is known to be the one of before, and in whose hands it is; who sends no setpoints need
        not know."""
        return not self._flies or (self.view is View.CURRENT and not self._session.vehicle.unproven)

    @property
    def in_our_hands(self) -> bool:
        """Whether the vehicle obeys us, and may."""
        return self._flies and self.holder is Holder.US and self._session.vehicle.in_our_mode

    def may_say_last_words(self) -> bool:
        """Whether the safe setpoint may be sent by a shell whose pilot has failed."""
        begun = self._mission.begun and self._mission.phase not in NOT_OURS
        return begun and self.in_our_hands and not self._session.vehicle.unproven

    def may_ask_for_exit(self, now: float) -> bool:
        """Whether that shell may ask for the exit action, too: a mode is obeyed whoever has the vehicle."""
        return self.certain and not self.may_be_backlog(now) and self._session.heartbeat_age(now) < SILENT

    def may_engage(self, now: float) -> bool:
        """Whether the vehicle may be steered from now on; a pilot that sends no setpoints needs nobody's leave. Once
        engaged, a slow link or a landing stops nothing."""
        return not self._flies or (self.in_our_hands and self._can_be_steered(now) and self.link_quick(now))

    def _can_be_steered(self, now: float) -> bool:
        """Whether the vehicle flies, reports what it must, and is sure to be the one."""
        return not (self.may_be_on_ground(now) or self._session.missing(now) or self.disputed(now))

    def disputed(self, now: float) -> str:
        """Why it is not sure who the vehicle, or its radio, is; asked before the first engagement only."""
        rivals = [] if self._mission.begun else self._session.identity.rivals.recent(now)
        return f"{rivals[0]}: name yours with link.peer, or sign" if rivals else ""

    def _streams_first(self, now: float) -> bool:
        """Whether setpoints go out before the engagement: PX4 enters our mode only while they flow, and does not fly
        them until then. Never after a takeover, on the ground or blind; over a slow link, it shall refuse the mode."""
        session = self._session
        if self._mission.phase is not Phase.READY or not session.adapter.wants_setpoints_in(session.vehicle.mode):
            return False
        ours = self.holder is Holder.US and self._can_be_steered(now)
        return ours and (self.link_quick(now) or session.vehicle.in_our_mode)

    def may_be_on_ground(self, now: float) -> bool:
        """An aircraft is not steered before it flies, for the first time or again; one that does not say whether it
        does is given a moment to, unless it was ours until the link was lost. A disarmed one does not fly."""
        session = self._session
        if not session.adapter.flies:
            return False
        if not session.vehicle.armed:
            return True
        if session.vehicle.on_ground is None:
            goes_on = self._mission.begun and self._mission.phase is Phase.READY
            return not goes_on and now - session.identity.since < LANDED_PATIENCE
        return session.vehicle.on_ground

    def link_quick(self, now: float) -> bool:
        """Whether question and answer are within the mission's bound; asked before the first engagement only."""
        trip = self._session.timesync
        if self._mission.begun:
            return True
        return trip.settled(now) and (trip.typical or 0.0) <= self._settings.timing.round_trip

    # --- asking for the guided mode ---------------------------------------------------------------------------------

    def ask_for_mode(self, now: float) -> str | None:
        """Ask for the guided mode where that may be; answers with the reason why it is of no use."""
        session, adapter = self._session, self._session.adapter
        if not self._may_ask(now):
            session.drop_mode_requests()
            return None
        self._left_before = session.vehicle.departures if self._left_before is None else self._left_before
        failure = self._request.ask(session, adapter.guided_mode, now)
        return None if failure is None else f"mode {adapter.guided_name} {failure}"

    @property
    def asks_for_mode(self) -> bool:
        """Whether the mode is ours to ask for. Once the operator has left the one that was asked for, it is his."""
        left_again = self._left_before is not None and self._session.vehicle.departures > self._left_before
        return self._settings.request_mode and not left_again

    def _may_ask(self, now: float) -> bool:
        """Only in the air, with everything but the mode ready, and never again once the flight has begun."""
        if not self.asks_for_mode or not self._flies or self._mission.begun or self._mission.phase is not Phase.READY:
            return False
        return self._can_be_steered(now) and self.link_quick(now)

    # --- who holds the vehicle --------------------------------------------------------------------------------------

    def watch_takeover(self) -> Takeover | None:
        """What took the vehicle from us, if it was ours until now."""
        session, told = self._session, self._session.vehicle
        # a vehicle that we held is ours also where it was lost, or was given back and cannot be steered yet
        ours = self.holder is Holder.US or self._mission.phase not in (Phase.WAIT_LINK, Phase.YIELDED)
        departed, self._departures = told.departures > self._departures, told.departures
        rebooted, self._reboots = told.reboots > self._reboots, told.reboots
        outside = session.up and told.mode is not None and told.mode != session.adapter.guided_mode
        left_for = told.mode_name if outside else told.left_for if departed else None
        in_mode = told.in_our_mode and not departed
        self._saw(Sight.LEFT if left_for is not None else Sight.IN_MODE if in_mode else Sight.GONE)
        if self.holder is Holder.RETURNING and told.heard_at - self._back_since >= GIVEN_AFTER:
            self._saw(Sight.BACK)
        if not (ours and self._mission.begun and self._flies and session.up) or (in_mode and not rebooted):
            return None
        self._saw(Sight.TAKEN_BY_MODE if left_for is not None else Sight.TAKEN_IN_MODE)
        if rebooted or left_for is None:
            what = "autopilot rebooted" if rebooted else "vehicle disarmed"
            return Takeover(what, what)
        what = f"{session.adapter.guided_name} left for {left_for}"
        return Takeover(what, f"{what}: operator or failsafe")

    def _saw(self, sight: Sight) -> None:
        before, self.holder = self.holder, HOLDERS.get((self.holder, sight), self.holder)
        if self.holder is Holder.RETURNING and before is not Holder.RETURNING:
            self._back_since = self._session.vehicle.heard_at

    # --- what we know of it -----------------------------------------------------------------------------------------

    def stepped(self, now: float) -> None:
        """A step begins. After a stall the vehicle may be in other hands until a heartbeat has told its mode."""
        heartbeats = self._session.vehicle.heartbeats
        if self._stood_still(now):
            self._caught_up = now + CATCH_UP
        if self.may_be_backlog(now):
            self.view, self._heartbeats = View.BACKLOG, heartbeats
            self._session.drop_mode_requests()
        elif self.view is not View.CURRENT:
            self.view = View.CURRENT if heartbeats > self._heartbeats else View.UNCONFIRMED
        self._stepped = now

    def may_be_backlog(self, now: float) -> bool:
        """Whether what comes in now may have waited while we stood still."""
        return now < self._caught_up or self._stood_still(now)

    def _stood_still(self, now: float) -> bool:
        return self._stepped is not None and now - self._stepped > STALL
