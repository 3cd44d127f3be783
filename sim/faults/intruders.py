"""Others on the link: each function makes an intruder that speaks at a steady rate."""

from collections.abc import Callable, Iterable
from pathlib import Path
from random import Random

from pymavlink.dialects.v20 import all as mavlink

from .frames import frames, message_id, raw_frame, write
from .link import DOWN, Intruder, Passage

GCS = (255, 190)


def speaking(rate: float, words: Callable[[int], Iterable[bytes]], *, direction: str = DOWN) -> Intruder:
    """Says `words(n)` at a rate in Hz, n counting from 0."""
    spoken: list[float] = []

    def intruder(now: float) -> list[Passage]:
        if not spoken:
            spoken.extend((now, 0))
        said: list[Passage] = []
        while spoken[0] + spoken[1] / rate <= now:
            said += [(direction, frame) for frame in words(int(spoken[1]))]
            spoken[1] += 1
        return said

    return intruder


def vehicle(system: int, rate: float = 4.0, *, mode: int = 5, range_cm: int = 5000) -> Intruder:
    """Another ArduCopter in another mode, with a range sensor of its own."""

    def words(n: int) -> list[bytes]:
        stamp = int(1000 * n / rate) + 1000
        said = (
            mavlink.MAVLink_heartbeat_message(2, 3, 81, mode, 4, 3),
            mavlink.MAVLink_attitude_message(stamp, 0.1, 0.1, 1.0, 0.0, 0.0, 0.0),
            mavlink.MAVLink_vfr_hud_message(3.0, 3.0, 90, 10, 12.0, 0.0),
            mavlink.MAVLink_distance_sensor_message(stamp, 1, 65000, range_cm, 3, 0, 24, 255),
        )
        return [write(message, system, 1, n & 255) for message in said]

    return speaking(rate, words)


def ground_station(rate: float = 100.0) -> Intruder:
    """A ground station that floods the link: heartbeats, requests, commands for others."""

    def words(n: int) -> list[bytes]:
        said = (
            mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
            mavlink.MAVLink_command_long_message(1, 191, 511, 0, 132, 1e5, 0, 0, 0, 0, 0),
            mavlink.MAVLink_param_request_list_message(0, 0),
            mavlink.MAVLink_timesync_message(0, n),
        )
        return [write(said[n % len(said)], *GCS, n & 255)]

    return speaking(rate, words)


def twin(system: int, component: int, rate: float = 1.0) -> Intruder:
    """Another companion that sends under the same ids."""
    heartbeat = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)
    return speaking(rate, lambda n: [write(heartbeat, system, component, n & 255)])


def strangers(rate: float, seed: int) -> Intruder:
    """Unknown ids, ever new names and system ids."""
    chance = Random(seed)

    def words(n: int) -> list[bytes]:
        name = f"N{n}"[:10].encode()
        return [
            raw_frame(40_000 + n % 100_000, chance.randbytes(n % 30), n % 250 + 1, n // 250 % 255 + 1, n),
            write(mavlink.MAVLink_named_value_float_message(n, name, float(n)), n % 250 + 1, 77, n & 255),
        ]

    return speaking(rate, words)


def recorded(path: Path, rate: float, wanted: frozenset[int] | None = None) -> Intruder:
    """The frames of a tlog, again and again, of some message ids or all."""
    said = [frame for frame in tlog_frames(path.read_bytes()) if wanted is None or message_id(frame) in wanted]
    if not said:
        raise ValueError(f"{path}: holds no such frame")
    return speaking(rate, lambda n: [said[n % len(said)]])


def tlog_frames(data: bytes) -> list[bytes]:
    """The MAVLink 2 frames of a tlog: eight bytes of time (big-endian, us) before each."""
    return list(frames(data, at=8, apart=8))
