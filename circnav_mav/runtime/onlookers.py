"""Those who are shown a flight: none of them may end it."""

from collections.abc import Callable

from circnav_mav.pilot import TickRecord
from circnav_mav.runtime.recorder import Turn

Show = Callable[[TickRecord | None, Turn], None]
"""Gets the newest tick and the turn of the loop, and must not wait for anybody."""


class Onlookers:
    """Shows every turn to each; one that fails is shown no more of them."""

    def __init__(self, shows: dict[str, Show]) -> None:
        """shows: by what people call them."""
        self._shows = dict(shows)
        self.problems: list[str] = []
        """What failed, a line each."""

    def show(self, newest: TickRecord | None, turn: Turn) -> None:
        """Show the newest tick and the turn."""
        for name, show in list(self._shows.items()):
            try:
                show(newest, turn)
            except Exception as error:
                del self._shows[name]
                self.problems.append(f"{name}: stopped at {turn.time:.1f} s: {error!r}")
