"""PX4 with its built-in simulator SIH (simulation in hardware): quadrotor and airplane, from the
checkout or the folder of its SITL build in CIRCNAV_PX4. Each vehicle is a separate instance, with
the ports that PX4's start-up script assigns."""

import os
import socket
import struct
import subprocess
from collections.abc import Callable, Iterator
from math import cos, nan, radians, sin
from pathlib import Path
from typing import Any

from circnav_sim.body import euler
from pymavlink.dialects.v20 import all as mavlink

from tests.tools.firmware.bench import ACCEPTED, Bench, Firmware, NoFlightError, Truth, note
from tests.tools.firmware.flight import Flight
from tests.tools.firmware.wire import LOOPBACK, bound

INSTANCES = range(10)
"""Instances with separate ports; more instances would share a port."""
TO_APP = 14540
GROUND_STATION = 18570
"""UDP ports of the first instance: the port to which it sends messages for a companion, and the
port on which it receives a ground station."""
ALTCTL = 2 << 16
OFFBOARD = 6 << 16
TAKEOFF = 4 << 16 | 2 << 24
LOITER = 4 << 16 | 3 << 24
LAND = 4 << 16 | 6 << 24
MODEL = {"copter": "sihsim_quadx", "plane": "sihsim_airplane"}
STREAMS = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 50,
    mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: 50,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 10,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5,
}


def missing() -> str:
    """Return the reason why PX4 cannot run here; empty if it can."""
    if "CIRCNAV_PX4" not in os.environ:
        return "CIRCNAV_PX4 (a PX4 checkout with a SITL build, or the folder of one) is not set"
    return "" if _build() else f"CIRCNAV_PX4: no bin/px4 in {os.environ['CIRCNAV_PX4']}"


def _build() -> Path | None:
    given = Path(os.environ["CIRCNAV_PX4"]).resolve()
    return next(
        (
            one
            for one in (given, given / "build" / "px4_sitl_default")
            if (one / "bin" / "px4").is_file()
        ),
        None,
    )


