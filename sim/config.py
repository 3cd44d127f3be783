"""The vehicle file: autopilot, start, target, wind, radio and sensors. Units are in the names."""

import math
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from .autopilots.modes import MODES, PROFILES
from .schema import ConfigError, Interval, Name, Table, nearest, place, read_table
from .signing import read_key

__all__ = ["ConfigError", "VehicleConfig", "load_vehicle", "parse_vehicle"]

IMU_STATES = ("good", "frozen", "clipped", "rotated", "first_frozen", "first_zero")
STEERING_STATES = ("good", "straight", "frozen", "turning", "hovering", "reversed", "weak")
ATTITUDE_ERROR_DEG = {"px4_copter": 1.0, "px4_plane": 1.0, "arduplane": 0.15}
ACTIONS = (
    *("mode", "arm", "disarm", "throttle", "rc_failsafe", "gps_off", "gps_on", "battery"),
    *("wind", "wind_from"),
    *("accel_bias", "heading_drift", "airspeed_stuck", "airspeed_good"),
    *("ekf_zero", "lose_mode_ack", "lose_mode_request"),
    *(
        "mute_ranging",
        "unmute_ranging",
        "freeze_ranging",
        "unfreeze_ranging",
        "mute_autopilot",
        "unmute_autopilot",
    ),
    *("reboot", "set_home", "vtol", "waypoint"),
    *(f"imu_{state}" for state in IMU_STATES),
    *(f"steering_{state}" for state in STEERING_STATES),
)


class Airframe(Table):
    """[vehicle]: autopilot and dynamics. A default of None depends on the profile.

    dynamics: "unicycle" (default of arducopter) is ideal and holds its speed over the ground.
        "airborne" is ideal, holds its speed through the air, and drifts with the wind. "realistic"
        (default of the others) has the measured dynamics.
    boot_age_s: time since the autopilot's boot at time zero (its 32-bit milliseconds wrap at
        4294967.296 s).
    odometry: velocity without GPS (optical flow, wheel encoders), valid once an origin is set
        (message 48).
    drag_per_s: drag of copters; default: px4_copter 1.0, arducopter 0.24 (linear part).
    max_lean_deg: ANGLE_MAX (default 30) or MPC_TILTMAX_AIR (default 45).
    turn_frequency_rad_s, turn_damping: replace the measured turn or roll loop; a damping below 0.3
        oscillates.
    steering: "straight", "frozen" (repeats the last command), "turning" (12 deg/s) and "hovering"
        ignore turn commands. "reversed" and "weak" (a tenth) change turn commands.
    """

    profile: Literal[PROFILES] = "arducopter"  # type: ignore[valid-type]
    system_id: int = Field(default=1, ge=1, le=255)
    mavlink_version: int = Field(default=2, ge=1, le=2)
    dynamics: Literal["unicycle", "airborne", "realistic"] | None = None
    max_turn_rate_deg_s: float = Field(default=60.0, gt=0.0, le=720.0)
    turn_lag_s: float = Field(default=0.2, ge=0.0, le=10.0)
    speed_lag_s: float = Field(default=0.0, ge=0.0, le=30.0)
    max_bank_deg: float | None = Field(default=None, gt=0.0, le=80.0)
    cruise_speed_mps: float | None = Field(default=None, gt=0.0, le=100.0)
    turn_effectiveness: float | None = Field(default=None, ge=0.1, le=2.0)
    airspeed_scale: float | None = Field(default=None, ge=0.5, le=2.0)
    drag_per_s: float | None = Field(default=None, ge=0.0, le=10.0)
    max_lean_deg: float | None = Field(default=None, gt=0.0, le=80.0)
    turn_frequency_rad_s: float | None = Field(default=None, gt=0.0, le=20.0)
    turn_damping: float | None = Field(default=None, ge=0.02, le=2.0)
    steering: Literal[STEERING_STATES] = "good"  # type: ignore[valid-type]
    boot_age_s: float = Field(default=0.0, ge=0.0, le=1e8)
    setpoint_timeout_s: float | None = Field(default=None, ge=0.1, le=60.0)
    gps: bool = True
    odometry: bool = False
    airspeed_sensor: bool = False
    default_streams: bool = True


class RandomStart(Table):
    """[start.random]: bounds of random values, drawn with the seed. A key that is not given keeps
    its value of [start]."""

    north_m: Interval | None = None
    east_m: Interval | None = None
    heading_deg: Interval | None = None
    range_m: Interval | None = None
    bearing_deg: Interval | None = None


