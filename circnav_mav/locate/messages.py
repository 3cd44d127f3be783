"""The place as MAVLink messages."""

from math import isfinite

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.types import Direction, Orbit
from circnav_mav.locate.place import Place
from circnav_mav.mav.clocks import our_boot_ms
from circnav_mav.mav.codec import Message

UNKNOWN_ACCURACY = 2**32 - 1


def degrees_e7(place: Place) -> tuple[int, int]:
    """Latitude and longitude in degrees times ten million."""
    return round(place.latitude * 1e7), round(place.longitude * 1e7)


def named_values(place: Place, now: float) -> list[Message]:
    """For a ground station's graphs: m east and north of the vehicle's first position, standard deviation, speed."""
    values = {"CN_TEAST": place.east, "CN_TNORTH": place.north, "CN_TSIG": place.sigma, "CN_TSPD": place.speed}
    if place.up_known:
        values["CN_TALT"] = place.up
    stamp = our_boot_ms(now)
    return [
        dialect.MAVLink_named_value_float_message(stamp, name.encode(), value)
        for name, value in values.items()
        if isfinite(value)
    ]


def orbit_status(place: Place, orbit: Orbit, now: float) -> Message:
    """ORBIT_EXECUTION_STATUS: QGroundControl draws the circle. Radius positive: clockwise. z: the target's altitude
    above sea level, where it is known."""
    x, y = degrees_e7(place)
    radius = orbit.radius if orbit.direction is Direction.CLOCKWISE else -orbit.radius
    z = place.up if place.up_known else 0.0
    return dialect.MAVLink_orbit_execution_status_message(round(now * 1e6), radius, dialect.MAV_FRAME_GLOBAL, x, y, z)


def own_beacon(place: Place, slant: float, sigma: float, target: tuple[int, int], now: float) -> Message:
    """RANGING_BEACON: the newest range with the place of its beacon, mm; PX4 knows the message."""
    x, y = degrees_e7(place)
    altitude, vertical = (
        (place.up, round(place.up_sigma * 1000)) if place.up_known else (float("nan"), UNKNOWN_ACCURACY)
    )
    return dialect.MAVLink_ranging_beacon_message(
        round(now * 1e6), *target, 0, round(slant * 1000), x, y, altitude, 0, round(place.sigma * 1000), vertical, 0,
        round(sigma * 1000), round(now * 10) % 256, 0,
    )  # fmt: skip


def camera(place: Place, target: tuple[int, int]) -> Message:
    """MAV_CMD_DO_SET_ROI_LOCATION, as COMMAND_INT: single precision would be metres off."""
    x, y = degrees_e7(place)
    return dialect.MAVLink_command_int_message(
        *target, dialect.MAV_FRAME_GLOBAL, dialect.MAV_CMD_DO_SET_ROI_LOCATION, 0, 0, 0.0, 0.0, 0.0, 0.0, x, y, place.up
    )


def position_estimate(
    latitude: float, longitude: float, sigma: float, target: tuple[int, int], now: float, age: float
) -> Message:
    """MAV_CMD_EXTERNAL_POSITION_ESTIMATE. param1: time of sending, s; param2: age of the estimate, s; param3: one
    standard deviation, m. ArduPilot wants z to be NaN and the frame to be GLOBAL."""
    return dialect.MAVLink_command_int_message(
        *target, dialect.MAV_FRAME_GLOBAL, dialect.MAV_CMD_EXTERNAL_POSITION_ESTIMATE, 0, 0,
        now % 10_000.0, age, sigma, 0.0, round(latitude * 1e7), round(longitude * 1e7), float("nan"),
    )  # fmt: skip
