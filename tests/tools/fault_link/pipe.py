"""One direction of a link: its impairments as numbers, and the queue that applies them to
datagrams."""

import heapq
from dataclasses import dataclass, field, fields
from math import log
from random import Random
from typing import Any

LONGEST_HELD = 1.0
"""Longest time for which a datagram is delayed for reordering or joining, s."""
STRAYS = (b"\xfd", b"\xfe", b"\xfd\xff\x00", b"\xfe\x09", b"\x00\xfd\x00\x00")


def fraction(meaning: str) -> Any:
    """Return a field with a value from 0 to 1 and its meaning."""
    return field(default=0.0, metadata={"fraction": meaning})


def duration(meaning: str) -> Any:
    """Return a field with a time in seconds of the link's clock, and its meaning."""
    return field(default=0.0, metadata={"time": meaning})


@dataclass(frozen=True)
class Impairment:
    """Impairments of one direction of a link.

    outages: (from, to) without any datagram, s. Random outages and the times between them have
    exponentially distributed lengths. Jitter is uniformly distributed. in_order: True if jitter
    keeps the order, as in a stream. depth: largest number of datagrams that overtake a delayed one.
    """

    loss: float = fraction("of datagrams that never arrive")
    duplicate: float = fraction("of datagrams that arrive twice")
    reorder: float = fraction("of datagrams that are overtaken by later ones")
    corrupt: float = fraction("of bytes that are changed")
    truncate: float = fraction("of datagrams cut short")
    split: float = fraction("of datagrams that arrive in two pieces")
    join: float = fraction("of datagrams that wait and are sent together with the next one")
    stray: float = fraction("of datagrams with bytes in front that look like a frame's start")
    delay: float = duration("constant delay")
    jitter: float = duration("largest additional delay")
    burst_every: float = duration("mean time between random outages; needs --burst")
    burst: float = duration("mean length of the random outages")
    echo: float = duration("delay of a duplicate, as by a second route")
    outages: tuple[tuple[float, float], ...] = ()
    in_order: bool = False
    depth: int = 5

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if "fraction" in f.metadata and not 0 <= value <= 1:
                raise ValueError(f"{f.name}: must be between 0 and 1, not {value:g}")
            if "time" in f.metadata and not 0 <= value < float("inf"):
                raise ValueError(f"{f.name}: must be a time of at least 0 s, not {value:g}")
        if self.depth < 1:
            raise ValueError(f"depth: must be at least 1, not {self.depth}")

    def __str__(self) -> str:
        set_values = [
            (f.name, getattr(self, f.name))
            for f in fields(self)
            if getattr(self, f.name) != f.default
        ]
        return ", ".join(f"{name}={value}" for name, value in set_values) or "clean"


CLEAN = Impairment()


def damaged(data: bytes, impairment: Impairment, chance: Random) -> list[bytes]:
    """Return the pieces of a datagram that arrive: cut, with changed bytes and stray bytes in
    front, or split."""
    if impairment.truncate and chance.random() < impairment.truncate:
        data = data[: chance.randrange(len(data) + 1)]
    if impairment.corrupt:
        data = corrupted(data, impairment.corrupt, chance)
    if impairment.stray and chance.random() < impairment.stray:
        data = chance.choice(STRAYS) + data
    if impairment.split and len(data) > 1 and chance.random() < impairment.split:
        at = chance.randrange(1, len(data))
        return [data[:at], data[at:]]
    return [data] if data else []


def corrupted(data: bytes, fraction: float, chance: Random) -> bytes:
    """Change each byte with probability `fraction`. For speed, draw the gaps between changed bytes,
    not each byte."""
    changed = bytearray(data)
    at = -1
    while True:
        at += 1 + (int(log(1.0 - chance.random()) / log(1.0 - fraction)) if fraction < 1 else 0)
        if at >= len(changed):
            return bytes(changed)
        changed[at] ^= chance.randrange(1, 256)


class Pipe:
    """Queue of datagrams with their due times. Equal seeds impair the datagrams equally."""

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
        """Set another impairment from now on. Datagrams in the queue stay as they are."""
        self.impairment = impairment
        self._burst = None

    @property
    def next_due(self) -> float:
        """Time at which the next datagram is due; infinity if the queue is empty."""
        waiting = [since + LONGEST_HELD for _, since, _ in self._held]
        if self._joining is not None:
            waiting.append(self._joining[0] + LONGEST_HELD)
        if self._due:
            waiting.append(self._due[0][0])
        return min(waiting, default=float("inf"))

    def push(self, data: bytes, now: float) -> None:
        """Put one datagram into the queue."""
        if self._swallowed(now):
            self.lost += 1
            return
        for piece in damaged(data, self.impairment, self._chance):
            self._order(piece, now)

    def take(self, now: float) -> list[bytes]:
        """Return the datagrams that are due by now, in order."""
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
        """Return True during a random outage. At the end of an outage, draw the next outage."""
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
        """Join, hold back or send a datagram. Then send the held datagrams that enough others have
        overtaken."""
        impairment = self.impairment
        chance = self._chance
        if self._joining is not None:
            data = self._joining[1] + data
            self._joining = None
        elif impairment.join and chance.random() < impairment.join:
            self._joining = now, data
            return
        if impairment.reorder and chance.random() < impairment.reorder:
            self._held.append((chance.randint(1, impairment.depth), now, data))
            return
        self._send(data, now)
        held = self._held
        self._held = []
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
        due = (
            now
            + impairment.delay
            + (self._chance.uniform(0, impairment.jitter) if impairment.jitter else 0.0)
        )
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
