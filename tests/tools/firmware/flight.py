"""Data of one flight (vehicle, weather, radio), and its options on the command line."""

import argparse
import sys
from dataclasses import MISSING, dataclass, field, fields
from math import degrees, pi
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[3]
BEHIND_ARDUPILOT = "ardupilot"
BEHIND_PX4 = "px4"


@dataclass(frozen=True)
class Vehicle:
    """Default conditions of a vehicle, in SI units. altitude: above home. duration: from the
    engagement."""

    firmware: str
    kind: str
    mission: str
    radius: float
    speed: float
    altitude: float
    duration: float


VEHICLES = {
    "plane": Vehicle(BEHIND_ARDUPILOT, "plane", "arduplane", 150.0, 22.0, 80.0, 240.0),
    "quadplane": Vehicle(BEHIND_ARDUPILOT, "plane", "arduplane", 150.0, 22.0, 60.0, 120.0),
    "home": Vehicle(BEHIND_ARDUPILOT, "plane", "home", 100.0, 15.0, 80.0, 400.0),
    "copter": Vehicle(BEHIND_ARDUPILOT, "copter", "arducopter", 30.0, 5.0, 20.0, 200.0),
    "copter_nogps": Vehicle(BEHIND_ARDUPILOT, "copter", "arducopter_nogps", 30.0, 5.0, 20.0, 200.0),
    "home_copter": Vehicle(BEHIND_ARDUPILOT, "copter", "home_copter", 60.0, 7.0, 30.0, 400.0),
    "rover": Vehicle(BEHIND_ARDUPILOT, "rover", "ardurover", 20.0, 3.0, 0.0, 200.0),
    "px4_copter": Vehicle(BEHIND_PX4, "copter", "px4_copter", 50.0, 5.0, 20.0, 300.0),
    "px4_copter_nogps": Vehicle(BEHIND_PX4, "copter", "px4_copter_nogps", 50.0, 5.0, 20.0, 300.0),
    "px4_plane": Vehicle(BEHIND_PX4, "plane", "px4_plane", 60.0, 10.0, 40.0, 240.0),
}
PRESETS = {
    "uwb": {"noise": 0.02, "drift": 0.15, "drift_s": 3.0, "rate": 20.0},
    "lora": {"noise": 1.0, "drift": 2.0, "drift_s": 5.0, "rate": 10.0, "loss": 0.1},
    "sx1280": {
        "noise": 1.0,
        "drift": 2.0,
        "drift_s": 5.0,
        "rate": 2.0,
        "loss": 0.1,
        "sx1280": True,
    },
}


def _option(default: object, text: str = "", **how: object) -> Any:
    """Return a field with its default and its help text on the command line."""
    return field(default=default, metadata={"help": text, **how})


