"""The phases of a mission, as a table. Nothing else decides phases."""

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
    FINISH_OURS = "finish with a vehicle that still is in our mode"
    SAFE_SENT = "safe setpoint sent"


TRANSITIONS: dict[tuple[Phase, Event], Phase] = {
    (Phase.WAIT_LINK, Event.LINK_UP): Phase.WAIT_RANGING,
    (Phase.WAIT_LINK, Event.FINISH): Phase.ENDED,
    (Phase.WAIT_RANGING, Event.LINK_LOST): Phase.WAIT_LINK,
    (Phase.WAIT_RANGING, Event.RANGE_GOOD): Phase.READY,
    (Phase.WAIT_RANGING, Event.MODE_LEFT): Phase.YIELDED,
    (Phase.WAIT_RANGING, Event.FINISH): Phase.ENDED,
    (Phase.WAIT_RANGING, Event.FINISH_OURS): Phase.LEAVING,
    (Phase.READY, Event.LINK_LOST): Phase.WAIT_LINK,
    (Phase.READY, Event.RANGE_LOST): Phase.WAIT_RANGING,
    (Phase.READY, Event.MODE_LEFT): Phase.YIELDED,
    (Phase.READY, Event.MODE_OURS): Phase.ENGAGED,
    (Phase.READY, Event.FINISH): Phase.ENDED,
    (Phase.READY, Event.FINISH_OURS): Phase.LEAVING,
    (Phase.ENGAGED, Event.RANGE_LOST): Phase.HOLDING,
    (Phase.ENGAGED, Event.LINK_LOST): Phase.WAIT_LINK,
    (Phase.ENGAGED, Event.MODE_LEFT): Phase.YIELDED,
    (Phase.ENGAGED, Event.FINISH): Phase.LEAVING,
    (Phase.HOLDING, Event.RANGE_GOOD): Phase.ENGAGED,
    (Phase.HOLDING, Event.LINK_LOST): Phase.WAIT_LINK,
    (Phase.HOLDING, Event.MODE_LEFT): Phase.YIELDED,
    (Phase.HOLDING, Event.FINISH): Phase.LEAVING,
    (Phase.YIELDED, Event.LINK_LOST): Phase.WAIT_LINK,
    (Phase.YIELDED, Event.MODE_OURS): Phase.WAIT_RANGING,
    (Phase.YIELDED, Event.FINISH): Phase.ENDED,
    (Phase.LEAVING, Event.SAFE_SENT): Phase.ENDED,
    (Phase.LEAVING, Event.MODE_LEFT): Phase.ENDED,
    (Phase.LEAVING, Event.LINK_LOST): Phase.ENDED,
}
"""A pair that is not listed changes nothing."""

STEERING = frozenset({Phase.ENGAGED, Phase.HOLDING})
"""The phases in which the vehicle is ours: setpoints flow in these, and in no other but LEAVING."""


def advance(phase: Phase, event: Event) -> Phase:
    """The phase after an event."""
    return TRANSITIONS.get((phase, event), phase)
