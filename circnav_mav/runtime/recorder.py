"""The run folder: flight.tlog, turns.csv and ticks.csv, written by a thread of their own so that a slow disk never
delays a tick.

A tlog is big-endian microseconds since 1970 and the raw frame, repeated: Mission Planner, MAVExplorer and MAVProxy
open it. turns.csv says of each step of the loop what a tlog cannot: its time, from which link and source its frames
came, and how many of them are ours; with both, a replay is exact. Signatures stay out of it, as MAVLink's guide wants
it: a replay needs no key. Nothing stays in a buffer: a killed process loses what still waits for the disk, no more.

A run folder is bounded: first the frames stop (flight.tlog and turns.csv, which stay a whole, shorter flight for every
reader), the last part is for the ticks alone.
"""

import csv
import queue
import struct
import threading
from collections.abc import Hashable, Iterable
from enum import Enum
from math import inf
from pathlib import Path
from typing import IO, Any

from circnav_mav.mav.signing import without_signature
from circnav_mav.pilot import TickRecord
from circnav_mav.pilot.loop_step import HELD_BACK, LoopStep, requests_text
from circnav_mav.runtime.lock import lock

FRAMES_SHARE = 0.75
"""Part of the bound at which frames are no longer recorded, so that the ticks of a long flight find room."""
MOST_WAITING = 20_000
"""Steps and ticks that wait for a slow disk, some minutes of flight, before new ones are lost."""
MOST_SOURCES = 1000
"""Senders told apart in turns.csv."""
CLOSE_PATIENCE = 10.0
"""Time, s, that a slow disk is given at the end."""
TICK_COLUMNS = TickRecord._fields
TURN_COLUMNS = ("time_us", "heard", "said", "hello", "interrupt", "attached", "requests", "exchanged")
"""heard: link initial, number of the source and count of whole frames of each datagram, as in `v0*2 r1*1`. said, hello:
frames of ours; HELD_BACK: what there was to say was not sent; attached: frames of onlookers; requests: for another
circle, as JSON; exchanged: frames between onlookers and others than the vehicle. The tlog holds the frames of a step in
this order."""


class RecorderError(Exception):
    """A run folder that cannot be written, in one line."""


class TakenError(RecorderError):
    """Somebody records there."""


