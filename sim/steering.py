"""Fault of an autopilot: it stays in its mode, and ignores or changes the turns of its setpoints.

A real cause is a setpoint that a mode accepts and does not fly (PX4's plane in OFFBOARD by
velocity). Others are a disconnected servo, a reversed channel, and a rate controller without gain.
The fault replaces each setpoint by one of the same type.
"""

import math
from copy import copy

from .body import GRAVITY, euler
from .links import Message

TURNING = math.radians(12)  # turn rate of the state "turning", rad/s
WEAK = 0.1  # default share of the commanded turn in the state "weak"
PLANE_SPEED = 15.0  # speed with which a turn rate is converted to a bank, m/s
FULL_STICK = math.radians(50)  # bank at full stick


class Steering:
    """Replaces setpoints.

    state: one of STEERING_STATES, as in the vehicle file.
    share: part of the commanded turn that is flown in the state "weak".
    """

    def __init__(self, state: str) -> None:
        self.state = state
        self.share = WEAK
        self._last: dict[str, Message] = {}

    def flown(self, message: Message) -> Message:
        """Return the setpoint that is flown instead of this one."""
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
        """Return the turn rate or bank that replaces a commanded one. own: turn rate or bank of the
        state "turning"."""
        share = {"reversed": -1.0, "weak": self.share}.get(self.state)
        return own * (self.state == "turning") if share is None else share * turn

    def _bank(self, bank: float) -> float:
        """Return the bank that replaces a commanded one. A plane cannot hover, so it circles."""
        own = math.atan(TURNING * PLANE_SPEED / GRAVITY)
        return own if self.state == "hovering" else self._turn(bank, own)

    def _attitude(self, message: Message) -> None:
        roll, pitch, _ = euler(tuple(message.q))
        half_roll = self._bank(roll) / 2
        half_pitch = pitch / 2
        cr = math.cos(half_roll)
        sr = math.sin(half_roll)
        cp = math.cos(half_pitch)
        sp = math.sin(half_pitch)
        message.q = [cr * cp, sr * cp, cr * sp, -sr * sp]
        message.body_yaw_rate = self._turn(message.body_yaw_rate, TURNING)

    def _velocity(self, message: Message) -> None:
        message.yaw_rate = self._turn(message.yaw_rate, TURNING)
        message.afy = message.vx * message.yaw_rate if message.afy else 0.0
        if self.state == "hovering":
            message.vx = message.vy = message.afx = message.afy = 0.0
