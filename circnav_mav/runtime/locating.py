"""The survey beside the loop of a flight: its process, its socket; and no error of it ends a flight."""

import socket
from concurrent.futures import Future
from contextlib import suppress

from circnav_mav.locate.estimator import NotYet, locate
from circnav_mav.locate.export import cursor_on_target
from circnav_mav.locate.locator import Locator
from circnav_mav.locate.place import Place
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runtime.solver import start_solver


class Locating:
    """Runs a locator. The estimate is made in a process of its own: it takes longer than a tick may, and a thread would
    hold the interpreter's lock while a range waits for its answer."""

    def __init__(self, locator: Locator, name: str, cot: tuple[str, int] | None = None, *, waits: bool) -> None:
        """name: of the target for others. cot: where Cursor on Target goes, an address: a name would be looked up in
        the loop. waits: for every estimate, so that a flight
        in simulated time is the same on every computer."""
        self.locator, self._name, self._cot, self._waits = locator, name, cot, waits
        self.epoch_us = 0
        self._pool = start_solver()  # now, not in flight
        self._ended = False
        self._under_way: Future[Place | NotYet] | None = None
        self._socket = None if cot is None else socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        if self._socket is not None:
            self._socket.setblocking(False)

    @property
    def busy(self) -> bool:
        """Whether there is something to do after guidance has ended."""
        return not self._ended and self.locator.busy

    def turn(self, step: LoopStep) -> list[bytes]:
        """Hear what came in with a step of the loop; the frames to send now, none where the pilot's were held back. An
        error ends the survey; the hand-back goes on by what is known, until it has one of its own."""
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

    def _survey(self, now: float) -> None:
        if self._under_way is not None and (self._waits or self._under_way.done()):
            self.locator.found(self._under_way.result())
            self._under_way = None
        if self._under_way is None and (job := self.locator.job(now)) is not None:
            self._under_way = self._pool.submit(locate, *job)
        self._tell_cot(now)

    def close(self) -> None:
        """End the process."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        if self._socket is not None:
            self._socket.close()

    def _tell_cot(self, now: float) -> None:
        place = self.locator.place
        if self._socket is None or self._cot is None or place is None or not self.locator.cot_due:
            return
        self.locator.cot_due = False
        with suppress(OSError):  # nobody there, or no network now
            self._socket.sendto(cursor_on_target(place.at(now), self._name, self.epoch_us, now), self._cot)
