"""Both directions of a link, with tampering of its datagrams and with other senders on it."""

from collections.abc import Callable, Iterable

from .pipe import CLEAN, Impairment, Pipe

UP = "up"
DOWN = "down"
"""Directions: application to vehicle, and vehicle to application."""

Passage = tuple[str, bytes]
"""A direction and a datagram."""
Tamper = Callable[[str, bytes, float], Iterable[Passage]]
"""(direction, datagram, now) -> datagrams that replace it, in either direction."""
Intruder = Callable[[float], Iterable[Passage]]
"""(now) -> datagrams that another sender has sent since the last call, with their directions."""


class FaultLink:
    """A link in both directions: datagrams are put in with the present time and taken out when they
    are due.

    Tampering comes first (it represents a peer that misbehaves), then the impairment. Datagrams of
    intruders are added after the impairment, so they arrive complete.
    """

    def __init__(self, *, up: Impairment = CLEAN, down: Impairment = CLEAN, seed: int = 0) -> None:
        self._pipes = {UP: Pipe(up, 2 * seed), DOWN: Pipe(down, 2 * seed + 1)}
        self.tampers: list[Tamper] = []
        self.intruders: list[Intruder] = []

    def impair(self, *, up: Impairment = CLEAN, down: Impairment = CLEAN) -> None:
        """Set the impairments from now on."""
        self._pipes[UP].impair(up)
        self._pipes[DOWN].impair(down)

    @property
    def lost(self) -> dict[str, int]:
        """Number of lost datagrams by direction."""
        return {name: pipe.lost for name, pipe in self._pipes.items()}

    @property
    def next_due(self) -> float:
        """Time at which the next datagram is due."""
        return min(pipe.next_due for pipe in self._pipes.values())

    def push(self, direction: str, data: bytes, now: float) -> None:
        """Send one datagram in a direction."""
        passages: list[Passage] = [(direction, data)]
        for tamper in self.tampers:
            passages = [answer for way, part in passages for answer in tamper(way, part, now)]
        for way, part in passages:
            self._pipes[way].push(part, now)

    def take(self, direction: str, now: float) -> list[bytes]:
        """Return the datagrams of a direction that are due by now."""
        return self._pipes[direction].take(now)

    def intrusions(self, now: float) -> list[Passage]:
        """Return the intruders' new datagrams with their directions."""
        return [passage for intruder in self.intruders for passage in intruder(now)]
