"""A minimal ground station in lockstep: it sends frames and collects the received messages."""

from collections.abc import Callable
from typing import Any

from circnav_sim.autopilots.modes import PX4
from circnav_sim.config import parse_vehicle
from circnav_sim.vehicle import Truth, Vehicle
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

QUIET = {"truth": {"rate_hz": 0}, "ranging": {"rate_hz": 0.0}}
EXACT = {"attitude_error_deg": 0.0, "gyro_noise_deg_s": 0.0}


class Station:
    """One sender connected to one vehicle on one link. It keeps all received messages."""

    def __init__(
        self, vehicle: Vehicle, system: int = 1, component: int = 191, link: str = "main"
    ) -> None:
        self.vehicle = vehicle
        self.link = link
        self._out = mavlink.MAVLink(None, system, component)
        self._in = mavlink.MAVLink(None)
        self._in.robust_parsing = True
        self.received: list[Any] = []

    def send(self, message: Any) -> None:
        data = message.pack(self._out)
        self._out.seq = (self._out.seq + 1) % 256
        self.vehicle.receive(data, self.link)

    def command(self, number: int, *params: float, target: tuple[int, int] = (1, 1)) -> list[int]:
        """Send COMMAND_LONG and return the results of its new acknowledgements."""
        seven = [*params, *[0.0] * (7 - len(params))]
        before = len(self.acks(number))
        self.send(mavlink.MAVLink_command_long_message(*target, number, 0, *seven))
        return self.acks(number)[before:]

    def set_mode(self, main: int, sub: int = 0) -> list[int]:
        return self.command(176, 1, main, sub)

    def stream(self, number: int, interval_us: float) -> list[int]:
        return self.command(511, number, interval_us)

    def acks(self, number: int) -> list[int]:
        return [m.result for m in self.listen("COMMAND_ACK") if m.command == number]

    def heartbeat(self, kind: int = 18) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(kind, 8, 0, 0, 4, 3))

    def velocity(
        self, vx, yaw_rate, *, mask=0x5C7, frame=8, vz=0.0, sideways=0.0, target=(1, 1)
    ) -> None:
        """Send SET_POSITION_TARGET_LOCAL_NED with a velocity and a yaw rate; `sideways` is an
        acceleration."""
        numbers = (0, 0, 0, vx, 0, vz, 0, sideways, 0, 0, yaw_rate)
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(0, *target, frame, mask, *numbers)
        )

    def turn(self, speed: float, yaw_rate: float) -> None:
        """Send a velocity along the nose and a turn rate, with the acceleration of the turn fed
        forward."""
        self.velocity(speed, yaw_rate, mask=0x407, sideways=speed * yaw_rate)

    def attitude(
        self, mask, roll=0.0, pitch=0.0, yaw=0.0, *, rates=(0.0, 0.0, 0.0), thrust=0.5
    ) -> None:
        """Send SET_ATTITUDE_TARGET; angles in radians."""
        q = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat()
        q = [q[3], *q[:3]]
        self.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, q, *rates, thrust))

    def sticks(self, roll: float) -> None:
        """Send MANUAL_CONTROL: roll from -1 to 1, throttle centered."""
        self.send(mavlink.MAVLink_manual_control_message(1, 0, round(roll * 1000), 500, 0, 0))

    def repeat(self, seconds: float, send: Callable[[], None], rate: float = 20.0) -> None:
        """Call `send` at a rate (Hz) for a time (s)."""
        start = self.vehicle.time
        for tick in range(round(seconds * rate)):
            send()
            self.vehicle.advance(start + (tick + 1) / rate)

    def wait(self, seconds: float) -> None:
        self.vehicle.advance(self.vehicle.time + seconds)

    def listen(self, *kinds: str, source: tuple[int, int] | None = None) -> list[Any]:
        """Return all messages received so far, optionally of some types or from one component
        only."""
        for frame in self.vehicle.outgoing(self.link):
            self.received.extend(self._in.parse_buffer(frame) or [])
        chosen = [m for m in self.received if not kinds or m.get_type() in kinds]
        if source is None:
            return chosen
        return [m for m in chosen if (m.get_srcSystem(), m.get_srcComponent()) == source]

    def forget(self) -> None:
        self.listen()
        self.received.clear()

    @property
    def truth(self) -> Truth:
        return self.vehicle.truth

    @property
    def px4_mode(self) -> str:
        return next(name for name, number in PX4.items() if number == self.truth.mode)

    def texts(self) -> list[str]:
        return [m.text for m in self.listen("STATUSTEXT")]

    def fly(
        self, seconds: float, vx: float, yaw_rate: float, *, rate: float = 20.0, **rest: Any
    ) -> None:
        """Send velocity setpoints at a rate (Hz) for a time (s)."""
        self.repeat(seconds, lambda: self.velocity(vx, yaw_rate, **rest), rate)


def build(**tables: Any) -> Vehicle:
    """Return a vehicle from TOML-like tables."""
    return Vehicle(parse_vehicle(tables, "test.toml"))


def aboard(profile: str = "arducopter", mode: str | None = None, **tables: Any) -> Station:
    """Return the companion of a vehicle in the air that has exact sensors and sends only the
    default streams of its autopilot. Tables [vehicle] and [start] extend `profile` and `mode`."""
    vehicle = {
        "profile": profile,
        "default_streams": not profile.startswith("px4"),
        **tables.pop("vehicle", {}),
    }
    start = {**({} if mode is None else {"mode": mode}), **tables.pop("start", {})}
    return Station(build(vehicle=vehicle, start=start, **{**QUIET, "sensors": EXACT, **tables}))
