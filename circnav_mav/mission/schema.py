"""Tables and keys of a mission file, with units in their names, and the bounds of their values.

The bounds reject implausible values (a tick of 1 kHz, a bank of 80 deg). `checks` reports whether a
mission can be flown.
"""

from ipaddress import ip_network
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError

from circnav_mav.guidance.copter_air import DRAG_BOUNDS
from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.own_code import NameTable
from circnav_mav.mav.autopilots.table import (
    MISSION_AUTOPILOTS,
    MISSION_EXITS,
    MISSION_KINDS,
    MISSION_METHODS,
)
from circnav_mav.mav.identity import OUR_COMPONENTS
from circnav_mav.mav.ranging.calibration import Calibration, rising
from circnav_mav.mav.ranging.table import RANGING_MESSAGES

FAR = 1e9
"""Largest value of a number. A product of a few larger numbers may overflow."""
MOST_PORT = 65535
"""Largest port (16 bits)."""
MOST_STALE = 5.0
"""Largest value of `limits.stale_s`, s."""
MAX_PATIENCE = 3600.0
"""Largest value of `limits.coast_s` and `limits.not_following_s`, s. A larger value was probably
meant in ms, and would disable the exit action."""
MAX_NAME = 100
"""Largest number of characters in a mission's name. The name of the run folder consists of a time
and this name."""
Positive = Annotated[float, Field(gt=0, le=FAR)]
NotNegative = Annotated[float, Field(ge=0, le=FAR)]
Patience = Annotated[float, Field(ge=0, le=MAX_PATIENCE)]
Height = Annotated[float, Field(ge=-FAR, le=FAR)]
Drag = Annotated[float, Field(ge=DRAG_BOUNDS[0], le=DRAG_BOUNDS[1])]
SystemId = Annotated[int, Field(ge=1, le=255)]
ComponentId = Annotated[int, Field(ge=0, le=255)]
Name = Annotated[str, Field(min_length=1)]


def _addresses(given: Any) -> list[str]:
    """Validate an address or network, or a list of them."""
    names = given if isinstance(given, list) else [given]
    try:
        for name in names:
            ip_network(str(name) if isinstance(name, str) else "", strict=False)
    except ValueError:
        advice = (
            'must be an address or network, such as "10.0.0.5" or "10.0.0.0/24", or a list of them'
        )
        raise PydanticCustomError("address", advice) from None
    return names


Addresses = Annotated[list[str], BeforeValidator(_addresses)]
Length = Annotated[float, Field(ge=0, le=1e6)]
Point = Annotated[list[Length], Field(min_length=2, max_length=2)]


def _rising(points: list[list[float]]) -> list[list[float]]:
    """Validate points of a calibration, each [true, reported], m."""
    if not rising(points):
        advice = (
            "must be two points or more, [true, reported], both rising, such as [[0, 4.4], [50,"
            " 57.6]]"
        )
        raise PydanticCustomError("points", advice)
    return points


class Table(BaseModel):
    """A table that rejects unknown keys, silent conversions, NaN and infinity. TOML allows NaN and
    infinity, but a bound with such a value would be violated never, or always."""

    # defer_build: build each validator once, at its first use, not again for each table around it
    model_config = ConfigDict(
        defer_build=True, extra="forbid", strict=True, frozen=True, allow_inf_nan=False
    )


class VehicleTable(Table):
    """[vehicle]: autopilot, speed, limits of bank and turn rate, and response of the vehicle."""

    autopilot: Literal[MISSION_AUTOPILOTS]  # type: ignore[valid-type]
    kind: Literal[MISSION_KINDS]  # type: ignore[valid-type]
    method: Literal[MISSION_METHODS] | None = None  # type: ignore[valid-type]
    speed_mps: Positive
    max_turn_rate_deg_s: Positive | None = None
    # 75: at this bank a level turn has a load of 3.9 g.
    max_bank_deg: Annotated[float, Field(gt=0, le=75)] | None = None
    # 10.0: longest delay from a command to its turn, s. A larger value was probably meant in ms.
    turn_lag_s: Annotated[float, Field(ge=0, le=10.0)] = 0.4
    drag_per_s: Drag = 0.35
    turn_gain: Literal["learn"] | Annotated[float, Field(ge=0.5, le=1.5)] = "learn"
    system_id: SystemId | None = None


class OrbitTable(Table):
    """[orbit]: radius and direction of the circle, and height above the target."""

    radius_m: Positive
    direction: Literal["clockwise", "counterclockwise"]
    height_above_target_m: NotNegative | None = None
    target_altitude_m: Height | None = None
    target_above_home_m: Height | None = None

    @property
    def needs_altitude(self) -> bool:
        """True if the height is unknown until the vehicle reports its altitude."""
        return self.target_altitude_m is not None or self.target_above_home_m is not None


def _named(table: NameTable[Any]) -> Any:
    """Return the type of the name of a built-in or user-defined law or estimator. Editors complete
    the built-in names."""

    def check(name: str) -> str:
        if not table.knows(name):
            raise PydanticCustomError(
                "literal_error",
                "unknown name",
                {"expected": f"{', '.join(map(repr, table.names()))}, or your own module:name"},
            )
        return name

    forms = [{"enum": list(table)}, {"type": "string"}]
    return Annotated[str, AfterValidator(check), WithJsonSchema({"anyOf": forms})]


