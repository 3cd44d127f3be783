"""Other senders on the link. Each function returns an `Intruder` that sends at a constant rate."""

from collections.abc import Callable, Iterable
from random import Random

from pymavlink.dialects.v20 import all as mavlink

from .frames import frames, raw_frame, write
from .link import DOWN, Intruder, Passage

GCS = (255, 190)
Make = Callable[[int], Iterable[mavlink.MAVLink_message]]
"""Callback(number of earlier calls): returns messages."""


def periodic(
    rate: float, make: Callable[[int], Iterable[bytes]], *, direction: str = DOWN
) -> Intruder:
    """Return an intruder that sends the frames `make(n)` at a rate in Hz, n = 0, 1, ..."""
    progress: list[float] = []  # time of the first call, number of calls of make

    def intruder(now: float) -> list[Passage]:
        if not progress:
            progress.extend((now, 0))
        sent: list[Passage] = []
        while progress[0] + progress[1] / rate <= now:
            sent += [(direction, frame) for frame in make(int(progress[1]))]
            progress[1] += 1
        return sent

    return intruder


def repeating(ids: tuple[int, int], rate: float, make: Make, *, direction: str = DOWN) -> Intruder:
    """Return an intruder that sends the messages `make(n)` under its ids at a rate in Hz."""
    return periodic(
        rate, lambda n: [write(one, *ids, n & 255) for one in make(n)], direction=direction
    )


def vehicle(system: int, *, mode: int = 5) -> Intruder:
    """Return a second ArduCopter in another mode, with its own range sensor. It sends at 4 Hz."""

    def make(n: int) -> list[mavlink.MAVLink_message]:
        stamp = 250 * n + 1000
        return [
            mavlink.MAVLink_heartbeat_message(2, 3, 81, mode, 4, 3),
            mavlink.MAVLink_attitude_message(stamp, 0.1, 0.1, 1.0, 0.0, 0.0, 0.0),
            mavlink.MAVLink_vfr_hud_message(3.0, 3.0, 90, 10, 12.0, 0.0),
            mavlink.MAVLink_distance_sensor_message(stamp, 1, 65000, 5000, 3, 0, 24, 255),
        ]

    return repeating((system, 1), 4.0, make)


def ground_station(rate: float = 100.0) -> Intruder:
    """Return a ground station that floods the link with heartbeats, requests and commands to other
    components."""

    def make(n: int) -> list[mavlink.MAVLink_message]:
        messages = (
            mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
            mavlink.MAVLink_command_long_message(1, 191, 511, 0, 132, 1e5, 0, 0, 0, 0, 0),
            mavlink.MAVLink_param_request_list_message(0, 0),
            mavlink.MAVLink_timesync_message(0, n),
        )
        return [messages[n % len(messages)]]

    return repeating(GCS, rate, make)


def twin(system: int, component: int, rate: float = 1.0) -> Intruder:
    """Return a second companion that sends heartbeats under the ids of the first one."""
    heartbeat = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)
    return repeating((system, component), rate, lambda n: [heartbeat])


def unknown_senders(rate: float, seed: int) -> Intruder:
    """Return an intruder that sends unknown message ids, and new names and system ids all the
    time."""
    chance = Random(seed)

    def make(n: int) -> list[bytes]:
        name = f"N{n}"[:10].encode()
        return [
            raw_frame(
                40_000 + n % 100_000, chance.randbytes(n % 30), n % 250 + 1, n // 250 % 255 + 1, n
            ),
            write(
                mavlink.MAVLink_named_value_float_message(n, name, float(n)),
                n % 250 + 1,
                77,
                n & 255,
            ),
        ]

    return periodic(rate, make)


def tlog_frames(data: bytes) -> list[bytes]:
    """Return the MAVLink 2 frames of a tlog. Each has a timestamp of eight bytes (big-endian, us)
    before it."""
    return list(frames(data, at=8, apart=8))
