"""What a bad line does to the bytes of one datagram."""

from math import log
from random import Random

from sim.faults.impairment import Impairment

STRAYS = (b"\xfd", b"\xfe", b"\xfd\xff\x00", b"\xfe\x09", b"\x00\xfd\x00\x00")


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
