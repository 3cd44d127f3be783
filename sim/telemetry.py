"""The autopilot's own messages, and the messages with the true state. Each function has the name of
its message.

Units and frames are those of MAVLink.
"""

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import all as mavlink

from .autopilots.contract import LAST_ITEM
from .body import GRAVITY, to_earth, within
from .demands import Bank, BodyVelocity, EarthVelocity, Tilt
from .flight import Flight
from .links import Message
from .ranging_radio import centimeters
from .world import HOME_AMSL_M, HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG, to_degrees

# Unix time of SYSTEM_TIME at simulated time zero, us. It is fixed, so that runs are repeatable.
EPOCH_US = 1_750_000_000_000_000
EKF_GOOD = 0x33F
EKF_NO_POSITION = 0xA7
EKF_LOSING = 0x25  # after the loss of GPS, until the estimator assumes a constant position
EKF_RECKONS = 0x12F  # dead reckoning, no absolute position
GPS_FIX_RTK = 6
SEA_LEVEL_HPA = 1013.25
GPS_NO_FIX = 1
UNKNOWN_VOLTAGE = 65535
ONLY_VELOCITY = 0xC07
NO_POSITION_NO_YAW = 0x407
IMU_FIELDS_UPDATED = 0x3F  # HIGHRES_IMU: acceleration and rates
GPS_SENSOR = 0x20
FENCE_KEPT = 0x100000
SENSORS = (
    0x1 | 0x2 | 0x4 | 0x8 | GPS_SENSOR | 0x200000 | 0x2000000 | 0x10000000
)  # gyro to GPS, AHRS, battery, pre-arm check


def heartbeat(flight: Flight) -> Message:
    pilot = flight.autopilot
    kind = (pilot.identity.mav_type, pilot.identity.autopilot)
    status = pilot.system_status()
    return mavlink.MAVLink_heartbeat_message(*kind, pilot.base_mode(), pilot.mode, status, 3)


def sys_status(flight: Flight) -> Message:
    healthy = FENCE_KEPT | (SENSORS if flight.autopilot.gps else SENSORS & ~GPS_SENSOR)
    percent = flight.battery_percent()
    return mavlink.MAVLink_sys_status_message(
        SENSORS, SENSORS, healthy, 200, _millivolts(percent), 1500, round(percent), 0, 0, 0, 0, 0, 0
    )


def system_time(flight: Flight) -> Message:
    return mavlink.MAVLink_system_time_message(EPOCH_US + flight.now, flight.boot_ms)


def gps_raw_int(flight: Flight) -> Message:
    body = flight.body
    if not flight.autopilot.gps:
        return mavlink.MAVLink_gps_raw_int_message(
            flight.boot_us, GPS_NO_FIX, 0, 0, 0, 65535, 65535, 0, 65535, 0
        )
    place = *flight.degrees_e7(), round((HOME_AMSL_M - body.down) * 1000)
    speed = min(65534, round(body.ground_speed * 100))
    return mavlink.MAVLink_gps_raw_int_message(
        flight.boot_us,
        GPS_FIX_RTK,
        *place,
        121,
        200,
        speed,
        _centidegrees(body.course),
        10,
        h_acc=round(1000 * math.sqrt(2) * flight.config.sensors.gps_error_m),
    )


def attitude(flight: Flight) -> Message:
    body = flight.shown()
    rates = flight.instruments.rates(flight.body)
    return mavlink.MAVLink_attitude_message(
        flight.boot_ms, body.roll, body.pitch, body.heading, *rates
    )


def attitude_quaternion(flight: Flight) -> Message:
    rates = flight.instruments.rates(flight.body)
    return mavlink.MAVLink_attitude_quaternion_message(
        flight.boot_ms, *flight.shown().quaternion(), *rates
    )


def raw_imu(flight: Flight) -> Message:
    return mavlink.MAVLink_raw_imu_message(flight.boot_us, *_milli_imu(flight), 0, 0, 0)


