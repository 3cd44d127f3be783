"""Whether the vehicle may be steered from now on, and asking for its guided mode where the mission says so."""

from circnav_mav.guidance.phases import Phase
from circnav_mav.mav.session import Session
from circnav_mav.pilot.authority import Authority
from circnav_mav.pilot.handover import ModeRequest
from circnav_mav.pilot.progress import Progress
from circnav_mav.pilot.settings import PilotSettings, Voice
from circnav_mav.pilot.status_text import why_not_guided, why_not_told, why_slow, why_withheld

LANDED_PATIENCE = 1.5
"""Time, s, that a vehicle is given to tell whether it flies before the first engagement."""


class Engagement:
    """What must hold before the first setpoint that steers. Once engaged, a slow link or a landing stops nothing."""

    def __init__(self, settings: PilotSettings, session: Session, authority: Authority, progress: Progress) -> None:
        self._settings = settings
        self._session = session
        self._authority = authority
        self._progress = progress
        self._request = ModeRequest()
        self._left_before: int | None = None
        """How often the mode had been left when it was first asked for."""

    def allowed(self, now: float) -> bool:
        """Whether the vehicle may be steered; a pilot that sends no setpoints needs nobody's leave."""
        if self._settings.voice is not Voice.FLY:
            return True
        if not self._authority.consent or not self._session.in_our_mode or self._session.missing(now):
            return False
        return not self._may_be_on_ground(now) and self.link_quick(now) and not self._disputed(now)

    def _disputed(self, now: float) -> str:
        """Why it is not sure who the vehicle, or its radio, is; asked before the first engagement only."""
        rivals = self._session.pinning.rivals.recent(now) if self._progress.engaged_at is None else []
        return f"{rivals[0]}: name yours with link.peer, or sign" if rivals else ""

    def link_quick(self, now: float) -> bool:
        """Whether question and answer are within the mission's bound; asked before the first engagement only."""
        trip = self._session.round_trip
        if self._progress.engaged_at is not None:
            return True
        return trip.settled(now) and (trip.typical or 0.0) <= self._settings.timing.round_trip

    def streams_first(self, now: float) -> bool:
        """Whether setpoints go out before the engagement: PX4 enters our mode only while they flow, and does not fly
        them until then. Never after a takeover, on the ground or blind; over a slow link, it shall refuse the mode."""
        session = self._session
        if self._progress.phase is not Phase.READY or not session.adapter.wants_setpoints_in(session.mode):
            return False
        if not self._authority.consent or self._may_be_on_ground(now) or session.missing(now) or self._disputed(now):
            return False
        return self.link_quick(now) or session.in_our_mode

    def request(self, now: float) -> str | None:
        """Ask for the guided mode, only where the mission says so, in the air, and never again once the flight has
        begun, or the mode was left. Answers with the reason why it is of no use."""
        session, adapter = self._session, self._session.adapter
        if not self._may_ask(now):
            session.drop_mode_requests()
            return None
        self._left_before = session.told.departures if self._left_before is None else self._left_before
        failure = self._request.ask(session, adapter.guided_mode, now)
        return None if failure is None else f"mode {adapter.mode_names[adapter.guided_mode]} {failure}"

    def _may_ask(self, now: float) -> bool:
        """Whether everything but the mode is ready; a request still under way is dropped where it is not."""
        settings, progress = self._settings, self._progress
        if not settings.request_mode or settings.voice is not Voice.FLY or progress.engaged_at is not None:
            return False
        if progress.phase is not Phase.READY or self._left_again or self._may_be_on_ground(now):
            return False
        return self.link_quick(now) and not self._session.missing(now) and not self._disputed(now)

    @property
    def _left_again(self) -> bool:
        """Whether the operator has left the mode that was asked for: it is his to enter, then."""
        return self._left_before is not None and self._session.told.departures > self._left_before

    def why_not(self, now: float) -> str:
        """What the engagement waits for, for people."""
        session, authority = self._session, self._authority
        if not authority.consent:
            return why_withheld(session, left_mode=authority.left_mode)
        if disputed := self._disputed(now):
            return disputed
        if not self.link_quick(now):
            return why_slow(session.round_trip.typical, self._settings.timing.round_trip)
        if session.missing(now):
            return why_not_told(session, session.missing(now))
        on_ground = session.told.on_ground
        if self._may_be_on_ground(now) and (session.told.armed or on_ground):
            return "the vehicle is on the ground" if on_ground else "whether the vehicle flies is not known"
        return why_not_guided(session, request_mode=self._settings.request_mode and not self._left_again)

    def _may_be_on_ground(self, now: float) -> bool:
        """An aircraft is not steered before it flies, for the first time or again; one that does not say whether it
        does is given a moment to, unless it was ours until the link was lost. A disarmed one does not fly."""
        session = self._session
        if not session.adapter.flies:
            return False
        if not session.told.armed:
            return True
        if session.told.on_ground is None:
            return not self._progress.resuming and now - session.pinning.since < LANDED_PATIENCE
        return session.told.on_ground
