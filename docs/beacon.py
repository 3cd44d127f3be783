"""Simulate a ranging radio for a simulator without one: python docs/beacon.py URL --north 60 --east
0

The program receives the simulator's true position on a separate link to the autopilot (as mavutil
writes it: tcp:127.0.0.1:5762, udpin:0.0.0.0:14550), also after a loss of GPS. It sends the range
from this position to a beacon on the ground, as DISTANCE_SENSOR from component 1/192. The autopilot
forwards the message to circnav. circnav receives no position. The simulator may run at any speed.
"""

import argparse
import math
import random
import time

from pymavlink import mavutil
from pymavlink.dialects.v20 import common

EARTH = 6378137.0
RADIO = 192
UPWARD = 24
MOST_CM = 65534
HEARTBEAT_PERIOD = 0.5
TRUE = {"SIM_STATE": ("lat_int", "lon_int"), "HIL_STATE_QUATERNION": ("lat", "lon")}
"""True position, 1e-7 deg: messages of the simulators of ArduPilot and PX4, with their fields."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[1])
    parser.add_argument("url", help="link to the autopilot that circnav does not use")
    parser.add_argument("--north", type=float, default=60.0, help="beacon north of the vehicle, m")
    parser.add_argument("--east", type=float, default=0.0, help="beacon east of the vehicle, m")
    parser.add_argument(
        "--noise", type=float, default=0.5, help="standard deviation of the ranges, m"
    )
    parser.add_argument(
        "--rate", type=float, default=10.0, help="ranges per second of the vehicle's time"
    )
    parser.add_argument(
        "--seed", type=int, help="seed of the noise; default: another one at every start"
    )
    options = parser.parse_args()
    noise = random.Random(options.seed)
    link = mavutil.mavlink_connection(
        options.url, source_system=1, source_component=RADIO, dialect="common"
    )
    target: tuple[float, float] | None = None
    place: tuple[int, int] | None = None
    height = 0.0
    is_true = False
    due = float("-inf")
    greeted = float("-inf")
    while True:
        if time.monotonic() - greeted > HEARTBEAT_PERIOD:
            greeted = time.monotonic()
            say_hello(link, options.rate)
        message = link.recv_match(
            type=["ATTITUDE", "GLOBAL_POSITION_INT", *TRUE], blocking=True, timeout=0.1
        )
        if message is None:
            continue
        if fields := TRUE.get(message.get_type()):
            place = (getattr(message, fields[0]), getattr(message, fields[1]))
            is_true = True
        if message.get_type() == "GLOBAL_POSITION_INT":
            height = message.relative_alt / 1000
            # The estimated position freezes without GPS: use it only without the true one.
            place = place if is_true else (message.lat, message.lon)
        if message.get_type() != "ATTITUDE" or place in (None, (0, 0)):
            continue
        boot = message.time_boot_ms / 1000
        if not due - 10 / options.rate <= boot < due:
            due = boot + 0.9 / options.rate
            here = (math.radians(place[0] / 1e7), math.radians(place[1] / 1e7))
            if target is None:
                target = (
                    here[0] + options.north / EARTH,
                    here[1] + options.east / EARTH / math.cos(here[0]),
                )
            north, east = (
                (target[0] - here[0]) * EARTH,
                (target[1] - here[1]) * EARTH * math.cos(here[0]),
            )
            distance = math.hypot(north, east, height) + noise.gauss(0, options.noise)
            cm = min(max(round(100 * distance), 1), MOST_CM)
            link.mav.distance_sensor_send(message.time_boot_ms, 0, 65535, cm, 4, 0, UPWARD, 255)


def say_hello(link: mavutil.mavfile, rate: float) -> None:
    """Send a heartbeat, and requests for attitudes at this rate (Hz) and for positions, which must
    not be older."""
    link.mav.heartbeat_send(
        common.MAV_TYPE_ONBOARD_CONTROLLER, common.MAV_AUTOPILOT_INVALID, 0, 0, 4
    )
    for message, factor in (
        (common.MAVLINK_MSG_ID_ATTITUDE, 1),
        (common.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 5),
        (common.MAVLINK_MSG_ID_SIM_STATE, 5),
        (common.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, 5),
    ):
        interval = 1e6 / rate / factor
        link.mav.command_long_send(
            1, 1, common.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message, interval, 0, 0, 0, 0, 0
        )


if __name__ == "__main__":
    main()