def scaled_imu2(flight: Flight) -> Message:
    return mavlink.MAVLink_scaled_imu2_message(flight.boot_ms, *_milli_imu(flight, 1), 0, 0, 0)


def scaled_imu3(flight: Flight) -> Message:
    """ArduPilot with two IMUs and three compasses sends zeros and the third compass (measured on
    4.6.3; send_scaled_imu in GCS_Common.cpp)."""
    return mavlink.MAVLink_scaled_imu3_message(flight.boot_ms, *[0] * 9)


def highres_imu(flight: Flight) -> Message:
    acceleration, rates = flight.imu()
    nothing = [0.0] * 7  # magnetometer, barometer, temperature: not flagged as updated
    return mavlink.MAVLink_highres_imu_message(
        flight.boot_us, *acceleration, *rates, *nothing, IMU_FIELDS_UPDATED
    )


def _milli_imu(flight: Flight, index: int = 0) -> list[int]:
    """Return accelerations in mg and rates in mrad/s, as ArduPilot sends them."""
    acceleration, rates = flight.imu(index)
    return [
        round(within(value * 1000, 32767))
        for value in (*(part / GRAVITY for part in acceleration), *rates)
    ]


def local_position_ned(flight: Flight) -> Message | None:
    body = flight.shown()
    if not flight.autopilot.position:
        return None
    return mavlink.MAVLink_local_position_ned_message(
        flight.boot_ms, body.north, body.east, body.down, *body.velocity
    )


def global_position_int(flight: Flight) -> Message:
    body = flight.shown()
    *place, altitude = flight.location()
    heights = round(altitude * 1000), round((-body.down - flight.home_rise) * 1000)
    velocity = (round(within(speed * 100, 32767)) for speed in body.velocity)
    return mavlink.MAVLink_global_position_int_message(
        flight.boot_ms, *place, *heights, *velocity, _centidegrees(body.heading)
    )


def vfr_hud(flight: Flight) -> Message:
    body = flight.shown()
    airspeed = flight.autopilot.stuck_airspeed
    if airspeed is None:
        airspeed = flight.instruments.airspeed(
            flight.autopilot.shown_airspeed(body, flight.air.velocity)
        )
    heading = round(math.degrees(body.heading) % 360) % 360
    # Without a location VFR_HUD.alt repeats its last value. VFR_HUD.climb and
    # GLOBAL_POSITION_INT.relative_alt continue.
    above_home = -body.down - flight.home_rise
    altitude = above_home if flight.autopilot.relative_hud() else flight.location()[2]
    return mavlink.MAVLink_vfr_hud_message(
        airspeed, body.ground_speed, heading, 35, altitude, -body.velocity_down
    )


def scaled_pressure(flight: Flight) -> Message:
    """Static pressure of the standard atmosphere and dynamic pressure of the airspeed sensor,
    hPa."""
    altitude = HOME_AMSL_M - flight.body.down
    static = SEA_LEVEL_HPA * (1 - 2.25577e-5 * altitude) ** 5.25588
    airspeed = flight.autopilot.shown_airspeed(flight.body, flight.air.velocity)
    dynamic = 0.0 if math.isnan(airspeed) else 0.5 * 1.225 * airspeed**2 / 100
    centidegrees = round(1500 - 0.65 * altitude)
    return mavlink.MAVLink_scaled_pressure_message(flight.boot_ms, static, dynamic, centidegrees)


def battery_status(flight: Flight) -> Message:
    percent = flight.battery_percent()
    cells = [_millivolts(percent)] + [UNKNOWN_VOLTAGE] * 9
    used = round((100 - percent) * 33)
    return mavlink.MAVLink_battery_status_message(
        0, 0, 0, 32767, cells, 1500, used, -1, round(percent)
    )


