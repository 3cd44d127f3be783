"""Stalls of this computer: gaps between two steps, in which received data wait."""

from circnav_mav.timers import Since


class Stalls:
    """Detects the gaps between two steps."""

    def __init__(self) -> None:
        self._stepped: float | None = None
        self._newest = 0.0
        """Length of the newest gap, s. `_since`: time since its end."""
        self._since = Since()

    def step(self, now: float) -> None:
        """Begin a step."""
        if self._stepped is not None and self._stood_still(now):
            self._newest = now - self._stepped
            self._since.restart(now)
        self._stepped = now

    def may_be_backlog(self, now: float) -> bool:
        """True if data received now may date from a gap between steps."""
        # 0.2: time after a gap between two steps, s, in which received data may still be stale,
        # because reading the backlog takes a few steps.
        return self._since.age(now) < 0.2 or self._stood_still(now)

    def length(self, now: float) -> float:
        """Return the length of the newest gap between two steps, s, for 4 s after it, because rates
        and ages still show its effects. Then return 0."""
        return self._newest if self._since.age(now) < 4.0 else 0.0

    def _stood_still(self, now: float) -> bool:
        # 0.5: gap between two steps, s, above which data received during the gap is treated as
        # stale.
        return self._stepped is not None and now - self._stepped > 0.5
