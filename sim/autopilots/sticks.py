"""A pilot's sticks over MAVLink: RC_CHANNELS_OVERRIDE and MANUAL_CONTROL."""

from ..body import within
from ..links import Message

IGNORED_PWM = 65535
RELEASED_PWM = 0
IGNORED_AXIS = 32767


class Sticks:
    """The sticks for roll, pitch and yaw, and the time of their last message. ArduPilot accepts
    only SYSID_MYGCS."""

    def __init__(self, system: int) -> None:
        self._system = system
        self._roll = self._forward = self._yaw = 0.0
        self.last: int | None = None

    def receive(self, message: Message, now: int, pilot: int | None) -> bool:
        """Read a message. Return True if it moved a stick. pilot: the only accepted system id, None
        for all."""
        if pilot is not None and message.get_srcSystem() != pilot:
            return False
        kind = message.get_type()
        if (
            kind == "MANUAL_CONTROL"
            and message.target == self._system
            and message.y != IGNORED_AXIS
        ):
            self._roll = within(message.y / 1000, 1.0)
            self.last = now
            self._forward = within(message.x / 1000, 1.0)
            self._yaw = within(message.r / 1000, 1.0)
            return True
        if kind == "RC_CHANNELS_OVERRIDE" and message.chan1_raw != IGNORED_PWM:
            released = message.chan1_raw == RELEASED_PWM
            self._roll = 0.0 if released else within((message.chan1_raw - 1500) / 500, 1.0)
            self.last = now
            return True
        return False

    def roll(self, now: int, timeout: int) -> float:
        """Return the roll stick, -1 to 1, right positive. 0 if the last message is older than
        `timeout` (us)."""
        return self._roll if self.alive(now, timeout) else 0.0

    def forward(self, now: int, timeout: int) -> float:
        """Return the pitch stick, -1 to 1, forward positive. 0 if the last message is older than
        `timeout` (us)."""
        return self._forward if self.alive(now, timeout) else 0.0

    def yaw(self, now: int, timeout: int) -> float:
        """Return the yaw stick, -1 to 1, right positive. 0 if the last message is older than
        `timeout` (us)."""
        return self._yaw if self.alive(now, timeout) else 0.0

    def alive(self, now: int, timeout: int) -> bool:
        return self.last is not None and now - self.last < timeout