class Start(Table):
    """[start]: the vehicle at time zero: position north and east of home, height above home."""

    north_m: float = -200.0
    east_m: float = 0.0
    altitude_m: float | None = Field(default=None, ge=0.0)
    heading_deg: float = 0.0
    speed_mps: float | None = Field(default=None, ge=0.0, le=300.0)
    mode: str | None = None
    armed: bool = True
    random: RandomStart = RandomStart()


class Target(Table):
    """[target]: position (altitude above home) and motion. The acceleration is along the course."""

    north_m: float = 0.0
    east_m: float = 0.0
    altitude_m: float = 0.0
    velocity_north_mps: float = 0.0
    velocity_east_mps: float = 0.0
    acceleration_mps2: float = 0.0
    turn_rate_deg_s: float = Field(default=0.0, ge=-360.0, le=360.0)


class Wind(Table):
    """[wind]: speed, gusts, and the direction from which the wind blows, as in weather reports."""

    speed_mps: float = Field(default=0.0, ge=0.0, le=100.0)
    from_deg: float = 0.0
    gust_rms_mps: float = Field(default=0.0, ge=0.0, le=30.0)
    gust_time_s: float = Field(default=3.0, ge=0.1, le=600.0)


class Ranging(Table):
    """[ranging]: errors of the ranging radio, its message, and its route to the receiver.

    scale, bias_m: a range is reported as scale times its length plus bias_m.
    table_m: replaces scale and bias_m by straight lines through points, each [true, reported],
        rising.
    rate_name: also send the range rate, as a NAMED_VALUE_FLOAT of this name.
    rate_noise_mps: white noise of the range rate.
    rate_bias_mps: RMS of the range-rate bias from the carrier's frequency offset, which changes
        within a minute.
    """

    message: Literal["distance_sensor", "ranging_beacon", "named_value_float"] = "distance_sensor"
    via: Literal["forwarded", "direct", "autopilot"] = "forwarded"
    preset: Literal["gaussian", "uwb", "lora"] = "gaussian"
    rate_hz: float = Field(default=10.0, ge=0.0, le=1000.0)
    noise_m: float = Field(default=0.5, ge=0.0)
    bias_m: float = 0.0
    scale: float = Field(default=1.0, gt=0.0, le=10.0)
    table_m: list[list[float]] = Field(default_factory=list)
    outlier_fraction: float = Field(default=0.0, ge=0.0, le=1.0)
    outlier_m: float = Field(default=30.0, ge=0.0)
    dropout_fraction: float = Field(default=0.0, ge=0.0, le=1.0)
    latency_s: float = Field(default=0.0, ge=0.0, le=10.0)
    clock_offset_s: float = Field(default=0.0, ge=0.0)
    max_range_m: float = Field(default=1000.0, gt=0.0)
    system_id: int = Field(default=1, ge=1, le=255)
    component_id: int = Field(default=192, ge=1, le=255)
    beacon_id: int = Field(default=1, ge=0, le=65535)
    sensor_id: int = Field(default=0, ge=0, le=255)
    orientation: int = Field(default=24, ge=0, le=255)
    name: Name = "RANGE"
    report_accuracy: bool = False
    rate_name: Name | None = None
    rate_sign: Literal["opening", "closing"] = "opening"
    rate_noise_mps: float = Field(default=0.1, ge=0.0)
    rate_bias_mps: float = Field(default=0.05, ge=0.0)


class TruthStream(Table):
    """[truth]: rate of the messages with the true state, sent in addition to the autopilot's own
    messages; 0: not sent."""

    rate_hz: float = Field(default=10.0, ge=0.0, le=100.0)


