"""MAVLink 2 message signing without I/O or clock: sign our frames, accept or reject received ones.

    signature = first 6 bytes of sha256(key + header + payload + CRC + link id + timestamp)

Timestamps count 10 us since 2015. A timestamp is stored only after its signature was verified, so
that forged frames cannot lock out the real sender. (pymavlink 2.4.50 stores the timestamp first.)
Source of the rules: mavlink.io/en/guide/message_signing.html, and mavlink_signature_check of the C
library, which autopilots use.
"""

from enum import Enum
from functools import cache
from hashlib import sha256
from hmac import compare_digest

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.framing import SIGNATURE, SIGNED, V2

KEY_LENGTH = 32
"""Length of a key, bytes (MAVLink signing)."""
ZERO_KEY = bytes(KEY_LENGTH)
"""Default key of PX4 (main of 2026) until a key is set. The default key is public, so it proves and
protects nothing."""
EPOCH = 1_420_070_400
"""Start of 2015, unix seconds."""
SECOND = 100_000
"""Timestamp steps of 10 us in a second."""
MINUTE = 60 * SECOND
"""Timestamp steps of 10 us in a minute: allowed delay of a new sender's clock (MAVLink signing)."""
LATEST = 2**48 - 1
"""Largest timestamp in the 48 bits of a signature."""
_FLAGS_AT = 2
"""Index of the incompatibility flags in a MAVLink 2 frame."""
_HASH = 6
"""Length of the hash at the end of a signature, and of the timestamp before it, bytes."""


class Refusal(Enum):
    """Reason why a frame is not authenticated."""

    UNSIGNED = "unsigned"
    WRONG = "wrong_signature"
    REPEATED = "repeated"
    BEHIND = "clock_behind"


class Signing:
    """One key with its timestamps: the timestamp of our newest frame, and the newest timestamp of
    each received stream.

    `timestamp` never decreases, except by `update`. It increases with the clock (`advance`), with
    each frame of our own and with received frames. So it is at least the timestamp of every
    accepted frame. If it is kept across a restart (`resume`), all replayed frames are rejected.
    """

    def __init__(self, key: bytes, *, link_id: int = 0, timestamp: int = 0) -> None:
        """key: 32 bytes. timestamp: initial value."""
        if len(key) != KEY_LENGTH:
            raise ValueError(f"a signing key has {KEY_LENGTH} bytes, not {len(key)}")
        self._key = key
        self._link_id = link_id
        self._newest: dict[tuple[int, int, int], int] = {}
        self._resumed_at = -1
        self.timestamp = timestamp

    def __repr__(self) -> str:
        return f"Signing(link_id={self._link_id}, timestamp={self.timestamp})"

    def advance(self, unix: float) -> None:
        """Advance the timestamp to the wall-clock time, unix seconds. An earlier time has no
        effect."""
        self._reach(int((unix - EPOCH) * SECOND))

    def update(self, unix: float) -> None:
        """Set the timestamp to the wall-clock time, unix seconds. A timestamp more than a minute
        ahead is set back. Use only for frames that contain a time of their own, which the receiver
        checks."""
        now = max(int((unix - EPOCH) * SECOND), 0)
        if self.timestamp > now + MINUTE:
            self.timestamp = now
            self._newest = {key: at for key, at in self._newest.items() if at <= now + MINUTE}
        self._reach(now)

    def resume(self, timestamp: int) -> None:
        """Continue from the final timestamp of an earlier run. Frames with a timestamp up to this
        one are rejected as already received."""
        self._resumed_at = timestamp
        self._reach(timestamp)

    def sign(self, frame: bytes) -> bytes:
        """Return one of our MAVLink 2 frames with a signature. Each frame has a unique
        timestamp."""
        self._reach(self.timestamp + 1)
        body = (
            _flag_changed(frame)
            + bytes((self._link_id,))
            + self.timestamp.to_bytes(_HASH, "little")
        )
        return body + sha256(self._key + body).digest()[:_HASH]

    def check(self, frame: bytes) -> Refusal | None:
        """Return the reason to reject a signed frame, or None. The timestamp of an accepted frame
        is stored.

        A stream (system, component, link id) that is new to this process may be one minute behind
        our timestamp. Timestamps of other streams must increase.
        """
        if not is_signed_with(self._key, frame):
            return Refusal.WRONG
        stream = (frame[5], frame[6], frame[-SIGNATURE])
        timestamp = int.from_bytes(frame[1 - SIGNATURE : -_HASH], "little")
        newest = self._newest.get(stream)
        # A replayed frame is not newer than the end of the run that received it. A real sender with
        # a clock behind the end of that run is rejected, too. It is accepted after its clock has
        # passed that time, or after it has adopted the timestamp of our frames.
        if newest is None and timestamp < max(self.timestamp - MINUTE, self._resumed_at + 1):
            return Refusal.BEHIND
        if newest is not None and timestamp <= newest:
            return Refusal.REPEATED
        self._newest[stream] = timestamp
        self._reach(timestamp)
        return None

    def _reach(self, timestamp: int) -> None:
        self.timestamp = max(self.timestamp, min(timestamp, LATEST))


def is_signed_with(key: bytes, frame: bytes) -> bool:
    return compare_digest(sha256(key + frame[:-_HASH]).digest()[:_HASH], frame[-_HASH:])


def is_signed(frame: bytes) -> bool:
    """True if a complete frame carries a signature, valid or not."""
    return frame[0] == V2 and bool(frame[_FLAGS_AT] & SIGNED)


def without_signature(frame: bytes) -> bytes:
    """Return the frame without signature and with a correct CRC, as MAVLink's guide requires for
    logs."""
    return _flag_changed(frame[:-SIGNATURE]) if is_signed(frame) else frame


def _flag_changed(frame: bytes) -> bytes:
    """Return a frame without signature with its signed flag inverted and its CRC updated."""
    crc = int.from_bytes(frame[-2:], "little") ^ _flag_in_crc(frame[1])
    flags = bytes((frame[_FLAGS_AT] ^ SIGNED,))
    return frame[:_FLAGS_AT] + flags + frame[_FLAGS_AT + 1 : -2] + crc.to_bytes(2, "little")


@cache
def _flag_in_crc(payload: int) -> int:
    """Return the CRC change that the flag causes in a frame with this payload length, bytes.

    A CRC is linear: neither the message id nor its CRC_EXTRA is needed.
    """
    covered = bytearray(9 + payload + 1)
    plain = dialect.x25crc(bytes(covered)).crc
    covered[_FLAGS_AT - 1] = SIGNED
    return int(plain ^ dialect.x25crc(bytes(covered)).crc)
