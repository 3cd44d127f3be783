"""The sensors that ranges come from, and whether the mission leaves a choice between several.

A source is a component together with the fields by which a message tells sensors apart (`RangingMessage.marks`). Two
sensors may range to two targets, and the mixture of their ranges is the range to neither. So ranges of one source
only are used, and of none while several sources fit the mission: which one is received first is chance.
"""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from circnav_mav.mav.codec import Message, ids
from circnav_mav.mav.identity import AUTOPILOT_COMPONENT
from circnav_mav.mav.ranging.interface import RangingMessage, RangingSettings
from circnav_mav.mav.statustext import plain_text

SOURCE_SILENT = 5.0
"""Silence of a source, s, after which it counts as gone and another one may take its place."""
LISTEN, LISTEN_PERIODS = 1.0, 2.5
"""Time after the first range, s and in periods of the radio, before which a second source may still be unheard."""
MOST_SOURCES, MOST_NAMED = 16, 4
"""Sources that are kept, and that one message names."""
KEPT = 256
"""Ranges of a source by which an echo of it is recognized: a quarter of a second at 1 kHz."""
ECHO_ERROR = 0.015
"""Difference, m, of a range and its echo: PX4 cuts the conversion to centimeters off."""
JUDGED, JUDGED_LEAST = 8, 3
"""Newest ranges of an echo that are compared, and the least number; half of them must be repetitions, for the
original of an echo may have been lost on the link."""


class RangeSource(NamedTuple):
    """One range sensor: its component, and (mission key, value) of each mark of its messages."""

    system: int
    component: int
    marks: tuple[tuple[str, int | str], ...]

    @classmethod
    def of(cls, message: Message, kind: RangingMessage) -> "RangeSource":
        """The source of a message."""
        marks = ((key, getattr(message, mark)) for mark, key in kind.marks.items())
        return cls(*ids(message), tuple(marks))

    def __str__(self) -> str:
        marks = (f" {key} {plain_text(str(value))}" for key, value in self.marks)
        return f"{self.system}/{self.component}{''.join(marks)}"

    @property
    def keys(self) -> dict[str, int | str]:
        """All by which a mission may name it."""
        return {**dict(self.marks), "component_id": self.component, "system_id": self.system}


class _Heard:
    """What was received of one source."""

    def __init__(self) -> None:
        self.at = 0.0
        self.picked = False
        self.slant: float | None = None
        self.slants: deque[float] = deque(maxlen=KEPT)
        self.repeats: deque[bool] = deque(maxlen=JUDGED)
        """Whether the newest ranges repeat those of a radio, for a source that is an autopilot."""


class RangeSources:
    """Keeps the sources of the mission's message, those that the mission picks and others."""

    def __init__(self, kind: RangingMessage, settings: RangingSettings) -> None:
        self._kind = kind
        self._listen = max(LISTEN, LISTEN_PERIODS / settings.rate_hz) if settings.listens else 0.0
        self._heard: dict[RangeSource, _Heard] = {}
        self._since: float | None = None
        """Time of the first range of a source that the mission picks, s."""

    def receive(self, message: Message, slant: float | None, now: float, *, picked: bool) -> RangeSource:
        """Take in one message and return its source. slant: m, None where it carries no range. picked: whether the
        mission picks the source."""
        source = RangeSource.of(message, self._kind)
        heard = self._heard.get(source)
        if heard is None:
            if len(self._heard) >= MOST_SOURCES:
                del self._heard[min(self._heard, key=lambda one: self._heard[one].at)]
            heard = self._heard[source] = _Heard()
        heard.at, heard.picked = now, picked
        if picked and self._since is None:
            self._since = now
        if slant is not None:
            heard.slant = slant
            if source.component == AUTOPILOT_COMPONENT:
                heard.repeats.append(self._repeats(source, slant))
            heard.slants.append(slant)
        return source

    def listened(self, now: float) -> bool:
        """True if ranges have come for so long that a second source would have been received."""
        return self._since is not None and now - self._since >= self._listen

    def several(self, now: float) -> bool:
        """True if more than one source fits the mission now."""
        return len(self._heard) > 1 and len(self._rivals(now)) > 1

    def choice(self, now: float) -> str:
        """The sources that fit the mission, their ranges and the keys that name one; empty for fewer than two."""
        rivals = self._rivals(now)
        if len(rivals) < 2:
            return ""
        return f"{len(rivals)} range sources: {self._words(rivals)}: name yours with {' or '.join(differences(rivals))}"

    def short_choice(self, now: float) -> str:
        """The same as a STATUSTEXT."""
        rivals = self._rivals(now)
        return f"{len(rivals)} range sources: set {differences(rivals)[0]}" if len(rivals) > 1 else ""

    def others(self, now: float) -> str:
        """The sources that the mission does not pick, where it picks none that is received; else empty."""
        alive = self._alive(now)
        if not alive or any(self._heard[source].picked for source in alive):
            return ""
        keys = " and ".join(f"ranging.{key}" for key in alive[0].keys if key != "system_id")
        return f"received: {self._words(alive)}, which the mission does not pick: compare {keys}"

    def _alive(self, now: float) -> list[RangeSource]:
        return [source for source, heard in self._heard.items() if now - heard.at <= SOURCE_SILENT]

    def _rivals(self, now: float) -> list[RangeSource]:
        picked = [source for source in self._alive(now) if self._heard[source].picked]
        return picked if len(picked) < 2 else [source for source in picked if not self._is_echo(source)]

    def _is_echo(self, source: RangeSource) -> bool:
        """True if an autopilot repeats the ranges of a radio: ArduPilot and PX4 do so with those that they receive,
        with other ids and less often."""
        repeats = self._heard[source].repeats
        return len(repeats) >= JUDGED_LEAST and sum(repeats) >= len(repeats) / 2

    def _repeats(self, source: RangeSource, slant: float) -> bool:
        radios = (
            heard
            for other, heard in self._heard.items()
            if other.system == source.system and other.component != AUTOPILOT_COMPONENT and heard.picked
        )
        return any(abs(slant - one) <= ECHO_ERROR for heard in radios for one in reversed(heard.slants))

    def _words(self, sources: list[RangeSource]) -> str:
        def one(source: RangeSource) -> str:
            slant = self._heard[source].slant
            return f"{source} ({'no range' if slant is None else f'{slant:.1f} m'})"

        more = ", ..." if len(sources) > MOST_NAMED else ""
        return ", ".join(map(one, sources[:MOST_NAMED])) + more


def differences(sources: list[RangeSource]) -> list[str]:
    """The mission's keys by which these sources differ."""
    return list(_differences(sources))


def _differences(sources: list[RangeSource]) -> Iterator[str]:
    for key in sources[0].keys:
        if len({source.keys[key] for source in sources}) > 1:
            yield f"ranging.{key}"
