"""Independent checks. The judge parses sent setpoints from their bytes and names an exceeded limit.
The witness determines from received frames, by pymavlink alone, when circnav must not steer."""

from dataclasses import dataclass
from hashlib import sha256
from math import asin, atan2, hypot, isfinite
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mission.mission import Mission
from tests.frames import read
from tests.tools.fault_link.frames import message_id

SETPOINTS = {84: "SET_POSITION_TARGET_LOCAL_NED", 82: "SET_ATTITUDE_TARGET", 69: "MANUAL_CONTROL"}
SLACK = 1e-4


@dataclass(frozen=True)
class Allowed:
    """Limits of the mission: rates in rad/s, speeds in m/s, angles in rad."""

    yaw_rate: float
    speed: float
    bank: float
    pitch: float
    climb: float

    @classmethod
    def of(cls, settings: Mission) -> "Allowed":
        facts = settings.facts
        orbit = settings.orbit
        return cls(orbit.max_turn_rate, orbit.speed, facts.max_bank, pitch=0.2618, climb=1.0)


def is_setpoint(frame: bytes) -> bool:
    return message_id(frame) in SETPOINTS


def is_heartbeat(frame: bytes) -> bool:
    return message_id(frame) == 0


def is_safe(frame: bytes) -> bool:
    """Return True if a setpoint commands no motion or level wings. It may command a vertical speed
    to hold the height."""
    message = read(frame)
    if message.get_msgId() == 84:
        return bool(message.vx == 0 and message.vy == 0 and message.yaw_rate == 0)
    if message.get_msgId() == 82:
        return abs(_roll(message.q)) < SLACK
    return bool(message.y == 0)


def broken_rule(frame: bytes, allowed: Allowed) -> str | None:
    """Return the rule that a setpoint breaks, or None."""
    message = read(frame)
    numbers = [getattr(message, name) for name in message.get_fieldnames()]
    flat = [
        one for value in numbers for one in (value if isinstance(value, list | tuple) else [value])
    ]
    if not all(isfinite(value) for value in flat):
        return f"not finite: {message}"
    excess = {
        name: value
        for name, (value, most) in _demands(message, allowed).items()
        if abs(value) > most + SLACK
    }
    return f"beyond the limits: {excess}" if excess else None


def _demands(message: Any, allowed: Allowed) -> dict[str, tuple[float, float]]:
    """Return each commanded value of a setpoint with its limit."""
    if message.get_msgId() == 84:
        return {
            "yaw rate": (message.yaw_rate, allowed.yaw_rate),
            "forward": (message.vx, allowed.speed),
            "sideways": (message.vy, 0.0),
            "climb": (message.vz, allowed.climb),
            # acceleration: half of g against drag, and 1.25 times that of the turn (PX4 damps a
            # fifth)
            "fed": (
                hypot(message.afx, message.afy, message.afz),
                hypot(5.0, 1.25 * allowed.speed * allowed.yaw_rate),
            ),
        }
    if message.get_msgId() == 82:
        w, x, y, z = message.q
        return {
            "norm": (w * w + x * x + y * y + z * z - 1, 0.0),
            "bank": (_roll(message.q), allowed.bank),
            "pitch": (asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))), allowed.pitch),
            "thrust": (message.thrust - 0.5, 0.5),
        }
    return {
        "x": (message.x, 0.0),
        "y": (message.y, 1000.0),
        "r": (message.r, 0.0),
        "z": (message.z - 500, 500.0),
    }


def _roll(q: list[float]) -> float:
    w, x, y, z = q
    return atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))


GUIDED = {
    "arducopter": 4,
    "arduplane": 15,
    "ardurover": 15,
    "px4_copter": 6 << 16,
    "px4_plane": 2 << 16,
}
"""HEARTBEAT.custom_mode of the guided mode, by profile. PX4 has its main mode in the third byte."""
VEHICLE = (1, 1)
ARMED = 128


class Witness:
    """Independent record of the control of the vehicle. taken: True if the vehicle left the guided
    mode. unproved: True if no heartbeat was received since the application was stopped."""

    def __init__(self, profile: str, key: bytes | None = None) -> None:
        """key: signing key of the vehicle. Frames without a valid signature are ignored."""
        self._key = key
        self._newest = 0
        self._guided = GUIDED[profile]
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._was_ours = self._armed = False
        self.taken = self.unproved = False

    def stood_still(self) -> None:
        """Record that the application was stopped for some time. Frames that waited in its socket
        do not prove the present mode."""
        self.unproved = True

    def receive(self, data: bytes, *, waited: bool = False) -> None:
        """Process a datagram that the application receives. waited: True if it arrived while the
        application was stopped."""
        if self._key is not None and not self._signed_now(data):
            return
        for message in self._parser.parse_buffer(data) or ():
            if (message.get_srcSystem(), message.get_srcComponent()) != VEHICLE:
                continue
            if (
                message.get_type() == "HEARTBEAT"
                and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID
            ):
                self._armed = bool(message.base_mode & ARMED)
                self.unproved = self.unproved and waited
                self._note(message.custom_mode)
            elif message.get_type() == "CURRENT_MODE" and message.custom_mode:
                self._note(message.custom_mode)

    def _signed_now(self, data: bytes) -> bool:
        """Return True if a frame has a valid signature and a newer timestamp than all earlier
        frames."""
        stamp = int.from_bytes(data[-12:-6], "little")
        if (
            sha256((self._key or b"") + data[:-6]).digest()[:6] != data[-6:]
            or stamp <= self._newest
        ):
            return False
        self._newest = stamp
        return True

    def _note(self, mode: int) -> None:
        ours = self._armed and mode == self._guided
        self.taken = not ours and (self._was_ours or self.taken)
        self._was_ours = ours