class Recorder:
    """Writes what it is given, in that order. A disk that fails is noted in `problem`; the flight goes on."""

    def __init__(self, folder: Path, mission_text: str, max_mb: float = inf) -> None:
        """max_mb: bound of all three files together. Raises RecorderError."""
        self.folder = folder
        self.problem: str | None = None
        self.until: float | None = None
        """Run time of the newest tick that was given, written or not."""
        self._most = max_mb * 1e6
        self._written = 0
        self._broken = False
        self._epoch_us, self._at_once = 0, False
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._tlog = _claimed(folder / "flight.tlog")
            (folder / "mission.toml").write_text(mission_text, encoding="utf-8")
            self._ticks: IO[str] = (folder / "ticks.csv").open("w", buffering=1, newline="", encoding="utf-8")
            self._turns: IO[str] = (folder / "turns.csv").open("w", buffering=1, newline="", encoding="utf-8")
            csv.writer(self._ticks).writerow(TICK_COLUMNS)
            csv.writer(self._turns).writerow(TURN_COLUMNS)
        except OSError as error:
            raise RecorderError(f"{folder}: cannot be written: {error.strerror or error}") from None
        self._sources: dict[Hashable, int] = {}
        self._queue: queue.SimpleQueue[LoopStep | TickRecord | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._drain, name="recorder", daemon=True)

    def start(self, epoch_us: int, *, at_once: bool = False) -> None:
        """Begin to write; `epoch_us` is the wall-clock time of second 0 of the run, for the tlog's stamps. at_once:
        whether the run may wait for the disk, as simulated time does, and nothing is ever lost to a slow one."""
        self._epoch_us, self._at_once = epoch_us, at_once
        if not at_once:
            self._thread.start()

    def step(self, step: LoopStep) -> None:
        """Record a step of the loop with the whole MAVLink frames that came in and went out in it."""
        self._put(step)

    def ticks(self, records: list[TickRecord]) -> None:
        """Record ticks."""
        for record in records:
            self.until = record.time
            self._put(record)

    def close(self) -> None:
        """Write what is waiting and close the files. What a slow disk does not take in time is noted."""
        self._queue.put(None)
        if self._at_once:
            self._drain()
        elif self._thread.is_alive():
            self._thread.join(CLOSE_PATIENCE)
            if self._thread.is_alive():
                self._note(f"{self.folder}: the end is not recorded: the disk is too slow")

    def _put(self, item: LoopStep | TickRecord) -> None:
        if self._at_once:
            self._guarded(self._write, item)
        elif self._queue.qsize() < MOST_WAITING:
            self._queue.put(item)
        else:
            self._note(f"{self.folder}: recording has gaps from {item.time:.0f} s on: the disk is too slow")

    def _note(self, problem: str) -> None:
        """Keep the first problem: later ones follow from it."""
        self.problem = self.problem or problem

    def _drain(self) -> None:
        """Write what is given, until nothing more comes: the writing thread."""
        while (item := self._queue.get()) is not None:
            self._guarded(self._write, item)
        for file in (self._tlog, self._turns, self._ticks):
            self._guarded(file.close)

    def _guarded(self, action: Any, *arguments: Any) -> None:
        if self._broken:
            return
        try:
            action(*arguments)
        except Exception as error:
            self._broken = True
            self._note(f"{self.folder}: recording stopped: {getattr(error, 'strerror', None) or error}")

    def _write(self, item: LoopStep | TickRecord) -> None:
        if isinstance(item, TickRecord):
            if self._room(1.0, "ticks", item.time):
                self._written += csv.writer(self._ticks).writerow(tick_row(item))
        elif self._room(FRAMES_SHARE, "frames", item.time):
            self._write_step(item)

    def _room(self, share: float, what: str, time: float) -> bool:
        """Whether this part of the bound is not used up; once it is, that stays so."""
        if self._written < share * self._most:
            return True
        self._note(
            f"{self.folder}: {what} are recorded up to {time:.0f} s: log.max_mb = {self._most / 1e6:g} is reached"
        )
        return False

    def _write_step(self, item: LoopStep) -> None:
        frames = item.frames_heard + item.said + item.hello + item.attached + item.exchanged
        stamp = struct.pack(">Q", self._epoch_us + round(item.time * 1e6))
        self._written += self._tlog.write(b"".join(stamp + without_signature(frame) for frame in frames))
        self._tlog.flush()
        heard = " ".join(f"{link[0]}{self._number(source)}*{len(datagram)}" for link, source, datagram in item.heard)
        said = HELD_BACK if item.held_back else len(item.said) or ""
        row = (
            round(item.time * 1e6),
            heard,
            said,
            len(item.hello) or "",
            item.interrupt,
            len(item.attached) or "",
            requests_text(item.requests),
            len(item.exchanged) or "",
        )
        self._written += csv.writer(self._turns).writerow(row)

    def _number(self, source: Hashable) -> int:
        """A short name for a source; whoever comes after very many others shares theirs."""
        known = len(self._sources)
        return self._sources.setdefault(source, known) if known < MOST_SOURCES else self._sources.get(source, known)


def write_ticks(path: Path, records: Iterable[TickRecord]) -> None:
    """Ticks as a ticks.csv. Raises OSError."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(TICK_COLUMNS)
        writer.writerows(map(tick_row, records))


def tick_row(record: TickRecord) -> list[Any]:
    """A tick as a line of ticks.csv."""
    return list(map(_plain, record))


def _plain(value: Any) -> Any:
    """A value as CSV holds it: empty for None, the words of a phase, 1 and 0 for yes and no."""
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, bool):
        return int(value)
    return f"{value:.6f}" if isinstance(value, float) else value


def _claimed(path: Path) -> IO[bytes]:
    """A file that nobody else has made: whoever makes it has the folder, and holds it while the flight is recorded.
    Raises TakenError, OSError."""
    try:
        file = path.open("xb")
        lock(file)
        return file
    except FileExistsError:
        raise TakenError(f"{path.parent}: holds {path.name} already, name another folder") from None
