"""Base class of drivers for radios that send lines of text."""

import re
from abc import abstractmethod
from collections.abc import Sequence

from circnav_mav.mav.ranging.driver import Driver, RadioReading
from circnav_mav.timers import Since

_LINE_END = re.compile(rb"[\r\n]+")


class LineDriver(Driver):
    """Driver of a radio that sends lines of text. Subclasses implement `read_line`."""

    baud = 115200

    def __init__(self) -> None:
        self.unread = 0
        self._rest = b""
        self._whole = False
        self._since_received = Since()

    @abstractmethod
    def read_line(self, line: str) -> Sequence[RadioReading] | None:
        """Return the readings in a line, None if the line is not valid."""

    def receive(self, data: bytes, now: float) -> list[RadioReading]:
        # "3.4" may be the end of "123.4". So the input before the first line end is discarded. A
        # line that pauses for more than 1.0 s is discarded, too, because its end may be lost, for
        # example by an unplugged cable.
        if self._rest and self._since_received.age(now) > 1.0:
            self._rest = b""
            self._whole = False
        self._since_received.restart(now)
        *lines, self._rest = _LINE_END.split(self._rest + data)
        # Longest line, bytes. Longer input is not text of the radio.
        if len(self._rest) > 1024:
            self.unread += len(self._rest)
            self._rest = b""
            self._whole = False
        readings: list[RadioReading] = []
        for line in lines:
            found = (
                self.read_line(line.decode("ascii", "replace").strip())
                if self._whole and line
                else ()
            )
            self._whole = True
            self.unread += len(line) if found is None else 0
            readings += found or ()
        return readings
