"""The survey of the target and the hand-back beside a flight: an onlooker with a process and a socket of its own."""

import socket
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from typing import Any

from circnav_mav.cli.exits import Refused
from circnav_mav.extras.locate.conditions import GPS_WATCH, HAND_BACK, SURVEY_STOPPED
from circnav_mav.extras.locate.estimator import NotYet, locate
from circnav_mav.extras.locate.export import cursor_on_target, geojson, kml
from circnav_mav.extras.locate.locator import Locator
from circnav_mav.extras.locate.place import Place
from circnav_mav.extras.locate.report import verdict_lines
from circnav_mav.extras.locate.settings import locate_settings, tables_of
from circnav_mav.extras.locate.solver import start_solver
from circnav_mav.pilot import TickRecord
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runtime.endpoint import explain
from circnav_mav.runtime.onlookers import Onlooker, OnlookerSettings

HAND_BACK_COLUMNS = "time,latitude_deg,longitude_deg,sigma_m,by,answer,reported_off_m"


class Locating(Onlooker):
    """Runs a locator. The estimate is made in a process of its own: it takes longer than a tick may, and a thread would
    hold the interpreter's lock while a range waits for its setpoint."""

    name = "survey"

    def __init__(self, locator: Locator, name: str, cot: tuple[str, int] | None = None, *, waits: bool) -> None:
        """name: of the target, in Cursor on Target. cot: address that gets it; a host name would be looked up in the
        loop. waits: True to wait for every estimate, so that a flight in simulated time is the same on every
        computer."""
        self.locator, self._target, self._cot, self._waits = locator, name, cot, waits
        self._epoch_us = 0
        self._pool = start_solver()  # now, not in flight
        self._ended = False
        self._under_way: Future[Place | NotYet] | None = None
        self._socket = None if cot is None else socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        if self._socket is not None:
            self._socket.setblocking(False)

    @property
    def busy(self) -> bool:  # type: ignore[override]
        """True while positions are still handed back, or the streams are not yet given back."""
        return not self._ended and self.locator.busy

    @property
    def problem(self) -> str | None:  # type: ignore[override]
        """Description of the failure, in one line; None if all works."""
        return self.locator.problem

    def start(self, epoch_us: int) -> None:
        self._epoch_us = epoch_us

    def on_step(self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None) -> Sequence[bytes]:
        """Take in the frames of a step. Return the frames to send now, none if the pilot's were held back. An error
        ends the survey; the hand-back goes on with what is known, until it has an error of its own."""
        self.locator.called_off = self.called_off
        if self._ended:
            return []
        frames: list[bytes] = []
        try:
            for link, source, heard in step.heard:
                self.locator.hear(link, source, heard, step.time)
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
        found = SURVEY_STOPPED.alarm(problem=locator.problem) if locator.problem else {}
        if locator.watch.alarm:
            found |= GPS_WATCH.alarm(words=locator.watch.alarm)
        if locator.handback and locator.handback.words:
            found |= HAND_BACK.alarm(words=locator.handback.words)
        return found

    def finish(self, summary: dict[str, Any]) -> Mapping[str, str]:
        """Add the place, the GPS watch and the hand-back to the summary. Return target.geojson and target.kml if there
        is a place, handback.csv if positions were sent."""
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
            "gps_watch": [{"time_s": round(time, 1), "text": text} for time, text in locator.watch.told],
            "handback": None if handback is None else handback.plain(),
        }
        summary |= found
        summary["notes"] += verdict_lines(found)
        return files

    def close(self) -> None:
        """End the process."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        if self._socket is not None:
            self._socket.close()

    def _survey(self, now: float) -> None:
        if self._under_way is not None and (self._waits or self._under_way.done()):
            self.locator.found(self._under_way.result())
            self._under_way = None
        if self._under_way is None and (job := self.locator.job(now)) is not None:
            self._under_way = self._pool.submit(locate, *job)
        self._send_cot(now)

    def _send_cot(self, now: float) -> None:
        place = self.locator.place
        if self._socket is None or self._cot is None or place is None or not self.locator.cot_due:
            return
        self.locator.cot_due = False
        with suppress(OSError):  # no receiver, or no network now
            self._socket.sendto(cursor_on_target(place.at(now), self._target, self._epoch_us, now), self._cot)


def open_onlooker(given: OnlookerSettings) -> Locating | None:
    """Return the survey beside the pilot, None if the mission wants none. Raises Refused."""
    mission, settings = given.mission, locate_settings(given.mission)
    if settings is None:
        return None
    cot, given_cot = None, tables_of(mission)[0].cot
    if given_cot is not None:
        host, _, port = given_cot.rpartition(":")
        try:  # once: in flight setpoints would wait for a name server
            cot = socket.gethostbyname(host), int(port)
        except (OSError, UnicodeError) as error:
            raise Refused(f"locate.cot: {host}: {explain(error)}") from None
    locator = Locator(settings, given.pilot, given.signing)
    return Locating(locator, f"{mission.file.name}.target", cot, waits=mission.flies_sim)
