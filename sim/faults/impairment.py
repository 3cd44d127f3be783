"""What can be wrong with one direction of a link, as numbers, and what that does to the bytes of a datagram."""

from dataclasses import dataclass, field, fields
from math import log
from random import Random
from typing import Any

STRAYS = (b"\xfd", b"\xfe", b"\xfd\xff\x00", b"\xfe\x09", b"\x00\xfd\x00\x00")


def fraction(meaning: str) -> Any:
    """A field from 0 to 1, and of what."""
    return field(default=0.0, metadata={"fraction": meaning})


def duration(meaning: str) -> Any:
    """A field in seconds of the link's clock, and what lasts so long."""
    return field(default=0.0, metadata={"time": meaning})


@dataclass(frozen=True)
class Impairment:
    """One direction of a link.

    outages: (from, to) in which nothing passes. Random outages and the times between them are exponential, jitter is
    uniform; in_order: whether jitter keeps the order, as a stream does. depth: most datagrams that overtake a held one.
    """

    loss: float = fraction("of datagrams that never arrive")
    duplicate: float = fraction("of datagrams that come twice")
    reorder: float = fraction("of datagrams that are overtaken by later ones")
    corrupt: float = fraction("of bytes that become others")
    truncate: float = fraction("of datagrams cut short")
    split: float = fraction("of datagrams that come in two pieces")
    join: float = fraction("of datagrams that wait and lead the next one")
    stray: float = fraction("of datagrams with bytes in front that look like a frame's start")
    delay: float = duration("of everything")
    jitter: float = duration("at most, on top of the delay")
    burst_every: float = duration("mean time between random outages; needs --burst")
    burst: float = duration("mean length of the random outages")
    echo: float = duration("by which a duplicate comes later, as by a second route")
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
