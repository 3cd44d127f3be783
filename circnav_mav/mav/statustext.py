"""What we say to ground stations: texts of what happens, numbers to plot. Never more often than they can read. And
long texts of others, put together again."""

from itertools import cycle

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.foreign import printable
from circnav_mav.mav.clocks import our_boot_ms
from circnav_mav.mav.codec import Ids, Message, ids

TEXT_INTERVAL = 2.0
"""Least time, s, between two texts of one kind; chosen for a ground station's list."""
PLOT_INTERVAL = 0.25
"""Least time, s, between two NAMED_VALUE_FLOAT of a kind; chosen, 4 Hz draws a curve."""
CHUNK, LONGEST_TEXT = 50, 200
"""Bytes of a STATUSTEXT, and of a text: longer ones go out in chunks."""
MOST_SENDERS = 16
"""Senders whose texts are put together: bounds the memory that a hostile link can fill."""
MOST_PLOTTED = 1e38
"""More does not fit into single precision, and is no number to look at."""


class Announcer:
    """STATUSTEXT at most once in two seconds per kind, the latest kept; NAMED_VALUE_FLOAT at 4 Hz."""

    def __init__(self) -> None:
        self._waiting: dict[str, tuple[int, str]] = {}
        self._last_text: dict[str, float] = {}
        self._last_plot = float("-inf")
        self._text_ids = cycle(range(1, 65536))

    def say(self, kind: str, text: str, *, severity: int = dialect.MAV_SEVERITY_NOTICE) -> None:
        """Announce something; a newer text of the same kind replaces one that has not gone out."""
        self._waiting[kind] = (severity, f"circnav: {text}")

    def texts(self, now: float) -> list[Message]:
        """The messages that may go out now."""
        messages = []
        for kind in list(self._waiting):
            if now - self._last_text.get(kind, float("-inf")) >= TEXT_INTERVAL:
                self._last_text[kind] = now
                messages += self._chunks(*self._waiting.pop(kind))
        return messages

    def _chunks(self, severity: int, text: str) -> list[Message]:
        """The messages of one text. The last chunk has a zero in it, which ends the text; it may hold nothing else."""
        data = text.encode("ascii", "replace")[:LONGEST_TEXT]
        if len(data) <= CHUNK:
            return [dialect.MAVLink_statustext_message(severity, data)]
        ident, starts = next(self._text_ids), range(0, len(data) + 1, CHUNK)
        return [
            dialect.MAVLink_statustext_message(severity, data[at : at + CHUNK], ident, number)
            for number, at in enumerate(starts)
        ]

    def plots(self, values: dict[str, float], now: float) -> list[Message]:
        """NAMED_VALUE_FLOAT messages for any ground station's graphs, when due. Names have at most 9 characters: PX4
        cuts the tenth."""
        if now - self._last_plot < PLOT_INTERVAL or not values:
            return []
        self._last_plot = now
        return [
            dialect.MAVLink_named_value_float_message(our_boot_ms(now), name.encode(), value)
            for name, value in values.items()
            if abs(value) < MOST_PLOTTED
        ]


class TextReader:
    """STATUSTEXT of any senders as texts. Each chunk of a long one gives the text so far: if the next is lost, that
    much was read."""

    def __init__(self) -> None:
        self._newest: dict[Ids, tuple[int, int, str]] = {}

    def read(self, message: Message) -> tuple[str, str | None]:
        """The text so far, and the shorter text that it continues, None where it begins."""
        sender = ids(message)
        ident, number, before = self._newest.get(sender, (0, 0, ""))
        continues = message.id != 0 and (message.id, message.chunk_seq) == (ident, number + 1)
        text = (before if continues else "") + plain_text(message.text)
        if sender in self._newest or len(self._newest) < MOST_SENDERS:
            self._newest[sender] = (message.id, message.chunk_seq, text)
        return text, before if continues else None


def plain_text(text: str) -> str:
    """Text of a MAVLink message up to its terminating zero, printable."""
    return printable(text.partition("\0")[0])