class Px4(Firmware):
    """A PX4 quadrotor or airplane."""

    earth = 6371000.0

    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        self._kind = flight.what.kind
        self.guided = ALTCTL if flight.vehicle in ("px4_plane", "px4_copter_nogps") else OFFBOARD
        self.steered = frozenset((self.guided,))
        self.holding = LOITER
        self.shared, self._instance = self._claimed()
        self.system = self._instance + 1
        self.own = bound()
        self.own_peer = LOOPBACK, GROUND_STATION + self._instance

    def _claimed(self) -> tuple[socket.socket, int]:
        for instance in INSTANCES:
            try:
                return bound(TO_APP + instance), instance
            except OSError:
                continue
        raise NoFlightError("no instance of PX4 is free")

    def start(self, folder: Path) -> subprocess.Popen[bytes]:
        """Start in a separate folder, where PX4 keeps its parameters. Only parameters that the
        airplane requires are changed: with the default trim for 15 m/s at 489 m above the sea, it
        stalls."""
        build = _build()
        assert build is not None
        parameters = {"MIS_TAKEOFF_ALT": self._flight.altitude, "SDLOG_BACKEND": 0}
        if self._kind == "plane":
            parameters["FW_AIRSPD_TRIM"] = self._flight.speed * self._flight.airspeed_off
        if self._flight.roll_limit is not None:
            parameters["FW_R_LIM"] = self._flight.roll_limit
        environment = {**os.environ, "PX4_SIM_MODEL": MODEL[self._kind], "PX4_HOME_ALT": "0"}
        environment |= {f"PX4_PARAM_{name}": f"{value:g}" for name, value in parameters.items()}
        environment |= {
            f"PX4_PARAM_{name}": value
            for name, value in (one.split("=") for one in self._flight.param)
        }
        scratch = folder / "firmware"
        scratch.mkdir()
        return subprocess.Popen(
            [str(build / "bin" / "px4"), "-i", str(self._instance), "-d", str(build / "etc")],
            cwd=scratch,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=(folder / "firmware.log").open("wb"),
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    def truth(self, bench: Bench, message: Any) -> Truth | None:
        """Return the truth from HIL_STATE_QUATERNION, which contains the state of SIH."""
        if message.get_type() != "HIL_STATE_QUATERNION" or not message.lat:
            return None
        north, east = self.metres(message.lat, message.lon)
        roll, _, yaw = euler(message.attitude_quaternion)
        velocity = (message.vx / 100, message.vy / 100, message.vz / 100)
        altitude = message.alt / 1000
        return Truth(bench.now, north, east, altitude, *velocity, roll, yaw, bench.airspeed)

    def bring_up(self, bench: Bench) -> None:
        """Take off and hold in LOITER."""
        bench.until(lambda: bench.received, 60, "no heartbeat")
        bench.ask_streams(STREAMS, "HIL_STATE_QUATERNION", 50)
        bench.until(lambda: "GLOBAL_POSITION_INT" in bench.latest, 60, "no position")
        bench.rest(5)
        if self._flight.from_ground:
            self.weather(bench)
            return
        home = bench.truth.altitude
        began = bench.now
        while bench.truth.altitude < home + 1.0:
            if bench.now - began > 120:
                raise NoFlightError("it did not take off")
            bench.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, nan, nan, nan, nan, tries=1)
            if bench.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, tries=1) == ACCEPTED:
                bench.rest(8)
        high = home + self._flight.altitude - (1.0 if self._kind == "copter" else 5.0)
        bench.until(lambda: bench.truth.altitude > high, 120, "it did not climb")
        bench.set_mode(LOITER)
        self.weather(bench)
        bench.rest(15)

    def take_off(self, bench: Bench) -> Iterator[tuple[float, Callable[[], None]]]:
        """Command the take-off, and arm."""
        yield 5.0, lambda: bench.request(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, *4 * (nan,))
        yield 6.0, lambda: bench.request(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def climb(
        self, bench: Bench, at: float, meters: float
    ) -> Iterator[tuple[float, Callable[[], None]]]:
        """Raise NoFlightError."""
        raise NoFlightError("--climb is for ArduCopter")

    def weather(self, bench: Bench) -> None:
        """Start the wind. SIH computes the air velocity as ground velocity plus SIH_WIND, so
        SIH_WIND points in the direction from which the wind blows."""
        if self._flight.turbulence:
            note("  SIH has no turbulence")
        if self._flight.wind:
            self.wind(bench, self._flight.wind, self._flight.wind_from)

    def wind(self, bench: Bench, speed: float, from_: float) -> None:
        """Set the wind, m/s, from a direction in degrees."""
        bench.send_parameter("SIH_WIND_N", speed * cos(radians(from_)))
        bench.send_parameter("SIH_WIND_E", speed * sin(radians(from_)))

    def without_gps(self, bench: Bench) -> None:
        """Remove all satellites. The bytes of an integer are sent in the float field."""
        (none,) = struct.unpack("<f", struct.pack("<i", 0))
        bench.send_parameter("SIM_GPS_USED", none, mavlink.MAV_PARAM_TYPE_INT32)
        if self._kind == "copter":  # LOITER requires a position
            self.holding = LAND

    def ask_mode(self, bench: Bench, mode: int) -> None:
        """Request a mode once, without waiting."""
        bench.request(mavlink.MAV_CMD_DO_SET_MODE, 1, mode >> 16 & 0xFF, mode >> 24)

    def circle(self, bench: Bench, north: float, east: float) -> tuple[float, float]:
        """Start PX4's own GPS circle around a place (north, east, m). Return the center of the
        circle."""
        flight = self._flight
        (x, y) = self.degrees_e7(north, east)
        values = (flight.radius if flight.clockwise else -flight.radius, flight.speed, 0.0, nan)
        result = bench.command_at(
            mavlink.MAV_CMD_DO_ORBIT, mavlink.MAV_FRAME_GLOBAL, values, x, y, bench.truth.altitude
        )
        note(f"  DO_ORBIT: result {result}")
        return north, east
