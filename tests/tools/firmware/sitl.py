"""ArduPilot SITL: `arduplane`, `arducopter`, `ardurover` from the folder in CIRCNAV_ARDUPILOT, on
loopback links.

The stock parameters are part of the sources: in the checkout that contains the binaries, or in the
folder CIRCNAV_ARDUPILOT_PARAMS (plane.parm, copter.parm, rover.parm).
"""

import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from tests.tools.firmware.bench import ACCEPTED, Bench, Firmware, NoFlightError, Truth, note
from tests.tools.firmware.flight import Flight, circle_rate
from tests.tools.firmware.wire import LOOPBACK, bound

HOME = "-35.363261,149.165230,584,353"
POSITION_KNOWN = 0x13
"""Flags of EKF_STATUS_REPORT that must be set: attitude, horizontal velocity, absolute horizontal
position."""
TAKEOFF = 13
STOCK_CRUISE = 22.0
"""AIRSPEED_CRUISE of the stock plane, m/s."""
GUIDED = {"plane": 15, "copter": 4, "rover": 15}
HOLDING = {"plane": 12, "copter": 17, "rover": 4}
CIRCLE = {"copter": 7, "rover": 9}
ALT_HOLD = 2
LOITER = 5
GUIDED_NOGPS = 20
WITHOUT_GPS = ("copter_nogps", "home_copter")
"""Vehicles that lose their GPS before circnav starts."""


def missing(kind: str) -> str:
    """Return the reason why this kind of vehicle cannot run here; empty if it can."""
    folder = os.environ.get("CIRCNAV_ARDUPILOT", "")
    if not folder:
        return "CIRCNAV_ARDUPILOT (folder with arduplane, arducopter, ardurover) is not set"
    if not (Path(folder) / f"ardu{kind}").is_file():
        return f"CIRCNAV_ARDUPILOT: no ardu{kind} in {folder}"
    return "" if _parameters(kind) else f"no {kind}.parm found: set CIRCNAV_ARDUPILOT_PARAMS"


def _parameters(kind: str) -> Path | None:
    folders = [Path(os.environ.get("CIRCNAV_ARDUPILOT_PARAMS", "/dev/null"))]
    for parent in Path(os.environ["CIRCNAV_ARDUPILOT"]).resolve().parents:
        autotest = parent / "Tools" / "autotest"
        folders += [autotest / "default_params", autotest / "models"]
    files = (folder / f"{kind}.parm" for folder in folders)
    return next((one for one in files if one.is_file()), None)


