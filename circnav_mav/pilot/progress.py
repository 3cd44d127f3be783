"""Where a mission stands: its phase and since when, what has begun, what was lost, and how it ended."""

from collections.abc import Callable

from circnav_mav.guidance.phases import STEERING, Event, Phase, advance
from circnav_mav.pilot.settings import Ending, Outcome

Say = Callable[[str, str], None]
"""Tells people something: a kind, by which repetitions are known, and a text."""


class Progress:
    """Moves through the phases, by events and in no other way."""

    def __init__(self, say: Say, in_our_hands: Callable[[], bool]) -> None:
        """in_our_hands: whether the vehicle obeys us, also where we do not steer it."""
        self._say = say
        self._in_our_hands = in_our_hands
        self.phase = Phase.WAIT_LINK
        self.since = 0.0
        """When the phase began, s."""
        self.started: float | None = None
        """The first step, s."""
        self.engaged_at: float | None = None
        """The first engagement, s."""
        self.lost_at: float | None = None
        """When the vehicle was lost that was ours, s; None once it is ours again."""
        self.outcome: Outcome | None = None

    @property
    def steering(self) -> bool:
        """Whether the vehicle is ours."""
        return self.phase in STEERING

    @property
    def resuming(self) -> bool:
        """Whether the mission waits to go on with what it had begun."""
        return self.engaged_at is not None and self.phase in (Phase.WAIT_RANGING, Phase.READY)

    def happened(self, event: Event, now: float) -> bool:
        """Apply an event; tells whether it changed the phase."""
        before, self.phase = self.phase, advance(self.phase, event)
        if self.phase is before:
            return False
        self.since = now
        return True

    def step(self, now: float) -> None:
        """A step is taken."""
        self.started = now if self.started is None else self.started

    def engage(self, now: float) -> None:
        """The vehicle is ours, for the first time or again."""
        self.happened(Event.MODE_OURS, now)
        self.lost_at = None
        self.engaged_at = now if self.engaged_at is None else self.engaged_at

    def lose(self, now: float) -> None:
        """The vehicle is gone."""
        if self.steering:
            self.lost_at = now
        self.happened(Event.LINK_LOST, now)

    def yield_to_operator(self, now: float) -> None:
        """The vehicle was taken from us; what was lost before is not waited for any more."""
        self.lost_at = None
        self.happened(Event.MODE_LEFT, now)

    def finish(self, ending: Ending, reason: str, now: float) -> None:
        """The mission ends; the first reason counts."""
        if self.outcome is None:
            self.outcome = Outcome(ending, reason)
            self._say("end", f"ended, {reason}")
        ours = self.resuming and self._in_our_hands()
        self.happened(Event.FINISH_OURS if ours else Event.FINISH, now)
