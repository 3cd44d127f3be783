"""Where a mission stands: its phases as a table, its times, and how it ended."""

from dataclasses import dataclass
from enum import Enum


class Phase(Enum):
    """Where the mission stands."""

    WAIT_LINK = "waiting for the link"
    WAIT_RANGING = "waiting for ranging"
    READY = "ready"
    ENGAGED = "engaged"
    HOLDING = "holding"
    YIELDED = "yielded"
    LEAVING = "leaving"
    ENDED = "ended"


class Event(Enum):
    """What moves a mission from phase to phase."""

    LINK_UP = "link up"
    LINK_LOST = "link lost"
    RANGE_GOOD = "range good"
    RANGE_LOST = "range lost"
    MODE_OURS = "guided mode entered"
    MODE_LEFT = "guided mode left"
    FINISH = "finish"
    FINISH_OURS = "finish with a vehicle that we have flown, or asked for, and that still is in our mode"
    SAFE_SENT = "safe setpoint sent"


STEERING = frozenset({Phase.ENGAGED, Phase.HOLDING})
"""The phases in which the vehicle is steered: setpoints that steer leave in these and in no other."""
IN_REACH = STEERING | {Phase.WAIT_RANGING, Phase.READY}
"""The phases in which a vehicle that was engaged may still be in our mode."""
NOT_OURS = frozenset({Phase.WAIT_LINK, Phase.YIELDED, Phase.ENDED})
"""The phases in which there is nothing left to say to a vehicle that was engaged."""

TRANSITIONS: dict[tuple[Phase, Event], Phase] = {
    (Phase.WAIT_LINK, Event.LINK_UP): Phase.WAIT_RANGING,
    (Phase.WAIT_RANGING, Event.RANGE_GOOD): Phase.READY,
    (Phase.READY, Event.RANGE_LOST): Phase.WAIT_RANGING,
    (Phase.READY, Event.MODE_OURS): Phase.ENGAGED,
    (Phase.ENGAGED, Event.RANGE_LOST): Phase.HOLDING,
    (Phase.HOLDING, Event.RANGE_GOOD): Phase.ENGAGED,
    (Phase.YIELDED, Event.MODE_OURS): Phase.WAIT_RANGING,
    **{(phase, Event.MODE_LEFT): Phase.YIELDED for phase in IN_REACH},
    **{(phase, Event.LINK_LOST): Phase.WAIT_LINK for phase in (*IN_REACH, Phase.YIELDED)},
    **{(phase, Event.FINISH): Phase.LEAVING for phase in STEERING},
    **{
        (phase, Event.FINISH): Phase.ENDED
        for phase in (Phase.WAIT_LINK, Phase.WAIT_RANGING, Phase.READY, Phase.YIELDED)
    },
    **{(phase, Event.FINISH_OURS): Phase.LEAVING for phase in IN_REACH},
    **{(phase, Event.FINISH_OURS): Phase.ENDED for phase in (Phase.WAIT_LINK, Phase.YIELDED)},
    **{(Phase.LEAVING, event): Phase.ENDED for event in (Event.SAFE_SENT, Event.MODE_LEFT, Event.LINK_LOST)},
}
"""A pair that is not listed changes nothing."""


def advance(phase: Phase, event: Event) -> Phase:
    """The phase after an event."""
    return TRANSITIONS.get((phase, event), phase)


class Ending(Enum):
    """How a flight ended."""

    COMPLETED = "completed"
    INTERRUPTED = "interrupted"
    ABORTED = "aborted"
    NOTHING_HEARD = "nothing heard"


@dataclass(frozen=True, slots=True)
class Outcome:
    """An ending, with the reason for people."""

    ending: Ending
    reason: str


@dataclass(frozen=True, slots=True)
class Timing:
    """All in seconds. duration: of the flight after engaging. wait_link, wait_ranging: patience before the first
    engagement. stale: age of the newest range up to which the prediction steers. hold: how long to hold after that.
    unfollowed: how long the vehicle may not follow turn commands before the exit action. outage: longest silence of the
    vehicle after which the mission resumes. round_trip: to the vehicle and back, above which it is not engaged.
    tick: period without fresh ranges."""

    duration: float
    wait_link: float = 30.0
    wait_ranging: float = 30.0
    stale: float = 0.5
    hold: float = 10.0
    unfollowed: float = 10.0
    outage: float = 60.0
    round_trip: float = 0.6
    tick: float = 0.05


class MissionState:
    """Moves through the phases, by events and in no other way."""

    def __init__(self, hold: float = 10.0) -> None:
        """hold: longest time without ranges, s."""
        self.hold = hold
        self.phase = Phase.WAIT_LINK
        self.since = 0.0
        """When the phase began, s."""
        self.started: float | None = None
        """The first step, s."""
        self.engaged_at: float | None = None
        """The first engagement, s."""
        self.lost_at: float | None = None
        """When the vehicle was lost that was steered, s; None once it is steered again, or was taken over."""
        self.outcome: Outcome | None = None

    @property
    def steering(self) -> bool:
        """Whether the vehicle is steered."""
        return self.phase in STEERING

    @property
    def begun(self) -> bool:
        """Whether the vehicle was engaged at any time."""
        return self.engaged_at is not None

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

    def finish(self, outcome: Outcome, now: float, *, ours: bool) -> bool:
        """The mission ends; tells whether this is the reason why: the first one counts. ours: whether the vehicle is
        to be given back."""
        first = self.outcome is None
        self.outcome = self.outcome or outcome
        self.happened(Event.FINISH_OURS if ours else Event.FINISH, now)
        return first
