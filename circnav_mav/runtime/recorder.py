"""The run folder: flight.tlog and ticks.csv, written by a thread of their own so that a slow disk never delays a tick.

A tlog is big-endian microseconds since 1970 and the raw frame, repeated: Mission Planner, MAVExplorer and MAVProxy
open it. Whatever happens to the process, at most the last half second is lost.
"""

import csv
import queue
import struct
import threading
from dataclasses import fields
from enum import Enum
from pathlib import Path
from typing import IO, Any

from circnav_mav.pilot import TickRecord

FLUSH_PERIOD = 0.5
FLUSH_ITEMS = 25
TICK_COLUMNS = tuple(field.name for field in fields(TickRecord))


class RecorderError(Exception):
    """A run folder that cannot be written, in one line."""


class Recorder:
    """Writes what it is given, in that order. A disk that fails is noted in `problem`; the flight goes on."""

    def __init__(self, folder: Path, mission_text: str) -> None:
        self.folder = folder
        self.problem: str | None = None
        self._epoch_us = 0
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "mission.toml").write_text(mission_text, encoding="utf-8")
            self._tlog: IO[bytes] = (folder / "flight.tlog").open("wb")
            self._ticks: IO[str] = (folder / "ticks.csv").open("w", newline="", encoding="utf-8")
        except OSError as error:
            raise RecorderError(f"{folder}: cannot be written: {error.strerror or error}") from None
        self._csv = csv.writer(self._ticks)
        self._csv.writerow(TICK_COLUMNS)
        self._queue: queue.SimpleQueue[tuple[float, bytes] | TickRecord | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._drain, name="recorder", daemon=True)

    def start(self, epoch_us: int) -> None:
        """Begin to write; `epoch_us` is the wall-clock time of second 0 of the run, for the tlog's stamps."""
        self._epoch_us = epoch_us
        self._thread.start()

    def frames(self, frames: list[bytes], now: float) -> None:
        """Record whole MAVLink frames, in or out, at a moment of the run's clock."""
        for frame in frames:
            self._queue.put((now, frame))

    def ticks(self, records: list[TickRecord]) -> None:
        """Record ticks."""
        for record in records:
            self._queue.put(record)

    def close(self) -> None:
        """Write what is waiting and close the files."""
        self._queue.put(None)
        if self._thread.is_alive():
            self._thread.join()

    def _drain(self) -> None:
        """The writing thread."""
        waiting = 0
        while True:
            try:
                item = self._queue.get(timeout=FLUSH_PERIOD)
            except queue.Empty:
                self._guarded(self._flush)
                waiting = 0
                continue
            if item is None:
                break
            self._guarded(self._write, item)
            waiting += 1
            if waiting >= FLUSH_ITEMS:
                self._guarded(self._flush)
                waiting = 0
        self._guarded(self._tlog.close)
        self._guarded(self._ticks.close)

    def _guarded(self, action: Any, *arguments: Any) -> None:
        if self.problem is not None:
            return
        try:
            action(*arguments)
        except (OSError, ValueError) as error:
            self.problem = f"{self.folder}: recording stopped: {getattr(error, 'strerror', None) or error}"

    def _write(self, item: tuple[float, bytes] | TickRecord) -> None:
        if isinstance(item, TickRecord):
            self._csv.writerow([_plain(getattr(item, name)) for name in TICK_COLUMNS])
        else:
            now, frame = item
            self._tlog.write(struct.pack(">Q", self._epoch_us + round(now * 1e6)) + frame)

    def _flush(self) -> None:
        self._tlog.flush()
        self._ticks.flush()


def _plain(value: Any) -> Any:
    """A value as CSV holds it: empty for None, the words of a phase, 1 and 0 for yes and no."""
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, bool):
        return int(value)
    return f"{value:.6f}" if isinstance(value, float) else value