class ArduPilot(Firmware):
    """An ArduPilot plane, copter or rover."""

    earth = 6378100.0
    system = 1

    def __init__(self, flight: Flight, rc_port: int) -> None:
        self._flight = flight
        self._kind = flight.what.kind
        self._rc_port = rc_port
        self._throttle = 0.0 if flight.from_ground else 0.5
        """Throttle stick of the operator, 0 to 1."""
        self.guided = GUIDED[self._kind]
        self.holding = HOLDING[self._kind]
        self._starts_without_gps = flight.vehicle in WITHOUT_GPS
        if self._starts_without_gps:
            self.holding = ALT_HOLD
        self.steered = frozenset(
            {self.guided} | ({GUIDED_NOGPS} if self._kind == "copter" else set())
        )
        self.shared = bound()
        self.own = bound()

    def start(self, folder: Path) -> subprocess.Popen[bytes]:
        """Start in a separate folder, where ArduPilot keeps its parameters and logs."""
        binary = Path(os.environ["CIRCNAV_ARDUPILOT"]).resolve() / f"ardu{self._kind}"
        self._hovers = self._flight.vehicle == "quadplane"
        models = {"plane": "plane", "copter": "+", "rover": "rover"}
        model = "quadplane" if self._hovers else models[self._kind]
        shared, own = (one.getsockname()[1] for one in (self.shared, self.own))
        options = (
            f"--model {model} --speedup 1 --home {HOME} -I0"
            f" --sim-address {LOOPBACK} --rc-in-port {self._rc_port}"
            f" --serial0 udpclient:{LOOPBACK}:{shared} --serial1 udpclient:{LOOPBACK}:{own}"
            " --serial2 none: --serial5 none: --serial6 none: --serial7 none: --serial8 none:"
        )
        stock = _parameters("quadplane" if self._hovers else self._kind)
        command = [binary, "--defaults", str(stock), *options.split()]
        log = (folder / "firmware.log").open("wb")
        scratch = folder / "firmware"
        scratch.mkdir()
        return subprocess.Popen(
            command, cwd=scratch, stdout=log, stderr=subprocess.STDOUT, start_new_session=True
        )

    def truth(self, bench: Bench, message: Any) -> Truth | None:
        """Return the truth from SIM_STATE."""
        if message.get_type() != "SIM_STATE":
            return None
        north, east = self.metres(message.lat_int, message.lon_int)
        velocity = (message.vn, message.ve, message.vd)
        air = bench.airspeed
        return Truth(bench.now, north, east, message.alt, *velocity, message.roll, message.yaw, air)

    def bring_up(self, bench: Bench) -> None:
        """Take off and hold."""
        flight = self._flight
        bench.until(lambda: bench.received, 60, "no heartbeat")
        self._streams(bench)
        for one in self._chosen():
            name, value = one.split("=")
            bench.set_parameter(name, float(value))
        bench.until(lambda: self._positioned(bench), 90, "the EKF has no position")
        self._streams(bench)
        if self._kind == "plane":
            bench.set_parameter("TKOFF_ALT", flight.altitude)
        if flight.from_ground:
            self._stand(bench)
            return
        bench.set_mode(TAKEOFF if self._kind == "plane" else self.guided)
        self._arm(bench)
        if self._kind == "copter":
            bench.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, flight.altitude)
            bench.until(
                lambda: self._height(bench) > flight.altitude - 0.5, 60, "it did not take off"
            )
        elif self._kind == "plane":
            bench.until(
                lambda: self._height(bench) > flight.altitude - 5, 90, "it did not take off"
            )
            bench.set_mode(self.holding)
        if flight.home_away:
            self._move_home(bench)
        self.weather(bench)
        bench.rest(15 if self._kind == "plane" else 5)
        bench.set_mode(self.holding)
        if self._starts_without_gps:
            self.without_gps(bench)
            bench.until(
                lambda: any("EKF variance" in text for _, text in bench.texts),
                20,
                "the GPS is not lost",
            )

    def _stand(self, bench: Bench) -> None:
        """Prepare a vehicle that stands on the ground for its take-off."""
        if self._starts_without_gps:
            self.without_gps(bench)
            bench.rest(20)
        elif self._kind == "copter":
            self.holding = LOITER
        mode = TAKEOFF if self._kind == "plane" else self.holding
        bench.set_mode(self.guided if self._hovers else mode)
        self.weather(bench)

    def take_off(self, bench: Bench) -> Iterator[tuple[float, Callable[[], None]]]:
        """Arm, and raise the stick of a copter until it has climbed. A plane takes off by its mode,
        and is then put into LOITER."""
        yield 5.0, lambda: bench.request(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        if self._hovers:
            height = self._flight.altitude
            command = mavlink.MAV_CMD_NAV_TAKEOFF
            yield 8.0, lambda: bench.request(command, 0, 0, 0, 0, 0, 0, height)
            return
        if self._kind == "plane":
            yield 60.0, lambda: self.ask_mode(bench, self.holding)
            return
        yield 8.0, lambda: self._move_throttle(0.9)
        yield 8.0 + self._flight.altitude / 1.8, lambda: self._move_throttle(0.5)

    def climb(
        self, bench: Bench, at: float, meters: float
    ) -> Iterator[tuple[float, Callable[[], None]]]:
        """Take the copter, raise the stick until it has climbed, and return to the guided mode."""
        yield at, lambda: self.ask_mode(bench, self.holding)
        yield at + 1.0, lambda: self._move_throttle(0.9)
        yield at + 1.0 + meters / 1.8, lambda: self._move_throttle(0.5)
        guided = GUIDED_NOGPS if self._starts_without_gps else self.guided
        yield at + 4.0 + meters / 1.8, lambda: self.ask_mode(bench, guided)

    def _move_throttle(self, stick: float) -> None:
        self._throttle = stick

    def _move_home(self, bench: Bench) -> None:
        x, y = self.degrees_e7(self._flight.home_away, 0.0)
        where = (x, y, bench.track[0].altitude)
        command = mavlink.MAV_CMD_DO_SET_HOME
        if bench.command_at(command, mavlink.MAV_FRAME_GLOBAL, (0.0,) * 4, *where) != ACCEPTED:
            raise NoFlightError("home was not moved")

    def _chosen(self) -> list[str]:
        flight = self._flight
        chosen = []
        if self._kind == "plane" and (flight.speed, flight.airspeed_off) != (STOCK_CRUISE, 1.0):
            chosen.append(f"AIRSPEED_CRUISE={flight.speed * flight.airspeed_off}")
        if flight.roll_limit is not None:
            chosen.append(f"ROLL_LIMIT_DEG={flight.roll_limit}")
        if self._kind != "plane":
            # The default reduces the wind below 60 m: to 58 % at 20 m.
            chosen.append("SIM_WIND_T=2")
        return [*chosen, *flight.param]

    def _arm(self, bench: Bench) -> None:
        began = bench.now
        while bench.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, tries=1) != ACCEPTED:
            bench.rest(1.0)
            if bench.now - began > 90:
                raise NoFlightError("arming was refused")

    def _positioned(self, bench: Bench) -> bool:
        report = bench.latest.get("EKF_STATUS_REPORT")
        return report is not None and report.flags & POSITION_KNOWN == POSITION_KNOWN

    def _height(self, bench: Bench) -> float:
        here = bench.latest.get("GLOBAL_POSITION_INT")
        return here.relative_alt / 1000 if here else -1e9

    def _streams(self, bench: Bench) -> None:
        """Request the truth at 50 Hz; for plane and rover at 25 Hz, because their main loop runs at
        50 Hz."""
        often = 50 if self._kind == "copter" else 25
        wanted = {mavlink.MAVLINK_MSG_ID_ATTITUDE: often, mavlink.MAVLINK_MSG_ID_SIM_STATE: often,
                  mavlink.MAVLINK_MSG_ID_VFR_HUD: 10, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5,
                  mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 2}  # fmt: skip
        bench.ask_streams(wanted, "SIM_STATE", 1.2 * often)

    def weather(self, bench: Bench) -> None:
        """Start wind and turbulence."""
        flight = self._flight
        if flight.wind or flight.turbulence:
            self.wind(bench, flight.wind, flight.wind_from)
            bench.send_parameter("SIM_WIND_TURB", flight.turbulence)

    def wind(self, bench: Bench, speed: float, from_: float) -> None:
        """Set the wind, m/s, from a direction in degrees."""
        bench.send_parameter("SIM_WIND_DIR", from_)
        bench.send_parameter("SIM_WIND_SPD", speed)

    def without_gps(self, bench: Bench) -> None:
        """Disable GPS reception."""
        bench.send_parameter("SIM_GPS_DISABLE", 1)
        if self._kind == "copter":  # BRAKE requires a position
            self.holding = ALT_HOLD

    def ask_mode(self, bench: Bench, mode: int) -> None:
        """Request a mode once, without waiting."""
        bench.request(mavlink.MAV_CMD_DO_SET_MODE, 1, mode)

    def circle(self, bench: Bench, north: float, east: float) -> tuple[float, float]:
        """Start ArduPilot's own GPS circle: a plane circles around a place, other vehicles at their
        present position. Return the center of the circle."""
        flight = self._flight
        sign = 1 if self._flight.clockwise else -1
        if self._kind == "plane":
            x, y = self.degrees_e7(north, east)
            bench.set_parameter("WP_LOITER_RAD", sign * flight.radius)
            values = (-1.0, 1.0, flight.radius, 0.0 if flight.clockwise else 1.0)
            frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
            result = bench.command_at(
                mavlink.MAV_CMD_DO_REPOSITION, frame, values, x, y, flight.altitude
            )
            note(f"  DO_REPOSITION: result {result}")
            return north, east
        parameters = {
            "CIRCLE_RADIUS": flight.radius * 100,
            "CIRCLE_RATE": circle_rate(flight),
            "CIRCLE_OPTIONS": 6,
        }
        if self._kind == "rover":
            parameters = {
                "CIRC_RADIUS": flight.radius,
                "CIRC_SPEED": flight.speed,
                "CIRC_DIR": 0 if flight.clockwise else 1,
            }
        for name, value in parameters.items():
            bench.set_parameter(name, value)
        bench.set_mode(self.guided)
        bench.set_mode(CIRCLE[self._kind])
        return bench.truth.north, bench.truth.east

    def beat(self, bench: Bench) -> None:
        """Send the sticks, centered in the air, because ALT_HOLD descends with a low throttle
        stick."""
        heartbeat = bench.latest.get("HEARTBEAT")
        armed = heartbeat is not None and heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        # with the throttle up, arming is refused
        if armed and (self._starts_without_gps or self._flight.from_ground):
            self._send_sticks(bench, self._throttle)

    def circling(self, bench: Bench) -> None:
        """Send a centered throttle stick, which a copter reads in CIRCLE."""
        if self._kind == "copter":
            self._send_sticks(bench, 0.5)

    def _send_sticks(self, bench: Bench, throttle: float) -> None:
        """Send centered sticks and the throttle stick, 0 to 1."""
        stick = round(1000 + 1000 * throttle)
        bench.send(
            mavlink.MAVLink_rc_channels_override_message(
                1, 1, 1500, 1500, stick, 1500, *[65535] * 4
            )
        )