def ekf_status_report(flight: Flight) -> Message:
    flags = EKF_GOOD if flight.autopilot.position else EKF_NO_POSITION
    if not flight.autopilot.position and flight.autopilot.locates(flight.now):
        flags = EKF_LOSING
    flags = EKF_RECKONS if flight.autopilot.reckons() else flags
    if flight.ekf_zeros > 0:
        flight.ekf_zeros -= 1
        flags = 0
    return mavlink.MAVLink_ekf_status_report_message(flags, 0.02, 0.03, 0.01, 0.02, 0.0, 0.0)


def extended_sys_state(flight: Flight) -> Message:
    pilot = flight.autopilot
    return mavlink.MAVLink_extended_sys_state_message(pilot.vtol_state, pilot.landed_state())


def mission_current(flight: Flight) -> Message:
    """Return the present item of the autopilot's mission. ArduPilot and PX4 send this message even
    without a mission, with item 0."""
    item = flight.autopilot.waypoint
    return mavlink.MAVLink_mission_current_message(item or 0, LAST_ITEM if item else 0)


def distance_sensor(flight: Flight) -> Message | None:
    """Range in the rangefinder driver. ArduPilot repeats the last range until it is 0.45 s old,
    each time with the time of sending."""
    sample = flight.latest_range()
    if sample is None:
        return None
    config = flight.config.ranging
    stamp = flight.boot_ms
    number = 0
    # PX4 counts sensors from 1 and sends the time of the measurement.
    if flight.autopilot.identity.ranges_on_update:
        stamp = (sample.taken_us - flight.booted) // 1000 & 0xFFFFFFFF
        number = 1
    most = centimeters(config.max_range_m)
    distance = centimeters(sample.distance)
    return mavlink.MAVLink_distance_sensor_message(
        stamp, 0, most, distance, 0, number, config.orientation, 0
    )


def home_position(flight: Flight) -> Message:
    place = (
        round(HOME_LATITUDE_DEG * 1e7),
        round(HOME_LONGITUDE_DEG * 1e7),
        round((HOME_AMSL_M + flight.home_rise) * 1000),
    )
    nothing = (0.0, 0.0, 0.0)
    level = [1.0, 0.0, 0.0, 0.0]
    return mavlink.MAVLink_home_position_message(*place, *nothing, level, *nothing, flight.now)


def autopilot_version(flight: Flight) -> Message:
    identity = flight.autopilot.identity
    capabilities = identity.capabilities
    if flight.config.vehicle.mavlink_version == 1:
        capabilities &= ~mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    unknown = 0, 0, 0, *([0] * 8,) * 3, 0, 0  # other versions, their hashes, vendor and product
    serial = 0x51D0 + flight.config.vehicle.system_id
    return mavlink.MAVLink_autopilot_version_message(
        capabilities, identity.version, *unknown, serial
    )


def current_mode(flight: Flight) -> Message:
    pilot = flight.autopilot
    return mavlink.MAVLink_current_mode_message(0, pilot.mode, pilot.intended)


def timesync(flight: Flight) -> Message:
    """Time synchronization request to all receivers."""
    return mavlink.MAVLink_timesync_message(
        0, flight.boot_us * 1000 + flight.config.vehicle.system_id
    )


def nav_controller_output(flight: Flight) -> Message | None:
    """Commanded bank of a plane, after the limit."""
    roll = flight.autopilot.commanded_roll()
    if roll is None:
        return None
    return mavlink.MAVLink_nav_controller_output_message(
        math.degrees(roll), 0.0, 0, 0, 0, 0.0, 0.0, 0.0
    )


def position_target_local_ned(flight: Flight) -> Message | None:
    """Velocity setpoint that a copter flies, earth frame.

    ArduCopter 4.6 also reports the acceleration feedforward, but no yaw rate. PX4 reports
    feedforward and yaw rate.
    """
    flown = flight.autopilot.flown()
    pilot = flight.autopilot
    fed = (0.0, 0.0)
    if isinstance(flown, BodyVelocity):
        north, east = to_earth(flown.forward, flown.right, flight.body.heading)
        fed = to_earth(0.0, flown.forward * flown.yaw_rate, flight.body.heading)
    elif isinstance(flown, EarthVelocity):
        north, east = flown.north, flown.east
        fed = flown.acceleration_north, flown.acceleration_east
    else:
        return None
    px4 = pilot.identity.autopilot == mavlink.MAV_AUTOPILOT_PX4
    mask, yaw_rate = (NO_POSITION_NO_YAW, flown.yaw_rate) if px4 else (ONLY_VELOCITY, 0.0)
    return mavlink.MAVLink_position_target_local_ned_message(
        flight.boot_ms, 1, mask, 0.0, 0.0, 0.0, north, east, flown.down, *fed, 0.0, 0.0, yaw_rate
    )


