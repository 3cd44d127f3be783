"""A step of the loop of a flight, and its entries in steps.csv."""

import json
from collections.abc import Hashable
from dataclasses import dataclass, field

from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.guidance.types import Direction

STEPS = "steps.csv"
"""File of the steps in a run folder."""
HELD_BACK = "held"
"""Entry of steps.csv instead of the number of sent frames, if the frames were not sent."""


@dataclass(slots=True)
class LoopStep:
    """One step of the loop.

    received: (link, source, complete frames) of each datagram.
    sent: frames sent to the vehicle.
    hello: frames sent to the ranging link.
    attached: frames that listeners sent to the vehicle.
    requests: requests for another circle from callers outside `Pilot`.
    interrupt: reason why the flight was ended from outside in this step.
    held_back: True if nothing was sent because the step took too long.
    exchanged: frames between listeners and systems other than the vehicle, such as the members of a
        fleet.
    """

    time: float
    received: list[tuple[str, Hashable, list[bytes]]] = field(default_factory=list)
    sent: list[bytes] = field(default_factory=list)
    hello: list[bytes] = field(default_factory=list)
    attached: list[bytes] = field(default_factory=list)
    requests: list[CircleRequest] = field(default_factory=list)
    interrupt: str = ""
    held_back: bool = False
    exchanged: list[bytes] = field(default_factory=list)

    @property
    def received_frames(self) -> list[bytes]:
        """All frames received, in order."""
        return [frame for _, _, datagram in self.received for frame in datagram]


def requests_text(requests: list[CircleRequest]) -> str:
    """Return requests as a cell of steps.csv, empty for none."""
    plain = [
        [one.radius, one.direction and one.direction.value, one.speed, one.by, one.offset, one.pace]
        for one in requests
    ]
    return json.dumps(plain) if plain else ""


def requests_from(text: str) -> list[CircleRequest]:
    """Return the requests in a cell of steps.csv. Raises ValueError or TypeError if the recorder
    cannot have written the cell."""
    return [
        CircleRequest(radius, direction and Direction(direction), speed, by, *spacing)
        for radius, direction, speed, by, *spacing in (json.loads(text) if text else ())
    ]
