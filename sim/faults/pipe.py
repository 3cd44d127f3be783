"""One direction: datagrams in at their times, what is left of them out at theirs."""

import heapq
from random import Random

from .impairment import Impairment, damaged

LONGEST_HELD = 1.0
"""Time, s, after which a datagram held back for reordering or joining goes out all the same."""


class Pipe:
    """Takes datagrams with a time, gives them out when they are due. The same seed breaks them in the same way."""

    def __init__(self, impairment: Impairment, seed: int) -> None:
        self.impairment = impairment
        self._chance = Random(seed)
        self._due: list[tuple[float, int, bytes]] = []
        self._held: list[tuple[int, float, bytes]] = []
        self._joining: tuple[float, bytes] | None = None
        self._count = 0
        self._last = float("-inf")
        self._burst: tuple[float, float] | None = None
        self.lost = 0

    def impair(self, impairment: Impairment) -> None:
        """Break it in another way from now on; what is under way stays under way."""
        self.impairment, self._burst = impairment, None

    @property
    def next_due(self) -> float:
        """When something comes out next, infinity when nothing is under way."""
        waiting = [since + LONGEST_HELD for _, since, _ in self._held]
        if self._joining is not None:
            waiting.append(self._joining[0] + LONGEST_HELD)
        if self._due:
            waiting.append(self._due[0][0])
        return min(waiting, default=float("inf"))

    def push(self, data: bytes, now: float) -> None:
        """One datagram enters."""
        if self._swallowed(now):
            self.lost += 1
            return
        for piece in damaged(data, self.impairment, self._chance):
            self._order(piece, now)

    def take(self, now: float) -> list[bytes]:
        """What is due by now, in order."""
        self._release_old(now)
        out = []
        while self._due and self._due[0][0] <= now:
            out.append(heapq.heappop(self._due)[2])
        return out

    def _swallowed(self, now: float) -> bool:
        impairment = self.impairment
        if any(since <= now < until for since, until in impairment.outages) or self._in_burst(now):
            return True
        return impairment.loss > 0 and self._chance.random() < impairment.loss

    def _in_burst(self, now: float) -> bool:
        """Whether a random outage is under way; the next one is drawn when one is over."""
        impairment = self.impairment
        if not (impairment.burst_every and impairment.burst):
            return False
        while self._burst is None or now >= self._burst[1]:
            since = (now if self._burst is None else self._burst[1]) + self._chance.expovariate(
                1 / impairment.burst_every
            )
            self._burst = since, since + self._chance.expovariate(1 / impairment.burst)
        return now >= self._burst[0]

    def _order(self, data: bytes, now: float) -> None:
        """Join, hold back or send; whoever was held back long enough follows."""
        impairment, chance = self.impairment, self._chance
        if self._joining is not None:
            data, self._joining = self._joining[1] + data, None
        elif impairment.join and chance.random() < impairment.join:
            self._joining = now, data
            return
        if impairment.reorder and chance.random() < impairment.reorder:
            self._held.append((chance.randint(1, impairment.depth), now, data))
            return
        self._send(data, now)
        held, self._held = self._held, []
        for left, since, late in held:
            if left <= 1:
                self._send(late, now)
            else:
                self._held.append((left - 1, since, late))

    def _send(self, data: bytes, now: float) -> None:
        impairment = self.impairment
        self._schedule(data, now)
        if impairment.duplicate and self._chance.random() < impairment.duplicate:
            self._schedule(data, now + impairment.echo)

    def _schedule(self, data: bytes, now: float) -> None:
        impairment = self.impairment
        due = now + impairment.delay + (self._chance.uniform(0, impairment.jitter) if impairment.jitter else 0.0)
        if impairment.in_order:
            self._last = due = max(due, self._last)
        self._count += 1
        heapq.heappush(self._due, (due, self._count, data))

    def _release_old(self, now: float) -> None:
        old = [data for _, since, data in self._held if now - since >= LONGEST_HELD]
        self._held = [held for held in self._held if now - held[1] < LONGEST_HELD]
        if self._joining is not None and now - self._joining[0] >= LONGEST_HELD:
            old.append(self._joining[1])
            self._joining = None
        for data in old:
            self._send(data, now)
