"""The truth streams: what really happens, sent unasked so that flights can be judged."""

import math

from pymavlink.dialects.v20 import all as mavlink

from .flight import Flight
from .wire import Message
from .world import HOME_AMSL_M, to_degrees

NAME = b"SIM_TRUTH"
ZEROS = [0.0] * 41


def sim_state(flight: Flight) -> Message:
    body = flight.body
    latitude, longitude = to_degrees(body.north, body.east)
    angles = *body.quaternion(), body.roll, body.pitch, body.heading
    velocity = body.velocity_north, body.velocity_east, body.velocity_down
    place = latitude, longitude, HOME_AMSL_M - body.down
    whole = round(latitude * 1e7), round(longitude * 1e7)
    return mavlink.MAVLink_sim_state_message(
        *angles, *flight.specific_force(), *body.body_rates(), *place, 0.0, 0.0, *velocity, *whole
    )


def truth_array(flight: Flight) -> Message:
    """DEBUG_FLOAT_ARRAY: Truth's north .. wind_east and then its time; SI and radians, NED from home."""
    t = flight.truth()
    values = [*t[1:4], math.remainder(t.heading, math.tau), *t[5:16], t.time, 0.0]
    return mavlink.MAVLink_debug_float_array_message(flight.now, NAME, 0, values + ZEROS)
