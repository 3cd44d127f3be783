"""Simulate a ranging radio for a simulator without one: python docs/beacon.py URL --north 60 --east
0

The program receives GLOBAL_POSITION_INT on a separate link to the autopilot (as mavutil writes it:
tcp:127.0.0.1:5762, udpin:0.0.0.0:14550). It sends the range from this position to a beacon on the
ground, as DISTANCE_SENSOR from component 1/192. The autopilot forwards the message to circnav.
circnav receives no position. The simulator may run at any speed.
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
    due = float("-inf")
    greeted = float("-inf")
    while True:
        if time.monotonic() - greeted > HEARTBEAT_PERIOD:
            greeted = time.monotonic()
            say_hello(link, options.rate)
        position = link.recv_match(type="GLOBAL_POSITION_INT", blocking=True, timeout=0.1)
        if position is None or (position.lat == 0 and position.lon == 0):
            continue
        boot = position.time_boot_ms / 1000
        if not due - 10 / options.rate <= boot < due:
            due = boot + 0.9 / options.rate
            here = (math.radians(position.lat / 1e7), math.radians(position.lon / 1e7))
            if target is None:
                target = (
                    here[0] + options.north / EARTH,
                    here[1] + options.east / EARTH / math.cos(here[0]),
                )
            north, east = (
                (target[0] - here[0]) * EARTH,
                (target[1] - here[1]) * EARTH * math.cos(here[0]),
            )
            distance = math.hypot(north, east, position.relative_alt / 1000) + noise.gauss(
                0, options.noise
            )
            cm = min(max(round(100 * distance), 1), MOST_CM)
            link.mav.distance_sensor_send(position.time_boot_ms, 0, 65535, cm, 4, 0, UPWARD, 255)


def say_hello(link: mavutil.mavfile, rate: float) -> None:
    """Send a heartbeat, and a request for positions at this rate (Hz)."""
    link.mav.heartbeat_send(
        common.MAV_TYPE_ONBOARD_CONTROLLER, common.MAV_AUTOPILOT_INVALID, 0, 0, 4
    )
    message = common.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
    interval = 1e6 / rate
    link.mav.command_long_send(
        1, 1, common.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message, interval, 0, 0, 0, 0, 0
    )


if __name__ == "__main__":
    main()
