"""State of a mission: table of its phases, its time limits, and its outcome."""

from dataclasses import dataclass
from enum import Enum


class OutputMode(Enum):
    """Messages that `Pilot` may send.

    FLY: all.
    DRY_RUN: all but setpoints and mode requests.
    SHADOW: heartbeats and plot values only.
    """

    FLY = "fly"
    DRY_RUN = "dry run"
    SHADOW = "shadow"


class Phase(Enum):
    """Phase of the mission."""

    WAIT_LINK = "waiting for the link"
    WAIT_RANGING = "waiting for ranging"
    READY = "ready"
    ENGAGED = "engaged"
    COASTING = "coasting"
    YIELDED = "yielded"
    LEAVING = "leaving"
    ENDED = "ended"


class Event(Enum):
    """Events that change the phase of a mission."""

    LINK_UP = "link up"
    LINK_LOST = "link lost"
    RANGE_GOOD = "range good"
    RANGE_LOST = "range lost"
    MODE_OURS = "guided mode entered"
    MODE_LEFT = "guided mode left"
    FINISH = "finish"
    FINISH_OURS = "finish while the vehicle is under our control, or its mode was requested"
    SAFE_SENT = "safe setpoint sent"


STEERING = frozenset({Phase.ENGAGED, Phase.COASTING})
"""The only phases in which steering setpoints are sent."""
IN_REACH = STEERING | {Phase.WAIT_RANGING, Phase.READY}
"""Phases in which a vehicle that was engaged may be in the guided mode and reachable."""
NOT_OURS = frozenset({Phase.WAIT_LINK, Phase.YIELDED, Phase.ENDED})
"""Phases in which nothing more is sent to a vehicle that was engaged."""

TRANSITIONS: dict[tuple[Phase, Event], Phase] = {
    (Phase.WAIT_LINK, Event.LINK_UP): Phase.WAIT_RANGING,
    (Phase.WAIT_RANGING, Event.RANGE_GOOD): Phase.READY,
    (Phase.READY, Event.RANGE_LOST): Phase.WAIT_RANGING,
    (Phase.READY, Event.MODE_OURS): Phase.ENGAGED,
    (Phase.ENGAGED, Event.RANGE_LOST): Phase.COASTING,
    (Phase.COASTING, Event.RANGE_GOOD): Phase.ENGAGED,
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
    **{
        (Phase.LEAVING, event): Phase.ENDED
        for event in (Event.SAFE_SENT, Event.MODE_LEFT, Event.LINK_LOST)
    },
}
"""Phase after each pair of phase and event. Pairs that are not listed keep the phase."""


class Ending(Enum):
    """Kinds of ending of a flight."""

    COMPLETED = "completed"
    INTERRUPTED = "interrupted"
    ABORTED = "aborted"
    TAKEN_OVER = "ended"
    """The mode was changed: by the operator, or by a failsafe of the autopilot."""
    NOTHING_RECEIVED = "nothing received"


NO_FAILURE = frozenset({Ending.COMPLETED, Ending.TAKEN_OVER})
"""Endings that raise no alarm."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Ending of a flight, with its human-readable reason."""

    ending: Ending
    reason: str


class MissionState:
    """Phase, times and outcome of a mission. Only events change the phase."""

    def __init__(self, coast: float) -> None:
        """coast: longest time in the phase COASTING, s."""
        self.coast = coast
        self.phase = Phase.WAIT_LINK
        self.since = 0.0
        """Beginning of the phase, s."""
        self.started: float | None = None
        """Time of the first step, s."""
        self.engaged_at: float | None = None
        """Time of the first engagement, s."""
        self.lost_at: float | None = None
        """Time when the link to the steered vehicle was lost, s, or None after it is steered again
        or taken over."""
        self.outcome: Outcome | None = None

    @property
    def steering(self) -> bool:
        """True if the vehicle is steered."""
        return self.phase in STEERING

    @property
    def begun(self) -> bool:
        """True if the vehicle was engaged at any time."""
        return self.engaged_at is not None

    def happened(self, event: Event, now: float) -> bool:
        """Apply an event. Return True if it changed the phase."""
        before = self.phase
        if event is Event.LINK_LOST and self.steering:
            self.lost_at = now
        if event is Event.MODE_LEFT:  # the time limit of a lost link no longer applies
            self.lost_at = None
        self.phase = TRANSITIONS.get((self.phase, event), self.phase)
        if self.phase is before:
            return False
        self.since = now
        if event is Event.MODE_OURS and self.steering:
            self.lost_at = None
            self.engaged_at = now if self.engaged_at is None else self.engaged_at
        return True

    def finish(self, outcome: Outcome, now: float, *, ours: bool) -> bool:
        """End the mission. Return True at the first call, which sets the outcome. ours: True if the
        exit action must be requested."""
        first = self.outcome is None
        self.outcome = self.outcome or outcome
        self.happened(Event.FINISH_OURS if ours else Event.FINISH, now)
        return first
