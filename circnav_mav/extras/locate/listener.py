"""Listener that runs the locator of the target, with its own process."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from typing import Any

from circnav_mav.extras.locate.estimator import NotLocated, locate
from circnav_mav.extras.locate.export import geojson, kml
from circnav_mav.extras.locate.locator import Locator
from circnav_mav.extras.locate.place import Place
from circnav_mav.extras.locate.report import verdict_lines
from circnav_mav.extras.locate.settings import locator_component
from circnav_mav.extras.locate.solver import start_solver
from circnav_mav.pilot import TickRecord
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runtime.listeners import Listener, ListenerSettings


class LocateListener(Listener):
    """Listener that runs a `Locator`. The estimator has its own process, because an estimate takes
    longer than a tick. A thread would hold the interpreter lock and delay setpoints."""

    name = "locate"

    def __init__(self, locator: Locator, *, waits: bool) -> None:
        """waits: True to wait for the result of every estimate, so that simulated flights are
        reproducible."""
        self.locator = locator
        self._waits = waits
        self._pool = start_solver()  # start the process before the flight
        self._under_way: Future[Place | NotLocated] | None = None

    def on_step(
        self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None
    ) -> Sequence[bytes]:
        """Process the frames of a step. Return the frames to send now: no frame if the pilot's
        frames were held back."""
        for link, source, received in step.received:
            self.locator.on_frames(link, source, received, step.time)
        if step.held_back:
            return []
        frames = self.locator.step(step.time)
        self._locator(step.time)
        return frames

    def facts(self, now: float) -> Mapping[str, str]:
        locator = self.locator
        return {"place": locator.why if locator.place is None else locator.place.at(now).words()}

    def alarms(self, now: float) -> Mapping[str, str]:
        alarm = self.locator.radius_alarm
        return {"radius": f"RANGING: {alarm}. {self.locator.radius_remedy}"} if alarm else {}

    def finish(self, summary: dict[str, Any]) -> Mapping[str, str]:
        """Add the place to the summary. Return target.geojson and target.kml if there is a
        place."""
        locator = self.locator
        files = dict[str, str]()
        place = locator.place
        if place is not None:
            files["target.geojson"] = geojson({"target": place}, locator.track)
            files["target.kml"] = kml({"target": place})
        found = {
            "place": None if place is None else place.plain(),
            "true_radius_m": locator.true_radius,
            "radius_alarm": locator.radius_alarm or None,
            "radius_remedy": locator.radius_remedy or None,
        }
        summary |= found
        summary["notes"] += verdict_lines(found)
        return files

    def close(self) -> None:
        """End the process."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _locator(self, now: float) -> None:
        if self._under_way is not None and (self._waits or self._under_way.done()):
            self.locator.found(self._under_way.result())
            self._under_way = None
        if self._under_way is None and (job := self.locator.job(now)) is not None:
            self._under_way = self._pool.submit(locate, *job)


def open_listener(given: ListenerSettings) -> LocateListener | None:
    """Return the locator listener, or None if the mission does not enable it."""
    component = locator_component(given.mission)
    if component is None:
        return None
    return LocateListener(
        Locator(component, given.pilot, given.signing), waits=given.mission.flies_sim
    )
