"""One flight as data: which vehicle, which weather, which radio; and its options on the command line."""

import argparse
import sys
from dataclasses import dataclass, fields
from math import degrees, pi
from pathlib import Path

ROOT = Path(__file__).parents[2]
BEHIND_ARDUPILOT, BEHIND_PX4 = "ardupilot", "px4"


@dataclass(frozen=True)
class Vehicle:
    """What is flown, and how unless the options say otherwise. SI; altitude above home, duration from engaging."""

    firmware: str
    kind: str
    mission: str
    radius: float
    speed: float
    altitude: float
    duration: float


VEHICLES = {
    "plane": Vehicle(BEHIND_ARDUPILOT, "plane", "arduplane", 150.0, 22.0, 80.0, 240.0),
    "copter": Vehicle(BEHIND_ARDUPILOT, "copter", "arducopter", 30.0, 5.0, 20.0, 200.0),
    "rover": Vehicle(BEHIND_ARDUPILOT, "rover", "ardurover", 20.0, 3.0, 0.0, 200.0),
    "px4_copter": Vehicle(BEHIND_PX4, "copter", "px4_copter", 50.0, 5.0, 20.0, 300.0),
    "px4_plane": Vehicle(BEHIND_PX4, "plane", "px4_plane", 60.0, 10.0, 40.0, 240.0),
    "px4_plane_attitude": Vehicle(BEHIND_PX4, "plane", "px4_plane_attitude", 60.0, 10.0, 40.0, 240.0),
}
PRESETS = {
    "uwb": {"noise": 0.02, "drift": 0.15, "drift_s": 3.0, "rate": 20.0},
    "lora": {"noise": 1.0, "drift": 2.0, "drift_s": 5.0, "rate": 10.0, "loss": 0.1},
}


@dataclass(frozen=True)
class Flight:
    """Metres, seconds, m/s; angles in degrees as the operator gives them."""

    vehicle: str
    radius: float
    speed: float
    altitude: float
    duration: float
    direction: str = "clockwise"
    seed: int = 1
    baseline: bool = False
    keep_position: bool = False
    handback: bool = False
    home_s: float = 0.0
    home_away: float = 0.0
    # weather and what goes wrong
    wind: float = 0.0
    wind_from: float = 270.0
    turbulence: float = 0.0
    wind_change: tuple[float, float, float] | None = None
    gps_off: float | None = None
    airspeed_off: float = 1.0
    roll_limit: float | None = None
    takeover: float | None = None
    # the target
    start_range: float | None = None
    start_bearing: float = 70.0
    target_speed: float = 0.0
    target_course: float = 0.0
    target_height: float = 0.0
    # the radio
    rate: float = 10.0
    noise: float = 0.5
    drift: float = 0.0
    drift_s: float = 3.0
    outliers: float = 0.0
    outlier_size: float = 30.0
    loss: float = 0.0
    delay: float = 0.0
    # how it is run
    speedup: float = 1.0
    param: tuple[str, ...] = ()
    set: tuple[str, ...] = ()
    circnav: str = str(Path(sys.executable).with_name("circnav"))
    config: str = str(ROOT / "config")

    @property
    def what(self) -> Vehicle:
        return VEHICLES[self.vehicle]

    @property
    def clockwise(self) -> bool:
        return self.direction == "clockwise"

    @property
    def window(self) -> float:
        """Time that is scored, s: the last two laps."""
        return 2 * 2 * pi * self.radius / self.speed

    @property
    def title(self) -> str:
        """The vehicle and whatever is not as usual."""
        usual = {f.name: f.default for f in fields(self)}
        usual |= {name: getattr(self.what, name) for name in ("radius", "speed", "altitude", "duration")}
        hidden = {"vehicle", "circnav", "config"}
        unusual = [(name, getattr(self, name)) for name, usually in usual.items() if name not in hidden
                   and getattr(self, name) != usually]  # fmt: skip
        return " ".join([self.vehicle, *(_told(name.replace("_", "-"), value) for name, value in unusual)])