@dataclass(frozen=True)
class Flight:
    """Conditions of one flight, each an option on the command line. Units: m, s, m/s, degrees."""

    vehicle: str
    radius: float
    speed: float
    altitude: float
    duration: float
    direction: str = _option("clockwise", choices=("clockwise", "counterclockwise"))
    seed: int = _option(1, "seed of all random numbers")
    baseline: bool = _option(
        False, "fly the autopilot's own circle by GPS around the known target instead"
    )
    gps_shown: bool = _option(False, "do not hide GPS_RAW_INT, whose fix type shows a loss of GPS")
    external_position: bool = _option(
        False, "set external_position.enabled and do not hide positions; use with --gps-off"
    )
    home_s: float = _option(0.0, "exit action rtl, and record T s of the way home", metavar="T")
    home_away: float = _option(
        0.0, "distance of home north of the take-off, m (ArduPilot)", metavar="M"
    )
    from_ground: bool = _option(
        False, "the vehicle stands on the ground when circnav starts, and takes off then"
    )
    # weather and faults
    wind: float = _option(0.0, "wind speed, m/s")
    wind_from: float = _option(270.0, "direction from which the wind blows, degrees")
    turbulence: float = _option(0.0, "standard deviation of the turbulence, m/s (ArduPilot)")
    wind_change: tuple[float, float, float] | None = _option(
        None,
        "wind speed and direction from T s after the start of circnav on",
        nargs=3,
        metavar=("T", "SPEED", "FROM"),
    )
    gps_off: float | None = _option(None, "GPS fails T s after the start of circnav", metavar="T")
    param_at: tuple[str, str] | None = _option(
        None, "autopilot parameter to set T s after the start of circnav", nargs=2, type=str,
        metavar=("T", "NAME=VALUE"),
    )  # fmt: skip
    mode_at: tuple[str, ...] = _option(
        (), "the operator commands a custom_mode T s after the start of circnav", metavar="T=MODE"
    )
    mode_below: str | None = _option(
        None, "the operator commands a custom_mode below a height, m, after the last --mode-at",
        type=str, metavar="M=MODE",
    )  # fmt: skip
    home_here: float | None = _option(
        None, "home is set to the vehicle's place T s after the start of circnav", metavar="T"
    )
    radio_at: float = _option(0.0, "the radio is silent until T s after the start of circnav")
    airspeed_off: float = _option(1.0, "flown airspeed divided by the airspeed of the mission")
    roll_limit: float | None = _option(
        None, "roll limit of the autopilot, degrees; the limit of the mission is kept"
    )
    takeover: float | None = _option(
        None, "the operator takes the vehicle T s after the start of circnav", metavar="T"
    )
    climb: tuple[float, float] | None = _option(
        None,
        "the operator takes the copter T s after the start of circnav, climbs by M meters, and"
        " returns to the guided mode (ArduCopter)",
        nargs=2,
        metavar=("T", "M"),
    )
    # the target
    start_range: float | None = _option(None, "first range to the target, m [2.5 radii]")
    start_bearing: float = _option(70.0, "first bearing of the target, degrees right of the nose")
    target_at: tuple[float, float] | None = _option(
        None, "position of the target, m north and east of the vehicle's first position", nargs=2,
        metavar=("NORTH", "EAST"),
    )  # fmt: skip
    target_speed: float = _option(0.0, "speed of the target, which moves north, m/s")
    target_height: float = _option(0.0, "height of the target above home, m")
    # the radio
    rate: float = _option(10.0, "ranges per second, Hz")
    noise: float = _option(0.5, "standard deviation of the white range noise, m")
    drift: float = _option(0.0, "standard deviation of the slowly varying range error, m")
    drift_s: float = _option(3.0, "time constant of the slowly varying range error, s")
    outliers: float = _option(0.0, "share of ranges with a large error")
    outlier_size: float = _option(30.0, "largest error of such a range, m")
    loss: float = _option(0.0, "share of lost ranges")
    sx1280: bool = _option(
        False,
        "ranges with the error of an SX1280, sent as NAMED_VALUE_FLOAT, which has no maximum range",
    )
    delay: float = _option(
        0.0, "time from measurement to transmission, s; the stamp is the time of transmission"
    )
    # conditions of the run
    param: tuple[str, ...] = _option(
        (), "autopilot parameter to set before take-off", metavar="NAME=VALUE"
    )
    set: tuple[str, ...] = _option((), "mission key to set", metavar="KEY=VALUE")
    circnav: str = _option(
        str(Path(sys.executable).with_name("circnav")),
        "path of the circnav command [beside this Python]",
    )

    @property
    def what(self) -> Vehicle:
        return VEHICLES[self.vehicle]

    @property
    def clockwise(self) -> bool:
        return self.direction == "clockwise"

    @property
    def window(self) -> float:
        """Evaluated time, s: the last two laps."""
        return 2 * 2 * pi * self.radius / self.speed

    @property
    def title(self) -> str:
        """Title of the flight: the vehicle and all options that differ from the defaults."""
        usual = {f.name: f.default for f in fields(self)}
        usual |= {name: getattr(self.what, name) for name in OF_THE_VEHICLE}
        hidden = {"vehicle", "circnav"}
        unusual = [
            (name, getattr(self, name))
            for name, usually in usual.items()
            if name not in hidden and getattr(self, name) != usually
        ]
        return " ".join(
            [self.vehicle, *(_as_option(name.replace("_", "-"), value) for name, value in unusual)]
        )


def _as_option(name: str, value: object) -> str:
    if value is True:
        return name
    values = value if isinstance(value, tuple | list) else (value,)
    return " ".join([name, *(one if isinstance(one, str) else f"{one:g}" for one in values)])


OF_THE_VEHICLE = {
    "radius": "radius of the circle, m",
    "speed": "speed of the vehicle, m/s",
    "altitude": "altitude of the vehicle above home, m",
    "duration": "duration of the flight after engaging, s",
}
"""Fields with a default that depends on the vehicle."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a flight."""
    parser.add_argument("vehicle", choices=VEHICLES)
    for name, text in OF_THE_VEHICLE.items():
        parser.add_argument(f"--{name}", type=float, help=text)
    for one in fields(Flight):
        if one.default is MISSING:
            continue
        how: dict[str, Any] = {
            "default": one.default,
            "type": float if one.default is None else type(one.default),
        }
        if one.default is False:
            how = {"action": "store_true"}
        elif one.default == ():
            how = {"action": "append", "default": []}
        parser.add_argument(f"--{one.name.replace('_', '-')}", **(how | one.metadata))
    parser.add_argument(
        "--preset",
        choices=PRESETS,
        help="radio with its noise, slowly varying error, rate and losses",
    )


def flight(options: argparse.Namespace) -> Flight:
    """Return the flight with these options. A preset of the radio overrides its single options."""
    given = {f.name: getattr(options, f.name) for f in fields(Flight)}
    for name in OF_THE_VEHICLE:
        given[name] = (
            getattr(VEHICLES[options.vehicle], name) if given[name] is None else given[name]
        )
    for name in ("param", "set", "mode_at"):
        given[name] = tuple(given[name])
    return Flight(**given | PRESETS.get(options.preset, {}))


def circle_rate(flight: Flight) -> float:
    """Return the turn rate of the nose on the circle, deg/s, positive clockwise."""
    return degrees(flight.speed / flight.radius) * (1 if flight.clockwise else -1)
