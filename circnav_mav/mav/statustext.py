"""What we say to ground stations: texts of what happens, numbers to plot. Never more often than they can read."""

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.clocks import our_boot_ms
from circnav_mav.mav.codec import Message

TEXT_INTERVAL = 2.0
PLOT_INTERVAL = 0.25
LONGEST_TEXT = 50
MOST_PLOTTED = 1e38
"""More does not fit into single precision, and is no number to look at."""


class Announcer:
    """STATUSTEXT at most once in two seconds per kind, the latest kept; NAMED_VALUE_FLOAT at 4 Hz."""

    def __init__(self) -> None:
        self._waiting: dict[str, tuple[int, str]] = {}
        self._last_text: dict[str, float] = {}
        self._last_plot = float("-inf")

    def say(self, kind: str, text: str, *, severity: int = dialect.MAV_SEVERITY_NOTICE) -> None:
        """Announce something; a newer text of the same kind replaces one that has not gone out."""
        self._waiting[kind] = (severity, f"circnav: {text}")

    def texts(self, now: float) -> list[Message]:
        """The STATUSTEXT messages due now."""
        due = [kind for kind in self._waiting if now - self._last_text.get(kind, float("-inf")) >= TEXT_INTERVAL]
        messages = []
        for kind in due:
            severity, text = self._waiting.pop(kind)
            self._last_text[kind] = now
            messages.append(dialect.MAVLink_statustext_message(severity, _fit(text)))
        return messages

    def plots_due(self, now: float) -> bool:
        """Whether it is time for values to plot."""
        return now - self._last_plot >= PLOT_INTERVAL

    def plots(self, values: dict[str, float], now: float) -> list[Message]:
        """NAMED_VALUE_FLOAT messages for any ground station's graphs, when due. Names have at most 9 characters: PX4
        cuts the tenth."""
        if not self.plots_due(now) or not values:
            return []
        self._last_plot = now
        stamp = our_boot_ms(now)
        plotted = {name: value for name, value in values.items() if abs(value) < MOST_PLOTTED}
        return [dialect.MAVLink_named_value_float_message(stamp, n.encode(), v) for n, v in plotted.items()]


def plain_text(text: str | bytes) -> str:
    """A text that somebody else has made, up to its terminating zero, with nothing in it that a terminal would obey."""
    text = text.decode("ascii", "replace") if isinstance(text, bytes) else text
    return "".join(letter if letter.isprintable() else "?" for letter in text.partition("\0")[0])


def _fit(text: str) -> bytes:
    """A text as the 50 bytes that every receiver shows."""
    return text.encode("ascii", "replace")[:LONGEST_TEXT]
