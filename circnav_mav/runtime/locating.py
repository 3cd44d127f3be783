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
        """name: of the target for others. cot: where Cursor on Target goes. waits: for every estimate, so that a flight
        in simulated time is the same on every computer."""
        self.locator, self._name, self._cot, self._waits = locator, name, cot, waits
        self.epoch_us = 0
        self.problem: str | None = None
        """Why nothing more is surveyed."""
        self._pool = start_solver()  # now, not in flight
        self._under_way: Future[Place | NotYet] | None = None
        self._socket = None if cot is None else socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        if self._socket is not None:
            self._socket.setblocking(False)

    @property
    def busy(self) -> bool:
        """Whether there is something to do after guidance has ended."""
        return self.problem is None and self.locator.busy

    def turn(self, step: LoopStep) -> list[bytes]:
        """Hear what came in with a step of the loop; the frames to send now, none where the pilot's were held back."""
        if self.problem is not None:
            return []
        now = step.time
        try:
            for link, source, frames in step.heard:
                self.locator.hear(link, source, frames, now)
            if step.held_back:
                return []
            if self._under_way is not None and (self._waits or self._under_way.done()):
                self.locator.found(self._under_way.result())
                self._under_way = None
            if self._under_way is None and (job := self.locator.job(now)) is not None:
                self._under_way = self._pool.submit(locate, *job)
            frames = self.locator.step(now)
            self._tell_cot(now)
            return frames
        except Exception as error:
            self.problem = f"survey of the target: stopped at {now:.1f} s: {error!r}"
            return []

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