class GuidanceTable(Table):
    """[guidance]: guidance law and estimator."""

    law: _named(LAWS) = "auto"  # type: ignore[valid-type]
    gain: Positive | None = None
    estimator: _named(ESTIMATORS) | None = None  # type: ignore[valid-type]
    own_code_on_vehicle: bool = False


class RangingTable(Table):
    """[ranging]: ranging message, its rate, noise, source and calibration."""

    message: Literal[tuple(RANGING_MESSAGES)]  # type: ignore[valid-type]
    # 1000: the fastest radios measure 100 Hz
    rate_hz: Annotated[float, Field(gt=0, le=1000)]
    sigma_m: Positive
    endpoint: Name | None = None
    beacon_id: Annotated[int, Field(ge=0, le=65535)] | None = None
    sensor_id: Annotated[int, Field(ge=0, le=255)] | None = None
    orientation: Annotated[int, Field(ge=0, le=100)] | None = None
    # 10: largest number of characters in the name of a NAMED_VALUE_FLOAT.
    name: Annotated[str, Field(min_length=1, max_length=10)] = "RANGE"
    rate_name: Annotated[str, Field(min_length=1, max_length=10)] | None = None
    rate_sign: Literal["opening", "closing"] = "opening"
    system_id: SystemId | None = None
    component_id: ComponentId | None = None
    stamp: Literal["sensor", "arrival"] = "sensor"
    scale: Annotated[float, Field(ge=0.5, le=2.0)] = 1.0
    bias_m: Annotated[float, Field(ge=-1000, le=1000)] = 0.0
    delay_s: Annotated[float, Field(ge=0, le=1)] = 0.0
    points_m: Annotated[list[Point], AfterValidator(_rising)] | None = None

    @model_validator(mode="after")
    def _one_calibration(self) -> Self:
        if self.points_m is not None and (self.scale, self.bias_m) != (1.0, 0.0):
            raise PydanticCustomError(
                "calibration",
                "points_m replaces scale and bias_m: give either points_m, or scale and bias_m",
            )
        return self

    @property
    def calibration(self) -> Calibration:
        """Calibration of the radio in the mission."""
        points = tuple((true, reported) for true, reported in self.points_m or ())
        return Calibration(self.scale, self.bias_m, self.delay_s, points)


class LinkTable(Table):
    """[link]: connection to the autopilot."""

    endpoint: Name
    peer: Addresses | None = None
    component_id: Annotated[int, Field(ge=OUR_COMPONENTS[0], le=OUR_COMPONENTS[-1])] = (
        OUR_COMPONENTS[0]
    )
    wait_s: Positive = 30.0
    unsigned_parameters: bool = False
    clock: Literal["local", "autopilot"] = "local"


class SigningTable(Table):
    """[signing]: MAVLink 2 message signing. key_file: path of the key, relative to the folder of
    the mission file."""

    key_file: Name
    accept_unsigned: Literal[False, True, "ranging"] = False


class EngageTable(Table):
    """[engage]: start of the steering, and reactions to a takeover and to a loss of GPS."""

    request_mode: bool = False
    min_height_m: NotNegative | None = None
    on_takeover: Literal["end", "wait"] = "end"
    on_gps_loss: Literal["exit", "attitude"] = "exit"


class LimitsTable(Table):
    """[limits]: time limits of the flight, and rate of the setpoints."""

    duration_s: Positive
    stale_s: Annotated[float, Field(gt=0, le=MOST_STALE)] | None = None
    coast_s: Patience = 10.0
    not_following_s: Patience = 10.0
    tick_hz: Annotated[float, Field(ge=5, le=100)] = 20.0  # PX4 leaves OFFBOARD below 2 Hz

    @property
    def tick(self) -> float:
        """Period of the steps without fresh ranges, s."""
        return 1 / self.tick_hz

    @property
    def outage(self) -> float:
        """Longest time from the loss of the link until the vehicle is steered again, s."""
        return max(60.0, self.coast_s)


class ExitTable(Table):
    """[exit]: mode that is commanded at the end of the flight."""

    action: Literal[MISSION_EXITS] | None = None  # type: ignore[valid-type]


class BoundsTable(Table):
    """[bounds]: bounds of range, altitude and battery charge at which the flight ends."""

    min_range_m: Positive | None = None
    max_range_m: Positive | None = None
    min_altitude_m: Height | None = None
    max_altitude_m: Height | None = None
    # A value below 1 was probably meant as a fraction.
    min_battery_percent: Annotated[float, Field(ge=1, le=100)] | None = None


class MissionFile(Table):
    """A mission file without the tables of extras. The table `sim` is validated by the bundled
    vehicle."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]+$", max_length=MAX_NAME)]
    vehicle: VehicleTable
    orbit: OrbitTable
    guidance: GuidanceTable
    ranging: RangingTable
    link: LinkTable
    engage: EngageTable = EngageTable()
    exit: ExitTable = ExitTable()
    bounds: BoundsTable = BoundsTable()
    limits: LimitsTable
    signing: SigningTable | None = None
    sim: dict[str, Any] | None = None
