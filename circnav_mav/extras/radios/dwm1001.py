"""Qorvo (Decawave) DWM1001 with its factory firmware: the lines of its shell commands `lec` and `les`.

Source: DWM1001 Firmware API Guide, sections on shell mode. The shell has no checksum and no time; at high rates a line
may lack a piece, so each anchor is read for itself.
"""

import re
from collections.abc import Sequence

from circnav_mav.extras.radios.line_driver import LineDriver
from circnav_mav.mav.ranging.driver import RadioReading

LEC = re.compile(r"AN\d+,([0-9A-F]{4}),-?\d+\.\d+,-?\d+\.\d+,-?\d+\.\d+,(\d+\.\d\d)(?=,|$)")
"""AN0,1151,5.00,8.00,2.25,6.44: number, id, position and range of an anchor."""
LES = re.compile(r"([0-9A-F]{4})\[[^\]]*\]=(\d+\.\d\d)(?= |$)")
"""1151[5.00,8.00,2.25]=6.48: id, position and range."""
SHELL = re.compile(r"^(dwm>.*|POS,.*|le[cs]|DWM1001.*|Copyright.*|License.*|Compiled.*|Help.*)$")
"""What the shell says beside ranges."""
PATIENCE = 2.0
"""Time, s, for the radio to speak by itself, and between two things that we say."""
WAKE, LIST = b"\r\r", b"lec\r"


class Dwm1001(LineDriver):
    """Ranges to all anchors in sight, each under its 16-bit id. A radio that is silent from the start is told `lec`."""

    def __init__(self) -> None:
        super().__init__()
        self._started = False
        self._woken = False
        self._next = float("-inf")

    def read_line(self, line: str) -> Sequence[RadioReading] | None:
        """The ranges in a line of `lec` or `les`."""
        found = LEC.findall(line) if "DIST," in line else LES.findall(line)
        # `lec` said twice turns its lines off again: never once it was seen to be on
        self._started |= bool(found) or line.endswith(("lec", "les"))
        if not found and not SHELL.match(line):
            return None
        return [RadioReading(float(metres), beacon=int(ident, 16)) for ident, metres in found]

    def ask(self, now: float) -> bytes:
        """Enter twice opens the shell, then the command."""
        if self._started or now < self._next:
            return b""
        first, self._next = self._next == float("-inf"), now + PATIENCE
        if first:
            return b""
        self._woken = not self._woken
        return WAKE if self._woken else LIST