class Sensors(Table):
    """[sensors]: errors of the reported values.

    compass: false sets COMPASS_USE and EK3_SRC1_YAW to 0.
    accel_noise_mps2, gyro_noise_deg_s: RMS noise; default: 0.2 and 0, for a realistic px4_* the
        noise of PX4's SIH.
    accel_bias_mps2: constant bias with random signs; default: drawn from 0.05 to 0.1.
    imu: "frozen" repeats its last reading, "clipped" saturates at 8 m/s^2, "rotated" is mounted 90
        deg to the right. "first_frozen", "first_zero": only the accelerometer of the first IMU
        (RAW_IMU), so that ArduPilot flies on the second one (SCALED_IMU2).
    attitude_error_deg: RMS error of the estimated roll, with the matching errors of velocity and
        heading (EstimateError); default: realistic px4_* 1.0, arduplane 0.15, else 0.
    gps_error_m: standard deviation of the reported position per axis, a first-order process with
        gps_error_time_s.
    dead_reckoning_mps: standard deviation of the position drift without GPS, per axis.
    """

    compass: bool = True
    heading_bias_deg: float = Field(default=0.0, ge=-180.0, le=180.0)
    heading_drift_deg_s: float = Field(default=0.0, ge=-10.0, le=10.0)
    gyro_scale: float = Field(default=1.0, ge=0.5, le=1.5)
    airspeed_noise_mps: float = Field(default=0.0, ge=0.0, le=10.0)
    accel_noise_mps2: float | None = Field(default=None, ge=0.0, le=50.0)
    gyro_noise_deg_s: float | None = Field(default=None, ge=0.0, le=50.0)
    accel_bias_mps2: float | None = Field(default=None, ge=0.0, le=10.0)
    accel_vibration_mps2: float = Field(default=0.0, ge=0.0, le=100.0)
    imu: Literal[IMU_STATES] = "good"  # type: ignore[valid-type]
    attitude_error_deg: float | None = Field(default=None, ge=0.0, le=20.0)
    gps_error_m: float = Field(default=0.0, ge=0.0, le=1000.0)
    gps_error_time_s: float = Field(default=60.0, ge=0.1, le=10_000.0)
    dead_reckoning_mps: float = Field(default=0.3, ge=0.0, le=20.0)


class Battery(Table):
    """[battery]: charge at the start and its rate of discharge."""

    percent: float = Field(default=100.0, ge=0.0, le=100.0)
    drain_percent_per_min: float = Field(default=0.0, ge=0.0)


class Signing(Table):
    """[signing]: signing of the vehicle and the radio.

    key_file: file of the key (64 hex digits or 32 bytes); None: no signing, and all senders are
        accepted.
    accept_unsigned: accept unsigned frames, as on ArduPilot's USB port.
    """

    key_file: str | None = None
    accept_unsigned: bool = False


class Event(Table):
    """[[events]]: one scripted event."""

    at_s: float = Field(default=0.0, ge=0.0)
    action: Literal[ACTIONS] = "mode"  # type: ignore[valid-type]
    mode: str | None = None
    value: float | None = None


class VehicleConfig(Table):
    """One vehicle file, validated."""

    seed: int = Field(default=0, ge=0)
    vehicle: Airframe = Airframe()
    start: Start = Start()
    target: Target = Target()
    wind: Wind = Wind()
    ranging: Ranging = Ranging()
    truth: TruthStream = TruthStream()
    sensors: Sensors = Sensors()
    battery: Battery = Battery()
    signing: Signing = Signing()
    events: tuple[Event, ...] = Field(default=(), strict=False)

    @property
    def sih(self) -> bool:
        """True if the vehicle imitates PX4's simulator SIH, which has noisy sensors."""
        return self.vehicle.profile.startswith("px4") and self.vehicle.dynamics != "unicycle"

    @property
    def unaided_tilts(self) -> bool:
        """True if the attitude estimate is wrong in turns without GPS: ArduPilot's realistic
        copters."""
        return (
            self.vehicle.profile.startswith("arducopter") and self.vehicle.dynamics == "realistic"
        )

    @property
    def attitude_error(self) -> float:
        """Rms error of the estimated roll, rad."""
        given = self.sensors.attitude_error_deg
        ideal = self.vehicle.dynamics == "unicycle"
        default = 0.0 if ideal else ATTITUDE_ERROR_DEG.get(self.vehicle.profile, 0.0)
        return math.radians(default if given is None else given)

    def rebooted(self) -> "VehicleConfig":
        """Return the configuration after a restart of the autopilot: disarmed, in its first
        mode."""
        first = next(iter(MODES[self.vehicle.profile]))
        return self.changed(start=self.start.changed(armed=False, mode=first, speed_mps=None))


def parse_vehicle(table: Mapping[str, Any], where: str) -> VehicleConfig:
    """Validate a TOML table. Raises ConfigError: one line with `where`, the key and the remedy."""
    return _checked(read_table(VehicleConfig, table, where), where)


