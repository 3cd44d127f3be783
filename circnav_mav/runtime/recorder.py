"""Recorder of the run folder: flight.tlog, steps.csv and ticks.csv. A separate thread writes, so
that a slow disk never delays a tick.

A tlog is a sequence of records, each a timestamp (big-endian microseconds since 1970) and a raw
frame. Mission Planner, MAVExplorer and MAVProxy open it. steps.csv contains the data that have no
place in a tlog: the time of each step of the loop, the link and source of its frames, and the
number of frames that circnav sent. With both files, a replay is exact. Signatures are removed, as
MAVLink's guide recommends, so that a replay needs no key. Files are flushed: if the process is
killed, only queued items are lost.

The size of a run folder is bounded. At FRAMES_SHARE of the bound, recording of frames stops:
flight.tlog and steps.csv then contain a complete, shorter flight. The rest of the bound is reserved
for ticks.
"""

import csv
import queue
import struct
import threading
from collections.abc import Hashable, Iterable
from enum import Enum
from pathlib import Path
from typing import IO, Any

from circnav_mav.mav.identity import host_of
from circnav_mav.mav.signing import without_signature
from circnav_mav.pilot import TickRecord
from circnav_mav.pilot.loop_step import HELD_BACK, STEPS, LoopStep, requests_text
from circnav_mav.pilot.record import COLUMNS

MOST_MB = 2000.0
"""Largest total size of the three files, MB: about 65 h of flight."""
FRAMES_SHARE = 0.75
"""Fraction of the size bound at which recording of frames stops, so that the ticks of a long flight
fit."""
MOST_WAITING = 20_000
"""Largest number of queued steps and ticks, some minutes of flight. If a slow disk lets the queue
grow beyond, new items are dropped."""
MOST_SOURCES = 1000
"""Largest number of senders with a number of their own in steps.csv. Further senders share one
number."""
CLOSE_PATIENCE = 10.0
"""Longest wait for a slow disk at the end of the flight, s."""
TICK_COLUMNS = tuple(COLUMNS)
STEP_COLUMNS = (
    "time_us",
    "received",
    "sent",
    "hello",
    "interrupt",
    "attached",
    "requests",
    "exchanged",
)
"""Columns of steps.csv. The tlog holds the frames of a step in this order.

time_us: time of the step, us.
received: received datagrams, as in `v0*2 v0.2*1 r1*1`: initial of the link, number of the source,
    and, after the asterisk, number of complete frames. A further port of a known host has the
    number of the host, a point, and its own number.
sent: number of frames sent to the vehicle, or HELD_BACK if they were not sent.
hello: number of frames sent to the ranging link.
interrupt: signal that ended the flight.
attached: number of frames of listeners.
requests: requests for another circle, JSON.
exchanged: number of frames between listeners and other systems.
"""


class RecorderError(Exception):
    """A run folder that cannot be written. The message is one line."""


class TakenError(RecorderError):
    """Another flight is recorded in this folder."""


