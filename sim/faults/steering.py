"""An autopilot that stays in its mode and does not fly its setpoints: it ignores their turns, or garbles them.

Seen on vehicles: a setpoint that a mode takes and does not fly (PX4's plane in OFFBOARD by velocity), a servo that has
let go, a channel that is reversed, a rate controller without gain. What it flies is another setpoint of the same type.
"""

import math
from copy import copy

from ..body import GRAVITY, euler
from ..links import Message

TURNING = math.radians(12)  # rad/s
WEAK = 0.1
PLANE_SPEED, FULL_STICK = 15.0, math.radians(50)  # m/s, by which a turn is made a bank; bank of a full stick


class Steering:
    """What becomes of a setpoint. state: one of STEERING_STATES, as in the vehicle file."""

    def __init__(self, state: str) -> None:
        self.state = state
        self._last: dict[str, Message] = {}

    def flown(self, message: Message) -> Message:
        """The setpoint that is flown in the place of this one."""
        kind = message.get_type()
        if self.state == "frozen":
            return self._last.setdefault(kind, message)
        self._last[kind] = message
        if self.state == "good":
            return message
        garbled = copy(message)
        if kind == "SET_ATTITUDE_TARGET":
            self._attitude(garbled)
        elif kind == "MANUAL_CONTROL":
            garbled.y = round(1000 * self._bank(message.y / 1000 * FULL_STICK) / FULL_STICK)
        else:
            self._velocity(garbled)
        return garbled

    def _turn(self, turn: float, own: float) -> float:
        """A turn, or a bank, in the place of a commanded one. own: that of a vehicle that turns by itself."""
        share = {"reversed": -1.0, "weak": WEAK}.get(self.state)
        return own * (self.state == "turning") if share is None else share * turn

    def _bank(self, bank: float) -> float:
        """A plane cannot hover: it circles."""
        own = math.atan(TURNING * PLANE_SPEED / GRAVITY)
        return own if self.state == "hovering" else self._turn(bank, own)

    def _attitude(self, message: Message) -> None:
        roll, pitch, _ = euler(tuple(message.q))
        half_roll, half_pitch = self._bank(roll) / 2, pitch / 2
        cr, sr, cp, sp = math.cos(half_roll), math.sin(half_roll), math.cos(half_pitch), math.sin(half_pitch)
        message.q = [cr * cp, sr * cp, cr * sp, -sr * sp]
        message.body_yaw_rate = self._turn(message.body_yaw_rate, TURNING)

    def _velocity(self, message: Message) -> None:
        message.yaw_rate = self._turn(message.yaw_rate, TURNING)
        message.afy = message.vx * message.yaw_rate if message.afy else 0.0
        if self.state == "hovering":
            message.vx = message.vy = message.afx = message.afy = 0.0
