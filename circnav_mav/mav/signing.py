"""MAVLink 2 message signing without I/O or clock: our frames signed, the others' believed or refused.

    signature = first 6 bytes of sha256(key + header + payload + CRC + link id + timestamp)

Timestamps count 10 us since 2015. A signature is checked before its timestamp is looked at, and only a true one moves
anything here: whatever a forged frame claims, the real sender is not locked out (pymavlink 2.4.50 stores the timestamp
first). Source of the rules: mavlink.io/en/guide/message_signing.html, and mavlink_signature_check of the C library,
which autopilots use.
"""

from enum import Enum
from functools import cache
from hashlib import sha256
from hmac import compare_digest

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.framing import SIGNATURE, SIGNED, V2

KEY_LENGTH = 32
"""Bytes of a key (MAVLink signing)."""
ZERO_KEY = bytes(KEY_LENGTH)
"""What PX4 (main of 2026) signs with until it is given a key: anybody's, so it proves and protects nothing."""
EPOCH = 1_420_070_400
"""Start of 2015, unix seconds."""
SECOND = 100_000
"""Steps of 10 us, in which a signature counts time, in a second."""
MINUTE = 60 * SECOND
"""Steps of 10 us in a minute, by which a new sender may be behind (MAVLink signing)."""
LATEST = 2**48 - 1
"""Largest time that the 48 bits of a signature hold."""
_FLAGS_AT = 2
"""Place of the incompatibility flags in a frame of MAVLink 2."""
_HASH = 6
"""Bytes of the hash, which ends a signature, and of the timestamp before it."""


class Refusal(Enum):
    """Why a frame is not believed."""

    UNSIGNED = "unsigned"
    WRONG = "wrong_signature"
    REPEATED = "repeated"
    BEHIND = "clock_behind"


class Signing:
    """One key and its timestamps: that of our next frame, and the newest of every stream received.

    `timestamp` follows the clock (`advance`), our own frames and those received, and never goes back. It is never less
    than that of any accepted frame: kept across a restart (`resume`), this one number rejects every repeated frame.
    """

    def __init__(self, key: bytes, *, link_id: int = 0, timestamp: int = 0) -> None:
        """key: 32 bytes. timestamp: the least to begin with."""
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
        """Tell the wall-clock time, unix seconds; a clock that was set back changes nothing."""
        self._reach(int((unix - EPOCH) * SECOND))

    def resume(self, timestamp: int) -> None:
        """Go on from the timestamp at which an earlier run ended: all frames up to it count as received."""
        self._resumed_at = timestamp
        self._reach(timestamp)

    def sign(self, frame: bytes) -> bytes:
        """One of our MAVLink 2 frames, signed; each gets a timestamp of its own."""
        self._reach(self.timestamp + 1)
        body = _flag_changed(frame) + bytes((self._link_id,)) + self.timestamp.to_bytes(_HASH, "little")
        return body + sha256(self._key + body).digest()[:_HASH]

    def check(self, frame: bytes) -> Refusal | None:
        """Why a signed frame is not to be believed; None: it is, and it counts as heard.

        A stream (system, component, link id) that is new to this process may be a minute behind us, a known one must
        go on.
        """
        if not is_signed_with(self._key, frame):
            return Refusal.WRONG
        stream = (frame[5], frame[6], frame[-SIGNATURE])
        timestamp = int.from_bytes(frame[1 - SIGNATURE : -_HASH], "little")
        newest = self._newest.get(stream)
        # A recorded frame is at most as new as the end of the run that received it. A sender whose clock is behind that
        # is rejected, too, until its clock has passed it, or until it has adopted the timestamp of our own frames.
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
    """Whether a whole frame carries a signature, true or not."""
    return frame[0] == V2 and bool(frame[_FLAGS_AT] & SIGNED)


def without_signature(frame: bytes) -> bytes:
    """The frame as if it had never been signed: for logs, as MAVLink's guide wants them. Its CRC is right again."""
    return _flag_changed(frame[:-SIGNATURE]) if is_signed(frame) else frame


def _flag_changed(frame: bytes) -> bytes:
    """A frame without signature, its flag changed over, and its CRC with it."""
    crc = int.from_bytes(frame[-2:], "little") ^ _flag_in_crc(frame[1])
    flags = bytes((frame[_FLAGS_AT] ^ SIGNED,))
    return frame[:_FLAGS_AT] + flags + frame[_FLAGS_AT + 1 : -2] + crc.to_bytes(2, "little")


@cache
def _flag_in_crc(payload: int) -> int:
    """What the flag does to the CRC of a frame with that many bytes of payload. A CRC is linear: no message's own seed
    need be known, nor its id."""
    covered = bytearray(9 + payload + 1)
    plain = dialect.x25crc(bytes(covered)).crc
    covered[_FLAGS_AT - 1] = SIGNED
    return int(plain ^ dialect.x25crc(bytes(covered)).crc)