def _checked(config: VehicleConfig, where: str) -> VehicleConfig:
    for key_name, complaint in _conflicts(config):
        raise ConfigError(f"{place(where, key_name)}: {complaint}")
    if config.signing.key_file is not None:
        read_key(config.signing.key_file, f"{place(where, 'signing')}.key_file")
    return config


def load_vehicle(path: str | Path) -> VehicleConfig:
    """Read a vehicle file or the [sim] table of a mission file. The path of a key file is relative
    to the folder of the file that names it."""
    try:
        table = tomllib.loads(Path(path).read_text("utf-8-sig"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise ConfigError(f"{path}: not a TOML file: {error}") from error
    if "orbit" in table and "sim" not in table:
        raise ConfigError(
            f"{path}: a mission without the table [sim]: add one, or name a mission that has it"
        )
    where = f"{path}: sim" if "sim" in table else str(path)
    config = read_table(VehicleConfig, _of_mission(table) if "sim" in table else table, where)
    if config.signing.key_file:
        key_file = str(Path(path).parent / Path(config.signing.key_file).expanduser())
        config = config.changed(signing=config.signing.changed(key_file=key_file))
    return _checked(config, where)


def _of_mission(mission: Mapping[str, Any]) -> Any:
    """Return the table [sim] of a mission. The mission's speed is the cruise speed of its plane,
    unless the table gives another one."""
    sim = mission["sim"]
    flown = mission.get("vehicle")
    if not isinstance(sim, dict) or not isinstance(flown, dict) or flown.get("kind") != "plane":
        return sim
    vehicle = sim.get("vehicle", {})
    if not isinstance(vehicle, dict) or "speed_mps" not in flown:
        return sim
    return {**sim, "vehicle": {"cruise_speed_mps": flown["speed_mps"], **vehicle}}


def _conflicts(config: VehicleConfig) -> Iterator[tuple[str, str]]:
    """Yield (key, reason) for values that are valid alone but not together."""
    airframe = config.vehicle
    ranging = config.ranging
    modes = tuple(MODES[config.vehicle.profile])
    named = [("start.mode", config.start.mode)]
    for i, event in enumerate(config.events):
        if event.action == "mode" and event.mode is None:
            yield f"events[{i}].mode", 'is missing, the action "mode" needs one'
        if event.action == "throttle" and (event.value is None or not 0 <= event.value <= 1):
            yield f"events[{i}].value", "is the throttle stick, from 0 to 1"
        if event.action in ("vtol", "waypoint") and event.value is None:
            yield f"events[{i}].value", "is missing: MAV_VTOL_STATE, or the item of the mission"
        if event.action == "airspeed_stuck" and event.value is None:
            yield f"events[{i}].value", "is missing: the airspeed that the sensor repeats, m/s"
        named.append((f"events[{i}].mode", event.mode))
    for name, mode in named:
        if mode is not None and mode not in modes:
            hint = nearest(mode, modes) or f"; modes: {', '.join(modes)}"
            yield name, f'"{mode}" is not a mode of {airframe.profile}{hint}'
    if airframe.dynamics == "airborne" and airframe.profile not in (
        "arducopter",
        "arducopter_nogps",
    ):
        yield "vehicle.dynamics", f'"airborne" is an arducopter, not an {airframe.profile}'
    if config.start.random.range_m and config.start.random.range_m[0] < 0:
        yield "start.random.range_m", "must not begin below 0"
    if not config.start.armed and (config.start.altitude_m or 0.0) > 0:
        yield "start.armed", "false needs altitude_m = 0: a disarmed vehicle cannot fly"
    if ranging.via == "forwarded" and ranging.message == "ranging_beacon":
        remedy = 'use via = "direct" (the radio on its own endpoint)'
        yield "ranging.via", f"autopilots do not forward RANGING_BEACON, {remedy}"
    if ranging.via == "autopilot" and ranging.message != "distance_sensor":
        yield "ranging.message", 'the autopilot re-sends only "distance_sensor", or use another via'
    if ranging.via == "autopilot" and ranging.rate_name is not None:
        yield "ranging.rate_name", "the autopilot re-sends ranges only, use another via"
    if ranging.via != "autopilot" and (ranging.system_id, ranging.component_id) == (
        airframe.system_id,
        1,
    ):
        yield "ranging.component_id", "1 is the autopilot itself, choose another (192)"
