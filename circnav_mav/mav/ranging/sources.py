"""Received range sensors, and detection of several sensors that fit the mission.

A source is a component together with the fields that distinguish sensors in a message
(`RangingMessage.marks`). Two sensors may measure ranges to two targets, and a mixture of their
ranges fits neither target. So only a single source is used. While several sources fit the mission,
none is used, because the order of their arrival is chance.
"""

from collections import deque
from typing import NamedTuple

from circnav_mav.mav.codec import Message, ids
from circnav_mav.mav.identity import AUTOPILOT_COMPONENT
from circnav_mav.mav.ranging.interface import RangingMessage, RangingSettings
from circnav_mav.mav.statustext import plain_text

SOURCE_SILENT = 5.0
"""Silence of a source, s, after which another source may replace it."""
LISTEN = 1.0
"""Time after the first range in which circnav waits for a second source before it steers, s."""
LISTEN_PERIODS = 2.5
"""Number of ranging periods after the first range in which circnav waits for a second source. If
this time is longer than LISTEN, it applies instead."""
MOST_SOURCES = 16
"""Largest number of sources that are stored."""
MOST_NAMED = 4
"""Largest number of sources that are listed in one message."""
JUDGED = 8
"""Number of newest ranges of an autopilot that are compared with a radio's ranges. If at least half
of them repeat a range of the radio, the autopilot forwards the radio and is no second source. Not
all need to, because some frames of the radio may be lost on the link."""
JUDGED_LEAST = 3
"""Least number of compared ranges before an autopilot is judged to forward a radio."""


class RangeSource(NamedTuple):
    """One range sensor: ids of its component, and (mission key, value) of each field that marks its
    messages."""

    system: int
    component: int
    marks: tuple[tuple[str, int | str], ...]

    @classmethod
    def of(cls, message: Message, kind: RangingMessage) -> "RangeSource":
        """Return the source of a message."""
        marks = ((key, getattr(message, mark)) for mark, key in kind.marks.items())
        return cls(*ids(message), tuple(marks))

    def __str__(self) -> str:
        marks = (f" {key} {plain_text(str(value))}" for key, value in self.marks)
        return f"{self.system}/{self.component}{''.join(marks)}"

    @property
    def keys(self) -> dict[str, int | str]:
        """Mission keys and values that select this source."""
        return {**dict(self.marks), "component_id": self.component, "system_id": self.system}


class _Received:
    """Newest ranges of one source."""

    def __init__(self) -> None:
        self.at = 0.0
        self.picked = False
        self.slant: float | None = None
        # 256: number of newest ranges that are kept, a quarter of a second at 1 kHz. If the ranges
        # of an autopilot repeat these, the autopilot forwards this source, and is no second source.
        self.slants: deque[float] = deque(maxlen=256)
        self.repeats: deque[bool] = deque(maxlen=JUDGED)
        """Autopilots only: for each of its newest ranges, True if it repeats a range of a radio."""


class RangeSources:
    """All received sources of the mission's message type, including sources that the mission does
    not select."""

    def __init__(self, kind: RangingMessage, settings: RangingSettings) -> None:
        self._kind = kind
        self._listen = max(LISTEN, LISTEN_PERIODS / settings.rate_hz) if settings.listens else 0.0
        self._received: dict[RangeSource, _Received] = {}
        self._since: float | None = None
        """Time of the first message of a selected source, s."""

    def receive(
        self, message: Message, slant: float | None, now: float, *, picked: bool
    ) -> RangeSource:
        """Process one message and return its source. slant: m, None if it carries no range. picked:
        True if the mission selects the source."""
        source = RangeSource.of(message, self._kind)
        received = self._received.get(source)
        if received is None:
            if len(self._received) >= MOST_SOURCES:
                del self._received[min(self._received, key=lambda one: self._received[one].at)]
            received = self._received[source] = _Received()
        received.at = now
        received.picked = picked
        if picked and self._since is None:
            self._since = now
        if slant is not None:
            received.slant = slant
            if source.component == AUTOPILOT_COMPONENT:
                received.repeats.append(self._repeats(source, slant))
            received.slants.append(slant)
        return source

    def listened(self, now: float) -> bool:
        """True if ranges have arrived for long enough that a second source would have been
        received."""
        return self._since is not None and now - self._since >= self._listen

    def several(self, now: float) -> bool:
        """True if more than one source fits the mission now."""
        return len(self._received) > 1 and len(self._fitting(now)) > 1

    def choice(self, now: float) -> str:
        """Return the sources that fit the mission, their ranges and the mission keys that select
        one of them.

        Empty for fewer than two sources.
        """
        rivals = self._fitting(now)
        if len(rivals) < 2:
            return ""
        return (
            f"{len(rivals)} range sources: {self._words(rivals)}: select yours by"
            f" {' or '.join(differences(rivals))}"
        )

    def short_choice(self, now: float) -> str:
        """Return the same as `choice`, short enough for a STATUSTEXT."""
        rivals = self._fitting(now)
        return (
            f"{len(rivals)} range sources: set {differences(rivals)[0]}" if len(rivals) > 1 else ""
        )

    def others(self, now: float) -> str:
        """Return the received sources if the mission selects none of them, otherwise empty."""
        alive = self._alive(now)
        if not alive or any(self._received[source].picked for source in alive):
            return ""
        keys = " and ".join(f"ranging.{key}" for key in alive[0].keys)
        return f"received: {self._words(alive)}, which the mission does not select: compare {keys}"

    def _alive(self, now: float) -> list[RangeSource]:
        return [
            source
            for source, received in self._received.items()
            if now - received.at <= SOURCE_SILENT
        ]

    def _fitting(self, now: float) -> list[RangeSource]:
        picked = [source for source in self._alive(now) if self._received[source].picked]
        return (
            picked
            if len(picked) < 2
            else [source for source in picked if not self._is_echo(source)]
        )

    def _is_echo(self, source: RangeSource) -> bool:
        """True if an autopilot repeats the ranges of a radio. ArduPilot and PX4 forward ranges with
        other ids and at a lower rate."""
        repeats = self._received[source].repeats
        return len(repeats) >= JUDGED_LEAST and sum(repeats) >= len(repeats) / 2

    def _repeats(self, source: RangeSource, slant: float) -> bool:
        radios = (
            received
            for other, received in self._received.items()
            if other.system == source.system
            and other.component != AUTOPILOT_COMPONENT
            and received.picked
        )
        # 0.015: largest difference, m, between a range of a radio and the same range sent again by
        # the autopilot. PX4 truncates ranges to centimeters.
        return any(
            abs(slant - one) <= 0.015 for received in radios for one in reversed(received.slants)
        )

    def _words(self, sources: list[RangeSource]) -> str:
        def one(source: RangeSource) -> str:
            slant = self._received[source].slant
            return f"{source} ({'no range' if slant is None else f'{slant:.1f} m'})"

        more = ", ..." if len(sources) > MOST_NAMED else ""
        return ", ".join(map(one, sources[:MOST_NAMED])) + more


def differences(sources: list[RangeSource]) -> list[str]:
    """Return the mission keys that distinguish these sources, the component first: an autopilot
    that repeats the ranges of a radio may change the other fields."""
    return [
        f"ranging.{key}"
        for key in sorted(sources[0].keys, key=lambda key: key != "component_id")
        if len({source.keys[key] for source in sources}) > 1
    ]
