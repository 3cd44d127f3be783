"""Qorvo (Decawave) DWM1001 with its factory firmware: the lines of its shell commands `lec` and
`les`.

Source: DWM1001 Firmware API Guide, sections on shell mode. The shell has no checksum and no time.
At high rates parts of a line may be missing, so each anchor is parsed separately.
"""

import re
from collections.abc import Sequence

from circnav_mav.mav.ranging.driver import RadioReading
from circnav_mav.mav.ranging.line_driver import LineDriver

LEC = re.compile(r"AN\d+,([0-9A-F]{4}),-?\d+\.\d+,-?\d+\.\d+,-?\d+\.\d+,(\d+\.\d\d)(?=,|$)")
"""AN0,1151,5.00,8.00,2.25,6.44: number, id, position and range of an anchor."""
LES = re.compile(r"([0-9A-F]{4})\[[^\]]*\]=(\d+\.\d\d)(?= |$)")
"""1151[5.00,8.00,2.25]=6.48: id, position and range."""
SHELL = re.compile(r"^(dwm>.*|POS,.*|le[cs]|DWM1001.*|Copyright.*|License.*|Compiled.*|Help.*)$")
"""Lines of the shell without ranges."""
PATIENCE = 2.0
"""Time to wait for data from the radio before it is asked to start, and between two commands to it,
s."""
WAKE = b"\r\r"
LIST = b"lec\r"


class Dwm1001(LineDriver):
    """Driver of the DWM1001: ranges to all anchors in sight, by 16-bit id. It sends `lec` to a
    radio that is silent at the start."""

    def __init__(self) -> None:
        super().__init__()
        self._started = False
        self._woken = False
        self._next = float("-inf")

    def read_line(self, line: str) -> Sequence[RadioReading] | None:
        """Return the ranges in a line of `lec` or `les`."""
        found = LEC.findall(line) if "DIST," in line else LES.findall(line)
        # A second `lec` turns the output off again: never send it once the output is on.
        self._started |= bool(found) or line.endswith(("lec", "les"))
        if not found and not SHELL.match(line):
            return None
        return [RadioReading(float(metres), beacon=int(ident, 16)) for ident, metres in found]

    def ask(self, now: float) -> bytes:
        """Return the next bytes that start a silent radio: in turn, two Enter characters, which
        open the shell, and the command `lec`."""
        if self._started or now < self._next:
            return b""
        first = self._next == float("-inf")
        self._next = now + PATIENCE
        if first:
            return b""
        self._woken = not self._woken
        return WAKE if self._woken else LIST