class Recorder:
    """Writes steps and ticks in order. A disk error is reported in `problem`, and the flight
    continues."""

    def __init__(self, folder: Path, mission_text: str) -> None:
        """Raises RecorderError."""
        self.folder = folder
        self.problem: str | None = None
        self.until: float | None = None
        """Run time of the newest tick, s, written or not."""
        self._written = 0
        self._broken = False
        self._epoch_us = 0
        self._at_once = False
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._tlog = _claimed(folder / "flight.tlog")
            (folder / "mission.toml").write_text(mission_text, encoding="utf-8")
            self._ticks: IO[str] = (folder / "ticks.csv").open(
                "w", buffering=1, newline="", encoding="utf-8"
            )
            self._steps: IO[str] = (folder / STEPS).open(
                "w", buffering=1, newline="", encoding="utf-8"
            )
            csv.writer(self._ticks).writerow(TICK_COLUMNS)
            csv.writer(self._steps).writerow(STEP_COLUMNS)
        except OSError as error:
            raise RecorderError(f"{folder}: cannot be written: {error.strerror or error}") from None
        self._sources: dict[Hashable, str] = {}
        self._hosts: dict[Hashable, str] = {}
        self._queue: queue.SimpleQueue[LoopStep | TickRecord | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._drain, name="recorder", daemon=True)

    def start(self, epoch_us: int, *, at_once: bool = False) -> None:
        """Begin to write. epoch_us: Unix time of run time zero, us, for the tlog. at_once: True if
        the run may wait for the disk, as in simulated time. Then a slow disk loses nothing."""
        self._epoch_us = epoch_us
        self._at_once = at_once
        if not at_once:
            self._thread.start()

    def step(self, step: LoopStep) -> None:
        """Record a step of the loop with the whole MAVLink frames received and sent in it."""
        self._put(step)

    def ticks(self, records: list[TickRecord]) -> None:
        """Record ticks."""
        for record in records:
            self.until = record.time
            self._put(record)

    def close(self) -> None:
        """Write the queue and close the files. Report a problem if the disk takes longer than
        CLOSE_PATIENCE."""
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
            self._note(
                f"{self.folder}: recording has gaps from {item.time:.0f} s on: the disk is too slow"
            )

    def _note(self, problem: str) -> None:
        """Store a problem, unless an earlier problem is stored: the first problem causes the later
        problems."""
        self.problem = self.problem or problem

    def _drain(self) -> None:
        """Write queued items until None arrives, then close the files. Body of the writing
        thread."""
        while (item := self._queue.get()) is not None:
            self._guarded(self._write, item)
        for file in (self._tlog, self._steps, self._ticks):
            self._guarded(file.close)

    def _guarded(self, action: Any, *arguments: Any) -> None:
        if self._broken:
            return
        try:
            action(*arguments)
        except Exception as error:
            self._broken = True
            self._note(
                f"{self.folder}: recording stopped: {getattr(error, 'strerror', None) or error}"
            )

    def _write(self, item: LoopStep | TickRecord) -> None:
        if isinstance(item, TickRecord):
            if self._room(1.0, "ticks", item.time):
                self._written += csv.writer(self._ticks).writerow(tick_row(item))
        elif self._room(FRAMES_SHARE, "frames", item.time):
            self._write_step(item)

    def _room(self, share: float, what: str, time: float) -> bool:
        """True while less than this fraction of MOST_MB is used. Else report that recording has
        stopped."""
        if self._written < share * MOST_MB * 1e6:
            return True
        self._note(
            f"{self.folder}: recording of {what} ended at {time:.0f} s: the limit of {MOST_MB:g} MB"
            " is reached"
        )
        return False

    def _write_step(self, item: LoopStep) -> None:
        frames = item.received_frames + item.sent + item.hello + item.attached + item.exchanged
        stamp = struct.pack(">Q", self._epoch_us + round(item.time * 1e6))
        self._written += self._tlog.write(
            b"".join(stamp + without_signature(frame) for frame in frames)
        )
        self._tlog.flush()
        received = " ".join(
            f"{link[0]}{self._number(source)}*{len(datagram)}"
            for link, source, datagram in item.received
        )
        sent = HELD_BACK if item.held_back else len(item.sent) or ""
        row = (
            round(item.time * 1e6),
            received,
            sent,
            len(item.hello) or "",
            item.interrupt,
            len(item.attached) or "",
            requests_text(item.requests),
            len(item.exchanged) or "",
        )
        self._written += csv.writer(self._steps).writerow(row)

    def _number(self, source: Hashable) -> str:
        """Return the number of a source. A further port of a known host has the number of the host,
        a point and its own number. All sources beyond MOST_SOURCES share one number."""
        if source in self._sources:
            return self._sources[source]
        known = len(self._sources)
        first = self._hosts.get(host_of(source))
        number = str(known) if first is None else f"{first}.{known}"
        if known < MOST_SOURCES:
            self._sources[source] = number
            self._hosts.setdefault(host_of(source), number)
        return number


def write_ticks(path: Path, records: Iterable[TickRecord]) -> None:
    """Write ticks as a ticks.csv. Raises OSError."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(TICK_COLUMNS)
        writer.writerows(map(tick_row, records))


def tick_row(record: TickRecord) -> list[Any]:
    """Return a tick as a row of ticks.csv."""
    return [_plain(getattr(record, name)) for name in TICK_COLUMNS]


def _plain(value: Any) -> Any:
    """Return a value for CSV: None becomes empty, a phase its text, True and False 1 and 0."""
    if isinstance(value, float):
        return f"{value:.6f}"
    if isinstance(value, Enum):
        return value.value
    return int(value) if isinstance(value, bool) else value


def _claimed(path: Path) -> IO[bytes]:
    """Create the file, which reserves the folder for this flight. Raises TakenError, OSError."""
    try:
        return path.open("xb")
    except FileExistsError:
        raise TakenError(f"{path.parent}: holds {path.name} already, name another folder") from None
