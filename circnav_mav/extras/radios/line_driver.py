"""What drivers of radios that speak in lines of text have in common."""

import re
from abc import abstractmethod
from collections.abc import Sequence

from circnav_mav.mav.ranging.driver import Driver, RadioReading

LONGEST_LINE = 1024
"""Bytes of a line, after which what comes in is no text of ours."""
PAUSE = 1.0
"""Silence, s, in the middle of a line that shows that its end was lost: an unplugged cable."""
_LINE_END = re.compile(rb"[\r\n]+")


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
