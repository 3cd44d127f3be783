"""Onlooker that runs the survey of the target and the hand-back, with its own process."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from typing import Any

from circnav_mav.extras.locate.conditions import HAND_BACK, RADIUS, SURVEY_STOPPED
from circnav_mav.extras.locate.estimator import NotLocated, locate
from circnav_mav.extras.locate.export import geojson, kml
from circnav_mav.extras.locate.locator import Locator
from circnav_mav.extras.locate.place import Place
from circnav_mav.extras.locate.report import verdict_lines
from circnav_mav.extras.locate.settings import locate_settings
from circnav_mav.extras.locate.solver import start_solver
from circnav_mav.pilot import TickRecord
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runtime.onlookers import Onlooker, OnlookerSettings

HAND_BACK_COLUMNS = "time,latitude_deg,longitude_deg,sigma_m,by,answer,reported_off_m"


class LocateOnlooker(Onlooker):
    """Runs a `Locator`. The estimator has its own process, because an estimate takes longer than a tick. A thread would
    hold the interpreter lock and delay setpoints."""

    name = "survey"

    def __init__(self, locator: Locator, *, waits: bool) -> None:
        """waits: True to wait for every estimate, so that simulated flights are reproducible."""
        self.locator = locator
        self._waits = waits
        self._pool = start_solver()  # start it before the flight
        self._ended = False
        self._under_way: Future[Place | NotLocated] | None = None

    @property
    def busy(self) -> bool:  # type: ignore[override]
        """True while positions are handed back or the vehicle's stream rates are not yet restored."""
        return not self._ended and self.locator.busy

    @property
    def problem(self) -> str | None:  # type: ignore[override]
        """One-line description of a failure, or None."""
        return self.locator.problem

    def on_step(self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None) -> Sequence[bytes]:
        """Process the frames of a step. Return the frames to send now; none if the pilot's frames were held back.

        An error ends the survey. The hand-back continues with the last known place until it fails as well.
        """
        self.locator.called_off = self.called_off
        if self._ended:
            return []
        frames: list[bytes] = []
        try:
            for link, source, received in step.received:
                self.locator.on_frames(link, source, received, step.time)
            if not step.held_back:
                frames = self.locator.step(step.time)
                if not self.locator.only_hand_back:
                    self._survey(step.time)
        except Exception as error:
            locator = self.locator
            self._ended = locator.handback is None or locator.only_hand_back
            what = "hand-back" if locator.only_hand_back else "survey of the target"
            locator.problem = f"{what} stopped at {step.time:.1f} s: {error!r}"
            locator.only_hand_back = True
        return frames

    def facts(self, now: float) -> Mapping[str, str]:
        locator = self.locator
        return {"place": locator.why if locator.place is None else locator.place.at(now).words()}

    def alarms(self, now: float) -> Mapping[str, str]:
        locator = self.locator
        found = SURVEY_STOPPED.alarm(locator.problem) if locator.problem else {}
        if locator.radius_alarm:
            found |= RADIUS.alarm(locator.radius_alarm)
        if locator.handback and locator.handback.words:
            found |= HAND_BACK.alarm(locator.handback.words)
        return found

    def finish(self, summary: dict[str, Any]) -> Mapping[str, str]:
        """Add the place and the hand-back to the summary. Return target.geojson and target.kml if there is a place,
        handback.csv if positions were sent."""
        locator, files = self.locator, dict[str, str]()
        place, handback = locator.place, locator.handback
        if place is not None:
            files["target.geojson"] = geojson({"target": place}, locator.track)
            files["target.kml"] = kml({"target": place})
        if handback is not None and handback.given:
            rows = [
                f"{one.time:.2f},{one.latitude:.7f},{one.longitude:.7f},{one.sigma:.1f},{one.by},{one.answer},"
                + ("" if one.off is None else f"{one.off:.1f}")
                for one in handback.given
            ]
            files["handback.csv"] = "\n".join([HAND_BACK_COLUMNS, *rows]) + "\n"
        found = {
            "place": None if place is None else place.plain(),
            "radius_alarm": locator.radius_alarm or None,
            "handback": None if handback is None else handback.plain(),
        }
        summary |= found
        summary["notes"] += verdict_lines(found)
        return files

    def close(self) -> None:
        """End the process."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _survey(self, now: float) -> None:
        if self._under_way is not None and (self._waits or self._under_way.done()):
            self.locator.found(self._under_way.result())
            self._under_way = None
        if self._under_way is None and (job := self.locator.job(now)) is not None:
            self._under_way = self._pool.submit(locate, *job)


def open_onlooker(given: OnlookerSettings) -> LocateOnlooker | None:
    """Return the survey onlooker, or None if the mission does not enable it."""
    settings = locate_settings(given.mission)
    if settings is None:
        return None
    return LocateOnlooker(Locator(settings, given.pilot, given.signing), waits=given.mission.flies_sim)