def attitude_target(flight: Flight) -> Message | None:
    """Attitude setpoint that a copter or PX4's plane flies."""
    flown = flight.autopilot.flown()
    if not isinstance(flown, (Bank, Tilt)):
        return None
    heading, yaw_rate = (flown.heading, flown.yaw_rate) if isinstance(flown, Tilt) else (None, 0.0)
    thrust = None if isinstance(flown, Bank) else flown.thrust
    body = flight.body._replace(roll=flown.roll, pitch=flown.pitch or 0.0)
    q = (body if heading is None else body._replace(heading=heading)).quaternion()
    thrust = 0.5 if thrust is None else thrust
    return mavlink.MAVLink_attitude_target_message(
        flight.boot_ms, 0, list(q), 0.0, 0.0, yaw_rate, thrust
    )


def wind(flight: Flight) -> Message | None:
    """Wind speed, m/s, and the direction from which the wind blows, degrees. Only vehicles that
    control their airspeed send it."""
    if flight.body.air_speed == 0:
        return None
    north, east = flight.air.velocity
    return mavlink.MAVLink_wind_message(
        math.degrees(math.atan2(-east, -north)), math.hypot(north, east), 0.0
    )


def sim_state(flight: Flight) -> Message:
    """True state, sent without a request so that flights can be evaluated."""
    body = flight.body
    latitude, longitude = to_degrees(body.north, body.east)
    angles = *body.quaternion(), body.roll, body.pitch, body.heading
    place = latitude, longitude, HOME_AMSL_M - body.down
    whole = round(latitude * 1e7), round(longitude * 1e7)
    return mavlink.MAVLink_sim_state_message(
        *angles,
        *flight.specific_force(),
        *body.body_rates(),
        *place,
        0.0,
        0.0,
        *body.velocity,
        *whole,
    )


def truth_array(flight: Flight) -> Message:
    """DEBUG_FLOAT_ARRAY with the fields north to wind_east of `Truth`, then its time; SI, radians,
    NED from home."""
    t = flight.truth()
    values = [*t[1:4], math.remainder(t.heading, math.tau), *t[5:16], t.time]
    return mavlink.MAVLink_debug_float_array_message(
        flight.now, b"SIM_TRUTH", 0, values + [0.0] * 42
    )


def _millivolts(percent: float) -> int:
    """Return the voltage of a battery with three cells, linear in the charge."""
    return round(10_500 + 21 * percent)


def _centidegrees(angle: float) -> int:
    """Return an angle in hundredths of a degree, 0 to 35999."""
    return round(math.degrees(angle) % 360 * 100) % 36000


_FUNCTIONS: tuple[Callable[[Flight], Message | None], ...] = (
    heartbeat,
    sys_status,
    system_time,
    gps_raw_int,
    raw_imu,
    attitude,
    attitude_quaternion,
    local_position_ned,
    global_position_int,
    vfr_hud,
    scaled_pressure,
    nav_controller_output,
    attitude_target,
    position_target_local_ned,
    highres_imu,
    timesync,
    scaled_imu2,
    scaled_imu3,
    distance_sensor,
    battery_status,
    autopilot_version,
    wind,
    ekf_status_report,
    home_position,
    extended_sys_state,
    mission_current,
    current_mode,
)
BUILDERS = {
    getattr(mavlink, f"MAVLINK_MSG_ID_{build.__name__.upper()}"): build for build in _FUNCTIONS
}
