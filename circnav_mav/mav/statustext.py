"""Texts and plotted values for ground stations, at limited rates, and reassembly of long texts that
are received."""

from itertools import cycle

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.foreign import printable
from circnav_mav.mav.clocks import our_boot_ms
from circnav_mav.mav.codec import Ids, Message, ids
from circnav_mav.timers import Since

CHUNK = 50
"""Maximum length of the text in one STATUSTEXT, bytes (MAVLink)."""
LONGEST_TEXT = 200
"""Maximum length of a text in several STATUSTEXT, bytes. Longer texts are cut."""


class Announcer:
    """Rate limiter of messages for ground stations. In 2 s, at most one STATUSTEXT of each kind is
    sent, the newest. NAMED_VALUE_FLOAT are sent at 4 Hz."""

    def __init__(self) -> None:
        self._waiting: dict[str, tuple[int, str]] = {}
        self._last_text: dict[str, float] = {}
        self._since_plot = Since()
        self._text_ids = cycle(range(1, 65536))

    def say(self, kind: str, text: str, *, severity: int = dialect.MAV_SEVERITY_NOTICE) -> None:
        """Queue a text. It replaces an unsent text of the same kind."""
        self._waiting[kind] = (severity, f"circnav: {text}")

    def texts(self, now: float) -> list[Message]:
        """Return the messages that may be sent now."""
        messages = []
        for kind in list(self._waiting):
            # 2.0: least time, s, between two texts of the same kind, so that they do not fill a
            # ground station's message list.
            if now - self._last_text.get(kind, float("-inf")) >= 2.0:
                self._last_text[kind] = now
                messages += self._chunks(*self._waiting.pop(kind))
        return messages

    def _chunks(self, severity: int, text: str) -> list[Message]:
        """Return the messages of one text. A zero byte in the last chunk ends the text. If the text
        fills its chunks exactly, an empty chunk follows."""
        data = text.encode("ascii", "replace")[:LONGEST_TEXT]
        if len(data) <= CHUNK:
            return [dialect.MAVLink_statustext_message(severity, data)]
        ident = next(self._text_ids)
        starts = range(0, len(data) + 1, CHUNK)
        return [
            dialect.MAVLink_statustext_message(severity, data[at : at + CHUNK], ident, number)
            for number, at in enumerate(starts)
        ]

    def plots(self, values: dict[str, float], now: float) -> list[Message]:
        """Return NAMED_VALUE_FLOAT messages for a ground station's graphs when they are due.

        Names have at most 9 characters: PX4 cuts the tenth.
        """
        # 0.25: least time, s, between two sets of NAMED_VALUE_FLOAT. 4 Hz gives a usable curve.
        if self._since_plot.age(now) < 0.25 or not values:
            return []
        self._since_plot.restart(now)
        # 1e38: largest plotted magnitude. Larger numbers do not fit into single precision.
        return [
            dialect.MAVLink_named_value_float_message(our_boot_ms(now), name.encode(), value)
            for name, value in values.items()
            if abs(value) < 1e38
        ]


class TextReader:
    """Reassembly of STATUSTEXT chunks from several senders.

    For each chunk of a long text, `read` returns the text so far. If the next chunk is lost, this
    part remains available.
    """

    def __init__(self) -> None:
        self._newest: dict[Ids, tuple[int, int, str]] = {}

    def read(self, message: Message) -> tuple[str, str | None]:
        """Return the text so far and the shorter text that it continues. The shorter text is None
        for a new text."""
        sender = ids(message)
        ident, number, before = self._newest.get(sender, (0, 0, ""))
        continues = message.id != 0 and (message.id, message.chunk_seq) == (ident, number + 1)
        text = (before if continues else "") + plain_text(message.text)
        # 16: limit of the senders for which chunks are reassembled. It bounds the memory that a
        # hostile link can fill.
        if sender in self._newest or len(self._newest) < 16:
            self._newest[sender] = (message.id, message.chunk_seq, text)
        return text, before if continues else None


def plain_text(text: str) -> str:
    """Return the text of a MAVLink message up to its terminating zero, in printable characters."""
    return printable(text.partition("\0")[0])
