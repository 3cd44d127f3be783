"""What can be wrong with one direction of a link, as numbers, and what that does to the bytes of a datagram."""

from dataclasses import dataclass, fields
from math import log
from random import Random

FRACTIONS = ("loss", "duplicate", "reorder", "corrupt", "truncate", "split", "join", "stray")
STRAYS = (b"\xfd", b"\xfe", b"\xfd\xff\x00", b"\xfe\x09", b"\x00\xfd\x00\x00")


@dataclass(frozen=True)
class Impairment:
    """One direction. Fractions are of datagrams unless said otherwise; times in s of the link's clock.

    loss: at random. outages: (from, to) in which nothing passes. burst_every, burst: mean times between and of random
    outages, both exponential. delay: of everything; jitter: uniform on top of it; in_order: whether jitter keeps the
    order, as a stream does. reorder: held back until 1 .. depth later ones have passed. duplicate: a second time at
    once, or by another route `echo` later. corrupt: fraction of bytes. truncate: cut short. split: in two datagrams.
    join: kept to lead the next one. stray: bytes in front that look like a frame's start.
    """

    loss: float = 0.0
    outages: tuple[tuple[float, float], ...] = ()
    burst_every: float = 0.0
    burst: float = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    in_order: bool = False
    reorder: float = 0.0
    depth: int = 5
    duplicate: float = 0.0
    echo: float = 0.0
    corrupt: float = 0.0
    truncate: float = 0.0
    split: float = 0.0
    join: float = 0.0
    stray: float = 0.0

    def __post_init__(self) -> None:
        for name in FRACTIONS:
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name}: must be between 0 and 1, not {getattr(self, name):g}")
        for name in ("burst_every", "burst", "delay", "jitter", "echo"):
            if not 0 <= getattr(self, name) < float("inf"):
                raise ValueError(f"{name}: must be a time of at least 0 s, not {getattr(self, name):g}")
        if self.depth < 1:
            raise ValueError(f"depth: must be at least 1, not {self.depth}")

    def __str__(self) -> str:
        set_values = [(f.name, getattr(self, f.name)) for f in fields(self) if getattr(self, f.name) != f.default]
        return ", ".join(f"{name}={value}" for name, value in set_values) or "clean"


CLEAN = Impairment()


def damaged(data: bytes, impairment: Impairment, chance: Random) -> list[bytes]:
    """The pieces that arrive of one datagram: cut, with flipped bytes and stray ones in front, in two."""
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
    """Each byte becomes another one with a probability; the gaps between those that do are drawn, not each byte."""
    spoilt = bytearray(data)
    at = -1
    while True:
        at += 1 + (int(log(1.0 - chance.random()) / log(1.0 - fraction)) if fraction < 1 else 0)
        if at >= len(spoilt):
            return bytes(spoilt)
        spoilt[at] ^= chance.randrange(1, 256)
