"""A step of the loop of a flight, as it is recorded and read back."""

from collections.abc import Hashable
from dataclasses import dataclass, field

HELD_BACK = "held"
"""In turns.csv, in the place of a count: what there was to say was not sent."""


@dataclass(slots=True)
class LoopStep:
    """One step of the loop. heard: (link, source, whole frames) of each datagram. said: frames to the vehicle. hello:
    frames to the ranging link. attached: frames that onlookers sent to the vehicle. interrupt: why the flight was ended
    from outside in this step. held_back: whether what there was to say was not sent."""

    time: float
    heard: list[tuple[str, Hashable, list[bytes]]] = field(default_factory=list)
    said: list[bytes] = field(default_factory=list)
    hello: list[bytes] = field(default_factory=list)
    attached: list[bytes] = field(default_factory=list)
    interrupt: str = ""
    held_back: bool = False

    @property
    def frames_heard(self) -> list[bytes]:
        """All that came in, in order."""
        return [frame for _, _, datagram in self.heard for frame in datagram]
