"""Driver of the Reyax RYUW122 for circnav (docs/radios.md)."""

import re

from circnav_mav import LineDriver, RadioReading

ANSWER = re.compile(r"\+ANCHOR_RCV=\w+,\d+,.*,(\d+) cm(,-?\d+)?")
QUESTION = b"AT+ANCHOR_SEND=DAVID123,4,RNGE\r\n"
PERIOD = 0.1


class Ryuw122(LineDriver):
    """Reyax RYUW122 as anchor. The driver requests the range to tag DAVID123 ten times a second."""

    def __init__(self) -> None:
        super().__init__()
        self.asked_at = float("-inf")

    def read_line(self, line: str) -> list[RadioReading] | None:
        """Return the range of an answer, [] for other answers, None for an unknown line."""
        if answer := ANSWER.fullmatch(line):
            return [RadioReading(int(answer[1]) / 100)]
        return [] if line.startswith("+") else None

    def ask(self, now: float) -> bytes:
        """Return the bytes to send to the radio now."""
        if now - self.asked_at < PERIOD:
            return b""
        self.asked_at = now
        return QUESTION
