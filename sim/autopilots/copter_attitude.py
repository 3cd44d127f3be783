"""SET_ATTITUDE_TARGET as ArduCopter 4.6.3 reads it (GCS_Mavlink.cpp, handle_message_set_attitude_target)."""

import math

from sim.autopilots.copter_targets import Poison, Stop
from sim.body import euler
from sim.demands import Spin, Tilt
from sim.params import Parameters
from sim.wire import Message

RATES, THROTTLE, ATTITUDE = 0x07, 0x40, 0x80
THRUST_AS_THRUST = 8  # GUID_OPTIONS bit 3


def read_attitude_target(message: Message, params: Parameters) -> Tilt | Spin | Stop | Poison | None:
    """The demand; Stop when ill-defined, None when it is silently dropped."""
    mask = message.type_mask
    if mask & THROTTLE:
        return None
    given = mask & RATES
    if given not in (0, RATES):  # all three rates or none
        return Stop()
    rates = (0.0, 0.0, 0.0) if given else (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
    climb, thrust = _lift(message.thrust, params)
    if not all(map(math.isfinite, (*rates, climb))):
        return Poison()
    if mask & ATTITUDE:
        return Spin(rates[0], rates[1], rates[2], climb, thrust)
    q = tuple(message.q)
    if not all(map(math.isfinite, q)) or abs(sum(v * v for v in q) - 1) > 1e-3:
        return Stop()
    roll, pitch, heading = euler(q)
    return Tilt(roll, pitch, heading, rates[2], climb, thrust)


def _lift(thrust: float, params: Parameters) -> tuple[float, float | None]:
    """A climb rate, m/s: 0.5 holds the height; or the raw thrust if the parameters say so."""
    if int(params["GUID_OPTIONS"]) & THRUST_AS_THRUST:
        return 0.0, max(-1.0, min(1.0, thrust))
    if not math.isfinite(thrust):
        return math.nan, None
    share = (max(0.0, min(1.0, thrust)) - 0.5) * 2
    return share * params["WPNAV_SPEED_UP" if share > 0 else "WPNAV_SPEED_DN"] / 100, None