def _told(name: str, value: object) -> str:
    if value is True:
        return name
    values = value if isinstance(value, tuple | list) else (value,)
    return " ".join([name, *(one if isinstance(one, str) else f"{one:g}" for one in values)])


def add_options(parser: argparse.ArgumentParser) -> None:
    """What a flight can be told."""
    add = parser.add_argument
    add("vehicle", choices=VEHICLES)
    add("--baseline", action="store_true", help="the autopilot's own GPS circle round the same, known, centre")
    add("--wind", type=float, default=0.0, help="m/s")
    add("--wind-from", type=float, default=270.0, help="degrees")
    add("--turbulence", type=float, default=0.0, help="m/s, standard deviation (ArduPilot)")
    add("--wind-change", type=float, nargs=3, metavar=("T", "SPEED", "FROM"), help="another wind from then on")
    add("--target-speed", type=float, default=0.0, help="m/s")
    add("--target-course", type=float, default=0.0, help="degrees")
    add("--target-height", type=float, default=0.0, help="m above home")
    add("--gps-off", type=float, metavar="T", help="s after the start of circnav")
    add("--outliers", type=float, default=0.0, help="share of ranges that are off")
    add("--outlier-size", type=float, default=30.0, help="by up to, m")
    add("--loss", type=float, default=0.0, help="share of ranges that are lost")
    add("--delay", type=float, default=0.0, help="s from measuring to sending; the stamp is that of sending")
    add("--noise", type=float, default=0.5, help="of the ranges, white, m")
    add("--drift", type=float, default=0.0, help="and slowly wandering, m")
    add("--drift-s", type=float, default=3.0, help="time constant of that")
    add("--rate", type=float, default=10.0, help="Hz")
    add("--preset", choices=PRESETS, help="a radio: noise, drift, rate, loss")
    add("--airspeed-off", type=float, default=1.0, help="airspeed flown over the mission's")
    add("--roll-limit", type=float, help="of the autopilot, degrees; the mission keeps its own")
    add("--radius", type=float, help="m")
    add("--speed", type=float, help="m/s")
    add("--altitude", type=float, help="m above home")
    add("--direction", choices=("clockwise", "counterclockwise"), default="clockwise")
    add("--start-range", type=float, help="of the target, m [2.5 radii]")
    add("--start-bearing", type=float, default=70.0, help="degrees right of the nose")
    add("--seed", type=int, default=1)
    add("--duration", type=float, help="s after engaging")
    add("--takeover", type=float, metavar="T", help="the operator takes the vehicle T s after the start of circnav")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="of the mission")
    add("--param", action="append", default=[], metavar="NAME=VALUE", help="of the autopilot, before take-off")
    add("--keep-position", action="store_true", help="do not hide the autopilot's positions from circnav")
    add("--handback", action="store_true", help="handback.enabled, and positions shown: with --gps-off")
    add("--home-s", type=float, default=0.0, metavar="T", help="exit action rtl, and T s more on the way home")
    add("--home-away", type=float, default=0.0, metavar="M", help="home is so far north of the take-off (ArduPilot)")
    add("--speedup", type=float, default=1.0, help="simulated over real time; only 1 gives figures that count")
    add("--circnav", default=Flight.circnav, help="the installed command [beside this Python]")
    add("--config", default=Flight.config, help="folder of its mission files [config]")


def flight(options: argparse.Namespace) -> Flight:
    """The flight that the options name; a preset overrules single options of the radio."""
    given = {f.name: getattr(options, f.name) for f in fields(Flight)}
    vehicle = VEHICLES[given["vehicle"]]
    for name in ("radius", "speed", "altitude", "duration"):
        given[name] = getattr(vehicle, name) if given[name] is None else given[name]
    given["param"], given["set"] = tuple(given["param"]), tuple(given["set"])
    return Flight(**given | PRESETS.get(options.preset, {}))


def circle_rate(flight: Flight) -> float:
    """Of the nose on the circle, deg/s, clockwise positive."""
    return degrees(flight.speed / flight.radius) * (1 if flight.clockwise else -1)
