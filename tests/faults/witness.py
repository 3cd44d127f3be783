"""Reads what the application is given, with pymavlink alone, and tells when the vehicle is not ours to steer."""

from hashlib import sha256

from pymavlink.dialects.v20 import all as mavlink

GUIDED = {
    "arducopter": 4,
    "arduplane": 15,
    "ardurover": 15,
    "px4_copter": 6 << 16,
    "px4_plane": 2 << 16,
    "px4_plane_attitude": 6 << 16,
}
"""HEARTBEAT.custom_mode in which setpoints are obeyed: autopilots.md; PX4's main mode in the third byte."""
VEHICLE = (1, 1)
ARMED = 128


class Witness:
    """taken: the vehicle was seen in the guided mode and then out of it. unproved: nothing was heard of it since we
    stood still."""

    def __init__(self, profile: str, key: bytes | None = None) -> None:
        """key: where the vehicle signs; what is not signed with it was not said by the vehicle."""
        self._key, self._newest = key, 0
        self._guided = GUIDED[profile]
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._was_ours = self._armed = False
        self.taken = self.unproved = False

    def stood_still(self) -> None:
        """The application has not run for a while; what waited for it proves nothing."""
        self.unproved = True

    def hear(self, data: bytes, *, waited: bool = False) -> None:
        """A datagram that the application is given; `waited`: during a stall."""
        if self._key is not None and not self._signed_now(data):
            return
        for message in self._parser.parse_buffer(data) or ():
            if (message.get_srcSystem(), message.get_srcComponent()) != VEHICLE:
                continue
            if message.get_type() == "HEARTBEAT":
                self._armed = bool(message.base_mode & ARMED)
                self.unproved = self.unproved and waited
                self._note(message.custom_mode)
            elif message.get_type() == "CURRENT_MODE" and message.custom_mode:
                self._note(message.custom_mode)

    def _signed_now(self, data: bytes) -> bool:
        """Whether a frame is truly signed, and not one of earlier."""
        stamp = int.from_bytes(data[-12:-6], "little")
        if sha256((self._key or b"") + data[:-6]).digest()[:6] != data[-6:] or stamp <= self._newest:
            return False
        self._newest = stamp
        return True

    def _note(self, mode: int) -> None:
        ours = self._armed and mode == self._guided
        self.taken = not ours and (self._was_ours or self.taken)
        self._was_ours = ours
