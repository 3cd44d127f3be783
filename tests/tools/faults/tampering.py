"""Misbehaving peers. Each function returns a `Tamper` for a `FaultLink`, which changes certain
frames."""

from collections.abc import Callable, Iterable
from itertools import count
from math import floor
from random import Random

from pymavlink.dialects.v20 import all as mavlink

from tests.frames import read, rewritten, sender
from tests.tools.fault_link.frames import message_id, write
from tests.tools.fault_link.link import DOWN, UP, Passage, Tamper

DISTANCE_SENSOR = 132
COMMAND_LONG = 76
COMMAND_ACK = 77
STAMPED = {
    132: "time_boot_ms",
    30: "time_boot_ms",
    2: "time_boot_ms",
    251: "time_boot_ms",
    513: "time_usec",
}
WRAP = 2**32

Change = Callable[[bytes, float], Iterable[bytes]]
"""Callback(frame, now): returns the frames that replace it."""


def on(number: int, change: Change, *, direction: str = DOWN) -> Tamper:
    """Apply a change to the frames of one message type. All other frames pass unchanged."""

    def tamper(way: str, data: bytes, now: float) -> Iterable[Passage]:
        if way != direction or message_id(data) != number:
            return [(way, data)]
        return [(way, frame) for frame in change(data, now)]

    return tamper


def dropping(number: int) -> Tamper:
    """Drop every frame of a message."""
    return on(number, lambda frame, now: ())


def sometimes(fraction: float, seed: int, **values: float) -> Change:
    """Change values in a random fraction of the frames."""
    chance = Random(seed)
    return lambda frame, now: [rewritten(frame, **values) if chance.random() < fraction else frame]


def outliers(fraction: float, metres: tuple[float, float], seed: int) -> Change:
    """Shift a fraction of the ranges, in either direction."""
    chance = Random(seed)

    def change(frame: bytes, now: float) -> list[bytes]:
        if chance.random() >= fraction:
            return [frame]
        return [_shifted(frame, chance.choice((-1, 1)) * chance.uniform(*metres))]

    return change


def noise(sigma: float, seed: int) -> Change:
    """Add Gaussian noise to every range, m."""
    chance = Random(seed)
    return lambda frame, now: [_shifted(frame, chance.gauss(0.0, sigma))]


def offset(metres: float) -> Change:
    """Shift every range by the same distance, m, as a reflected signal does."""
    return lambda frame, now: [_shifted(frame, metres)]


def scaled(share: float, seed: int) -> Change:
    """Multiply every range by a factor, as a radio with another unit does."""
    return lambda frame, now: [_set_cm(frame, round(share * read(frame).current_distance))]


def quantised(metres: float) -> Change:
    """Round ranges to steps, m."""
    step = round(metres * 100)
    return lambda frame, now: [
        _set_cm(frame, step * floor(read(frame).current_distance / step + 0.5))
    ]


def stuck(*, new_stamps: bool) -> Change:
    """Repeat the first range forever, under its own timestamp or new ones."""
    first: list[bytes] = []

    def change(frame: bytes, now: float) -> list[bytes]:
        if not first:
            first.append(frame)
        return [_set_cm(frame, read(first[0]).current_distance) if new_stamps else first[0]]

    return change


def every(count: int) -> Change:
    """Pass one frame out of `count`."""
    seen = [0]

    def change(frame: bytes, now: float) -> list[bytes]:
        seen[0] += 1
        return [frame] if seen[0] % count == 0 else []

    return change


def stamps(shift: Callable[[float, float], float]) -> Change:
    """Change timestamps: `shift` maps the timestamp and the link's time, both s, to the new
    timestamp, s."""

    def change(frame: bytes, now: float) -> list[bytes]:
        name = STAMPED[message_id(frame)]
        unit = 1e6 if name == "time_usec" else 1e3
        stamp = round(shift(getattr(read(frame), name) / unit, now) * unit)
        return [rewritten(frame, **{name: stamp % (WRAP if unit == 1e3 else WRAP**2)})]

    return change


def answered(number: int, result: int) -> Tamper:
    """Answer a command with this result in the vehicle's name. The vehicle does not receive the
    command."""
    sequence = count()

    def tamper(way: str, data: bytes, now: float) -> Iterable[Passage]:
        if way != UP or message_id(data) != COMMAND_LONG or read(data).command != number:
            return [(way, data)]
        return [
            (DOWN, acknowledgement(number, result, sender(data), sequence=next(sequence) & 255))
        ]

    return tamper


def acknowledgement(
    number: int,
    result: int,
    to: tuple[int, int],
    by: tuple[int, int] = (1, 1),
    sequence: int = 0,
) -> bytes:
    """Return a COMMAND_ACK frame."""
    return write(mavlink.MAVLink_command_ack_message(number, result, 0, 0, *to), *by, sequence)


def late(number: int, seconds: float) -> Tamper:
    """Delay the frames of a message, s. Later frames of other messages overtake them."""
    waiting: list[tuple[float, bytes]] = []

    def tamper(way: str, data: bytes, now: float) -> Iterable[Passage]:
        due = [frame for time, frame in waiting if time <= now]
        waiting[:] = [(time, frame) for time, frame in waiting if time > now]
        if way == DOWN and message_id(data) == number:
            waiting.append((now + seconds, data))
            return [(DOWN, frame) for frame in due]
        return [(DOWN, frame) for frame in due] + [(way, data)]

    return tamper


def repeated_later(
    seconds: float, chosen: Callable[[str, bytes], bool] = lambda way, data: True
) -> Tamper:
    """Repeat a fifth of the chosen frames after a delay, s, as a replay attack or a looped route
    does."""
    received: list[tuple[float, Passage]] = []
    numbers = count()

    def tamper(way: str, data: bytes, now: float) -> Iterable[Passage]:
        if chosen(way, data) and next(numbers) % 5 == 0:
            received.append((now + seconds, (way, data)))
        due = [passage for time, passage in received if time <= now]
        received[:] = [item for item in received if item[0] > now]
        return [(way, data), *due]

    return tamper


def _shifted(frame: bytes, metres: float) -> bytes:
    return _set_cm(frame, read(frame).current_distance + round(100 * metres))


def _set_cm(frame: bytes, cm: int) -> bytes:
    return rewritten(frame, current_distance=min(max(cm, 1), 65534))
