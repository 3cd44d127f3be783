"""MAVLink frames on loopback sockets: split datagrams into frames, and read the command in a
setpoint."""

import socket
from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite, radians, tan
from typing import Any

from circnav_sim.body import euler
from pymavlink.dialects.v20 import all as mavlink

G = 9.80665
FULL_STICK_BANK = radians(50.0)
LOOPBACK = "127.0.0.1"
POSITIONS = frozenset({24, 32, 33, 49, 63, 104, 108, 113, 114, 115, 124, 164, 178, 182, 230, 242})
"""Messages with the vehicle's measured or estimated position or ground velocity. The bench does not
forward them to circnav."""
GLOBAL_POSITION_INT = 33
GPS_HEALTH = frozenset({24, 124})
"""GPS_RAW_INT and GPS2_RAW. Their fix type shows a loss of GPS."""
SETPOINTS = (
    "SET_ATTITUDE_TARGET",
    "SET_POSITION_TARGET_LOCAL_NED",
    "SET_POSITION_TARGET_GLOBAL_INT",
    "MANUAL_CONTROL",
    "RC_CHANNELS_OVERRIDE",
)
YAW_RATE_IGNORED = {"SET_ATTITUDE_TARGET": 4, "SET_POSITION_TARGET_LOCAL_NED": 2048}


@dataclass(frozen=True)
class Setpoint:
    """A setpoint on the link. time: simulated time, s. turn: commanded turn rate, rad/s, positive
    clockwise; None: no turn rate is commanded."""

    time: float
    kind: str
    turn: float | None
    roll: float | None
    finite: bool


def without_position(frame: bytes) -> bytes:
    """Return a GLOBAL_POSITION_INT frame of MAVLink 2 without place and velocity. Time, relative
    altitude and sequence number are kept."""
    message = mavlink.MAVLink(None).decode(bytearray(frame))
    sender = mavlink.MAVLink(None, frame[5], frame[6])
    sender.seq = frame[4]
    bare = mavlink.MAVLink_global_position_int_message(
        message.time_boot_ms, 0, 0, 0, message.relative_alt, 0, 0, 0, 0
    )
    return bytes(bare.pack(sender))


def bound(port: int = 0) -> socket.socket:
    """Return a socket bound to the loopback interface."""
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    one.bind((LOOPBACK, port))
    one.setblocking(False)
    return one


def frames(datagram: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield message id and bytes of every MAVLink frame in a datagram, without decoding."""
    at = 0
    while at + 8 <= len(datagram):
        if datagram[at] == 0xFD and at + 12 <= len(datagram):
            size = 12 + datagram[at + 1] + (13 if datagram[at + 2] & 1 else 0)
            yield int.from_bytes(datagram[at + 7 : at + 10], "little"), datagram[at : at + size]
        elif datagram[at] == 0xFE:
            size = 8 + datagram[at + 1]
            yield datagram[at + 5], datagram[at : at + size]
        else:
            size = 1
        at += size


def mode_shown(number: int, frame: bytes) -> int | None:
    """Return the custom mode in an autopilot's HEARTBEAT. Return None for any other frame."""
    component, payload = (6, 10) if frame[0] == 0xFD else (4, 6)
    if number != 0 or frame[component] != mavlink.MAV_COMP_ID_AUTOPILOT1:
        return None
    return int.from_bytes(frame[payload : payload + 4], "little")


def setpoint(message: Any, time: float, speed: float) -> Setpoint | None:
    """Return the setpoint in a message of circnav, or None. A bank is converted to its coordinated
    turn rate."""
    kind = message.get_type()
    if kind not in SETPOINTS:
        return None
    roll = _roll(message)
    turn = None
    if not (kind in YAW_RATE_IGNORED and message.type_mask & YAW_RATE_IGNORED[kind]):
        turn = getattr(message, "yaw_rate", getattr(message, "body_yaw_rate", None))
    if turn is None and roll is not None:
        turn = G * tan(roll) / speed
    values = [value for value in message.to_dict().values() if isinstance(value, float)]
    return Setpoint(time, kind, turn, roll, all(map(isfinite, values)))


def _roll(message: Any) -> float | None:
    if message.get_type() == "SET_ATTITUDE_TARGET":
        return euler(message.q)[0]
    return message.y / 1000 * FULL_STICK_BANK if message.get_type() == "MANUAL_CONTROL" else None


def parser() -> mavlink.MAVLink:
    """Return a MAVLink parser that skips invalid bytes."""
    one = mavlink.MAVLink(None)
    one.robust_parsing = True
    return one
