"""Run time out of the stamps of a plain tlog, whose clock may have been set while it was written."""

from dataclasses import dataclass, field

DISORDER = 100_000
"""Time, us, by which a stamp may lie before the last: two threads of a logger, and no clock that was set."""
USUAL = 1_000_000
"""Time, us, from one stamp to the next beyond which the stamp after it must agree."""
LONGEST = 3_600_000_000
"""Time, us, that a log may be silent; a longer way ahead is a clock that was set, as from 1970 to now."""


@dataclass(slots=True)
class LogClock:
    """The line of time through stamps (us). A step of the clock takes no time on it; a lone stamp that is far off
    moves nothing. steps: (run time, size) of each step, s. lone: how far, s, the lone ones were off."""

    steps: list[tuple[float, float]] = field(default_factory=list)
    lone: list[float] = field(default_factory=list)
    _newest: int | None = None
    _run: int = 0

    def at(self, stamp: int, following: int | None) -> float:
        """Run time, s, of a stamp. following: the stamp after it, None at the end of the log."""
        if self._newest is None:
            self._newest = stamp
        moved = stamp - self._newest
        if -DISORDER <= moved <= USUAL:
            self._go_on(max(moved, 0))
        elif following is not None and _is_lone(moved, following - self._newest):
            self.lone.append(moved / 1e6)
        elif 0 < moved <= LONGEST:
            self._go_on(moved)
        else:
            self.steps.append((self._run / 1e6, moved / 1e6))
            self._newest = stamp
        return self._run / 1e6

    def __str__(self) -> str:
        """What was wrong with the stamps, in words; empty where nothing was."""
        said = []
        if self.steps:
            at, size = max(self.steps, key=lambda step: abs(step[1]))
            how_many = "1 time" if len(self.steps) == 1 else f"{len(self.steps)} times, at most"
            said.append(f"its clock steps {how_many} by {size:+.1f} s (at {at:.1f} s), which is taken for no time")
        if self.lone:
            how_many = "1 lone stamp is" if len(self.lone) == 1 else f"{len(self.lone)} lone stamps are, at most,"
            said.append(f"{how_many} off by {max(self.lone, key=abs):+.1f} s")
        return "; ".join(said)

    def _go_on(self, moved: int) -> None:
        assert self._newest is not None
        self._newest, self._run = self._newest + moved, self._run + moved


def _is_lone(moved: int, then: int) -> bool:
    """Whether the stamp after a far one goes on where the last one stood. Both are told from the last one, us."""
    return -DISORDER <= then <= LONGEST and (moved < 0 or then < moved - DISORDER)
