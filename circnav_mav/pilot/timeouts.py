"""What a mission waits for, in words, and for how long: its patience with what is missing, and its own length."""

from collections.abc import Mapping

from circnav_mav.guidance.phases import Phase
from circnav_mav.mav.codec import Decoder
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from circnav_mav.mav.session import Session
from circnav_mav.pilot.progress import Progress
from circnav_mav.pilot.range_tracker import FRESH, Target
from circnav_mav.pilot.settings import RANGING, VEHICLE, Ending, PilotSettings, Voice
from circnav_mav.pilot.status_text import why_no_vehicle, why_not_ready, why_not_sure


class Waiting:
    """Ends the mission when a time is up."""

    def __init__(
        self,
        settings: PilotSettings,
        session: Session,
        target: Target,
        progress: Progress,
        decoders: Mapping[str, Decoder],
    ) -> None:
        """decoders: of each link, for what was heard on it."""
        self._settings = settings
        self._session = session
        self._target = target
        self._progress = progress
        self._vehicle_link = decoders[VEHICLE].counts
        self._ranging_link = decoders[RANGING if settings.ranging_apart else VEHICLE].counts

    def watch(self, now: float) -> None:
        """Whether the flight, or the patience with what is missing, is at its end."""
        timing, progress = self._settings.timing, self._progress
        waited, engaged_at = now - progress.since, progress.engaged_at
        if engaged_at is not None and now - engaged_at >= timing.duration:
            if progress.steering:
                flown = "flown" if self._settings.voice is Voice.FLY else "dry run"
                progress.finish(Ending.COMPLETED, f"{flown} to its end", now)
            else:
                gone = self._what_is_gone(now)
                progress.finish(Ending.ABORTED, f"time ran out while {progress.phase.value}{gone}", now)
        elif progress.phase is Phase.HOLDING and waited > timing.hold:
            progress.finish(Ending.ABORTED, self._why_held(waited, now), now)
        elif progress.lost_at is not None and now - progress.lost_at > timing.outage:
            progress.finish(Ending.ABORTED, f"vehicle or ranging gone for {timing.outage:.0f} s", now)
        elif engaged_at is not None or progress.started is None:
            return
        elif progress.phase is Phase.WAIT_LINK and now - progress.started > timing.wait_link:
            progress.finish(Ending.NOTHING_HEARD, f"no vehicle: {self.why_no_vehicle()}", now)
        elif progress.phase is Phase.WAIT_RANGING and waited > timing.wait_ranging:
            progress.finish(Ending.NOTHING_HEARD, self.why_not_ready(now), now)

    def why_no_vehicle(self) -> str:
        """Why nobody is there to be steered."""
        return why_no_vehicle(self._session, self._vehicle_link)

    def why_not_ready(self, now: float) -> str:
        """What is missing of ranging, or of what the vehicle must tell."""
        target, missing = self._target, self._session.missing(now)
        if not missing and (unknown := target.height.why_unknown(now)):
            return unknown
        age = target.age(now)
        if not target.estimator.ready and age is not None and age <= self._settings.timing.stale and not missing:
            return why_not_sure(self._settings.estimator, target.accepted)
        return why_not_ready(
            self._session,
            RANGING_MESSAGES[self._settings.ranging.message],
            target.ranging.rejected,
            missing=missing if target.estimator.ready else [],
            counts=self._ranging_link,
        )

    def _why_held(self, waited: float, now: float) -> str:
        """Why the ranges of so many seconds could not be steered by."""
        target, age = self._target, self._target.age(now)
        if target.estimator.ready and age is not None and FRESH * self._settings.timing.stale < age < waited:
            return f"no range fresh enough for {waited:.1f} s, the newest is {age:.2f} s old"
        if target.ranging.clock_doubted:
            return f"no range for {waited:.1f} s: rejected, the sensor clock stepped"
        return f"no range for {waited:.1f} s"

    def _what_is_gone(self, now: float) -> str:
        """Which silence a flight that runs out of time waits in."""
        if self._progress.phase is Phase.WAIT_LINK:
            return f", no heartbeat for {self._session.heartbeat_age(now):.0f} s"
        age = self._target.age(now) if self._progress.phase is Phase.WAIT_RANGING else None
        return "" if age is None else f", no range for {age:.0f} s"
