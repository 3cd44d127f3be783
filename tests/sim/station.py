"""A ground station in a few lines: frames out, messages in, all in lockstep."""

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from sim.config import parse_vehicle
from sim.vehicle import Vehicle


class Station:
    """One sender talking to one vehicle on one link, keeping what it hears."""

    def __init__(self, vehicle: Vehicle, system: int = 1, component: int = 191, link: str = "main") -> None:
        self.vehicle = vehicle
        self.link = link
        self._out = mavlink.MAVLink(None, system, component)
        self._in = mavlink.MAVLink(None)
        self._in.robust_parsing = True
        self.heard: list[Any] = []

    def send(self, message: Any) -> None:
        data = message.pack(self._out)
        self._out.seq = (self._out.seq + 1) % 256
        self.vehicle.receive(data, self.link)

    def command(self, number: int, *params: float, target: tuple[int, int] = (1, 1)) -> list[int]:
        """Send COMMAND_LONG; the results of its acks so far."""
        seven = [*params, *[0.0] * (7 - len(params))]
        before = len(self.acks(number))
        self.send(mavlink.MAVLink_command_long_message(*target, number, 0, *seven))
        return self.acks(number)[before:]

    def acks(self, number: int) -> list[int]:
        return [m.result for m in self.listen("COMMAND_ACK") if m.command == number]

    def heartbeat(self, kind: int = 18) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(kind, 8, 0, 0, 4, 3))

    def velocity(
        self,
        vx: float,
        yaw_rate: float,
        *,
        mask: int = 0x5C7,
        frame: int = 8,
        vz: float = 0.0,
        target: tuple[int, int] = (1, 1),
    ) -> None:
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, *target, frame, mask, 0, 0, 0, vx, 0, vz, 0, 0, 0, 0, yaw_rate
            )
        )

    def turn(self, speed: float, yaw_rate: float) -> None:
        """A velocity along the nose and a turn rate, with the acceleration of the turn fed forward (mask 0x407)."""
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 8, 0x407, 0, 0, 0, speed, 0, 0, 0, speed * yaw_rate, 0, 0, yaw_rate
            )
        )

    def attitude(
        self,
        mask: int,
        roll: float = 0.0,
        pitch: float = 0.0,
        yaw: float = 0.0,
        *,
        rates: tuple[float, float, float] = (0.0, 0.0, 0.0),
        thrust: float = 0.5,
    ) -> None:
        """SET_ATTITUDE_TARGET; angles in radians."""
        cr, sr, cp, sp = math.cos(roll / 2), math.sin(roll / 2), math.cos(pitch / 2), math.sin(pitch / 2)
        cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
        q = [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
        self.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, q, *rates, thrust))

    def sticks(self, roll: float) -> None:
        """MANUAL_CONTROL: roll -1 .. 1, throttle in the middle."""
        self.send(mavlink.MAVLink_manual_control_message(1, 0, round(roll * 1000), 500, 0, 0))

    def repeat(self, seconds: float, send: Callable[[], None], rate: float = 20.0) -> None:
        """Something sent at a rate for a while."""
        start = self.vehicle.time
        for tick in range(round(seconds * rate)):
            send()
            self.vehicle.advance(start + (tick + 1) / rate)

    def wait(self, seconds: float) -> None:
        self.vehicle.advance(self.vehicle.time + seconds)

    def listen(self, *kinds: str, source: tuple[int, int] | None = None) -> list[Any]:
        """Everything heard so far, or only some kinds, or only from one component."""
        for frame in self.vehicle.outgoing(self.link):
            self.heard.extend(self._in.parse_buffer(frame) or [])
        chosen = [m for m in self.heard if not kinds or m.get_type() in kinds]
        if source is None:
            return chosen
        return [m for m in chosen if (m.get_srcSystem(), m.get_srcComponent()) == source]

    def forget(self) -> None:
        self.listen()
        self.heard.clear()

    def texts(self) -> list[str]:
        return [m.text for m in self.listen("STATUSTEXT")]

    def fly(self, seconds: float, vx: float, yaw_rate: float, *, rate: float = 20.0, **rest: Any) -> None:
        """Setpoints at a rate for a while."""
        self.repeat(seconds, lambda: self.velocity(vx, yaw_rate, **rest), rate)


def build(**tables: Any) -> Vehicle:
    """A vehicle from TOML-like tables."""
    return Vehicle(parse_vehicle(tables, "test.toml"))


def guided(**tables: Any) -> Station:
    """A copter in the air in GUIDED, and its companion."""
    tables.setdefault("vehicle", {"turn_lag_s": 0.0})
    tables.setdefault("start", {"mode": "GUIDED"})
    tables.setdefault("truth", {"rate_hz": 0})
    return Station(build(**tables))
