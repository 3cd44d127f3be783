"""What the server knows of the flight: enough to bring a late browser up to date, bounded however long it flies."""

import json
from collections import deque
from typing import Any

MOST_POINTS = 3000
"""Points of a chart; beyond that every second one is dropped, and from then on half as many are kept."""
NEWEST = 100
"""Ticks kept whole; a browser that is farther behind gets everything anew."""
COLUMNS = ("time", "measured", "r", "r_dot", "turn_rate", "x", "y", "drift_x", "drift_y", "east", "north", "heading",
           "state", "mode", "law", "desired")  # fmt: skip
"""What a point holds of a tick."""


class History:
    """Takes lines of the feed, gives server-sent events."""

    def __init__(self) -> None:
        self.count = 0
        """Ticks so far."""
        self.over = False
        """Whether nothing more will come."""
        self._flight: dict[str, Any] = {}
        self._end: dict[str, Any] = {"verdict": None}
        self._points: list[list[float | str | None]] = []
        self._every = 1
        self._newest: deque[str] = deque(maxlen=NEWEST)

    def take(self, line: bytes) -> None:
        """One line of the feed."""
        what = json.loads(line)
        kind = what.pop("kind")
        if kind == "flight":
            self._flight = what
        elif kind == "end":
            self._end = what
        else:
            self._newest.append(json.dumps(what))
            self._keep([what[name] for name in COLUMNS])

    def _keep(self, point: list[float | str | None]) -> None:
        if self.count % self._every == 0:
            self._points.append(point)
        self.count += 1
        if len(self._points) > MOST_POINTS:
            self._points = self._points[::2]
            self._every *= 2

    def since(self, seen: int | None) -> list[str]:
        """The events for a browser that has seen so many ticks, None for nothing at all yet."""
        if seen is None or self.count - seen > len(self._newest):
            return [_event("history", self._all())]
        behind = self.count - seen
        return [_event("tick", tick) for tick in list(self._newest)[len(self._newest) - behind :]]

    @property
    def end(self) -> str:
        """The last event of all: with a verdict, or without one where the flight's process just went."""
        return _event("end", json.dumps(self._end))

    def _all(self) -> str:
        """Everything that a browser needs to begin."""
        newest = json.loads(self._newest[-1]) if self._newest else None
        whole = {"flight": self._flight, "columns": COLUMNS, "points": self._points, "every": self._every}
        return json.dumps({**whole, "most": MOST_POINTS, "count": self.count, "newest": newest})


def _event(kind: str, data: str) -> str:
    return f"event: {kind}\ndata: {data}\n\n"
