"""Message signing of autopilots. pymavlink signs sent frames. Received frames are checked as in the
autopilots' C library.

Source: mavlink_signature_check (mavlink_helpers.h), ArduPilot's GCS_Signing.cpp, PX4's
message_signing.md.
"""

import hashlib
from pathlib import Path

from pymavlink.dialects.v20 import all as mavlink

from .schema import ConfigError

EPOCH_S = 1_420_070_400  # Unix time of the start of 2015, s
TICKS_PER_S = 100_000
MOST_STREAMS = 16  # MAVLINK_MAX_SIGNING_STREAMS
UNSIGNED_BY_ARDUPILOT = frozenset({109, 166})  # RADIO_STATUS, RADIO
UNSIGNED_BY_PX4 = frozenset({0, 109, 246, 247})  # HEARTBEAT, RADIO_STATUS, ADSB_VEHICLE, COLLISION
SIGNED_FLAG = 1


class FrameSigning:
    """Key, timestamp and known streams of one autopilot. Without a key it accepts every frame."""

    def __init__(
        self, key: bytes | None, unsigned_ids: frozenset[int], accept_unsigned: bool = False
    ) -> None:
        self._key = key
        self._unsigned_ids = unsigned_ids
        self._accept_unsigned = accept_unsigned
        self._streams: dict[tuple[int, int, int], int] = {}
        self.timestamp = 0
        self.refused = 0

    def set_time(self, unix: float) -> None:
        """Set the timestamp from a Unix time of GPS or a clock, s. The timestamp never
        decreases."""
        self.timestamp = max(self.timestamp, round((unix - EPOCH_S) * TICKS_PER_S))

    def reboot(self) -> None:
        """Clear the known streams and continue one minute after the stored timestamp."""
        self._streams.clear()
        self.timestamp += 60 * TICKS_PER_S

    def prepare(self, engine: mavlink.MAVLink) -> None:
        """Set up an engine to sign the next message."""
        signing = engine.signing
        signing.secret_key = self._key
        signing.sign_outgoing = self._key is not None
        signing.timestamp = self.timestamp
        self.timestamp += 1

    def accepts(self, message: mavlink.MAVLink_message) -> bool:
        """True if the autopilot accepts a message.

        A valid signature always advances the timestamp, even on a message that may be unsigned
        (mavlink_helpers.h, accept_unsigned_callback).
        """
        if self._key is None:
            return True
        frame = bytes(message.get_msgbuf())
        good = frame[0] == 0xFD and bool(frame[2] & SIGNED_FLAG) and self._good(frame)
        good = good or self._accept_unsigned or message.get_msgId() in self._unsigned_ids
        self.refused += not good
        return good

    def _good(self, frame: bytes) -> bool:
        digest = hashlib.new("sha256", self._key or b"")
        digest.update(frame[:-6])
        if digest.digest()[:6] != frame[-6:]:
            return False
        stamp = int.from_bytes(frame[-12:-6], "little")
        stream = (frame[5], frame[6], frame[-13])
        if stream in self._streams:
            fresh = stamp > self._streams[stream]
        else:
            fresh = len(self._streams) < MOST_STREAMS and stamp + 60 * TICKS_PER_S >= self.timestamp
        if fresh:
            self._streams[stream] = stamp
            self.timestamp = max(self.timestamp, stamp)
        return fresh


def read_key(path: str, where: str) -> bytes:
    """Read a key file of 64 hex digits or 32 bytes. Raises ConfigError."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise ConfigError(f"{where}: {path}: cannot be read: {error.strerror or error}") from error
    try:
        key = bytes.fromhex(data.decode("ascii"))
    except ValueError:
        key = data
    if len(key) != 32:
        raise ConfigError(
            f"{where}: {path}: holds {len(key)} bytes, a key has 32, or 64 hex digits"
        )
    return key
