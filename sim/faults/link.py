"""Both directions of a link, with somebody who tampers with what passes and somebody who joins in."""

from collections.abc import Callable, Iterable

from .pipe import CLEAN, Impairment, Pipe

UP, DOWN = "up", "down"
"""From the application to the vehicle, and back."""

Passage = tuple[str, bytes]
"""A direction and a datagram that travels it."""
Tamper = Callable[[str, bytes, float], Iterable[Passage]]
"""(direction, datagram, now) -> what travels instead of it: nothing, itself, more, or an answer the other way."""
Intruder = Callable[[float], Iterable[Passage]]
"""now -> what somebody else puts onto the link since the last call."""


class FaultLink:
    """Bytes in with a time, bytes out at their times, in both directions.

    Tampering comes first (it stands for a peer that misbehaves), then what the line does to the bytes. Intruders join
    behind the line, so that what they say arrives.
    """

    def __init__(self, *, up: Impairment = CLEAN, down: Impairment = CLEAN, seed: int = 0) -> None:
        self._pipes = {UP: Pipe(up, 2 * seed), DOWN: Pipe(down, 2 * seed + 1)}
        self.tampers: list[Tamper] = []
        self.intruders: list[Intruder] = []

    def impair(self, *, up: Impairment = CLEAN, down: Impairment = CLEAN) -> None:
        """Be broken in this way from now on."""
        self._pipes[UP].impair(up)
        self._pipes[DOWN].impair(down)

    @property
    def lost(self) -> dict[str, int]:
        """Datagrams that never came out, by direction."""
        return {name: pipe.lost for name, pipe in self._pipes.items()}

    @property
    def next_due(self) -> float:
        """When something comes out next."""
        return min(pipe.next_due for pipe in self._pipes.values())

    def push(self, direction: str, data: bytes, now: float) -> None:
        """One datagram enters at one end."""
        passages: list[Passage] = [(direction, data)]
        for tamper in self.tampers:
            passages = [answer for way, part in passages for answer in tamper(way, part, now)]
        for way, part in passages:
            self._pipes[way].push(part, now)

    def take(self, direction: str, now: float) -> list[bytes]:
        """What comes out at the other end by now."""
        return self._pipes[direction].take(now)

    def intrusions(self, now: float) -> list[Passage]:
        """What others have put onto the link by now, with the direction in which it travels."""
        return [passage for intruder in self.intruders for passage in intruder(now)]
