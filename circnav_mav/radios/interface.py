"""What a driver of a ranging radio is, and what those have in common that speak in lines of text."""

import re
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Protocol

MOST_BEACON = 65535
"""Largest id of a beacon: 16 bits, as RANGING_BEACON carries it."""
LONGEST_LINE = 1024
"""Bytes of a line, after which what comes in is no text of ours."""
PAUSE = 1.0
"""Silence, s, in the middle of a line that shows that its end was lost: an unplugged cable."""
_LINE_END = re.compile(rb"[\r\n]+")


@dataclass(frozen=True, slots=True)
class RadioReading:
    """One measured range.

    range: slant, m; not finite or not above 0: none was measured. beacon: id of the other radio. sigma: standard
    deviation, m, None where the radio tells none. stamp: when it was measured, s of the radio's own clock; None: when
    it arrives.
    """

    range: float
    beacon: int = 0
    sigma: float | None = None
    stamp: float | None = None

    def __post_init__(self) -> None:
        for value in (self.range, self.sigma or 0.0, self.stamp or 0.0):
            if not isinstance(value, Real):
                raise TypeError(f"{value!r} is not a number")
        if not isinstance(self.beacon, Integral):
            raise TypeError(f"beacon id {self.beacon!r} is not a whole number")
        if not 0 <= self.beacon <= MOST_BEACON:
            raise ValueError(f"beacon id {self.beacon} is not 0 to {MOST_BEACON}")


class Driver(Protocol):
    """One radio on one port. Times are seconds of our clock; a driver asks nobody else for the time.

    baud: of its serial line, unless the port says another. line_end: ends a line of text that a datagram leaves open;
    empty for a radio that speaks binary. unread: bytes so far that were not understood.
    """

    baud: int
    line_end: bytes
    unread: int

    def receive(self, data: bytes, now: float) -> Sequence[RadioReading]:
        """The readings that these bytes complete; a message may come in any number of pieces."""
        ...

    def ask(self, now: float) -> bytes:
        """What to send to the radio now, if anything. Called at least 20 times a second."""
        return b""


class LineDriver(Driver):
    """A radio that speaks in lines of text. A driver of one reads one line."""

    baud = 115200
    line_end = b"\n"

    def __init__(self) -> None:
        self.unread = 0
        self._rest = b""
        self._whole = False
        self._heard_at = float("-inf")

    @abstractmethod
    def read_line(self, line: str) -> Sequence[RadioReading] | None:
        """The readings in a line, None for one that is not understood."""

    def receive(self, data: bytes, now: float) -> list[RadioReading]:
        # "3.4" may be the end of "123.4": what came before the first line end, or over a pause, is left out
        if self._rest and now - self._heard_at > PAUSE:
            self._rest, self._whole = b"", False
        self._heard_at = now
        *lines, self._rest = _LINE_END.split(self._rest + data)
        if len(self._rest) > LONGEST_LINE:
            self.unread += len(self._rest)
            self._rest, self._whole = b"", False
        readings: list[RadioReading] = []
        for line in lines:
            found = self.read_line(line.decode("ascii", "replace").strip()) if self._whole and line else ()
            self._whole = True
            self.unread += len(line) if found is None else 0
            readings += found or ()
        return readings
