"""Bytes to MAVLink messages and back, over pymavlink's `all` dialect.

`all` is the only module of pymavlink 2.4.50 that knows DISTANCE_SENSOR, RANGING_BEACON and CURRENT_MODE together.
pymavlink's own stream parser throws away the claimed length of a bad frame, and with it the good frames inside; the
reader here steps one byte past a bad start instead, so that a stray byte costs nothing.
"""

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.signing import Refusal, Signing, is_signed

Message = Any
"""A pymavlink message object: MAVLink_*_message of the `all` dialect."""

_V1, _V2 = 0xFE, 0xFD
_SIGNED = 0x01
_NEVER_SIGNED = dialect.MAVLINK_MSG_ID_RADIO_STATUS
"""Telemetry radios put it into the stream and have no key; nothing here is steered by it."""
_NEVER_LOGGED = dialect.MAVLINK_MSG_ID_SETUP_SIGNING
"""Carries somebody's key."""
_MOST_SYSTEMS = 32
_MOST_FAILURES = 64
"""Failed starts after which the rest of a datagram is left: bounds the work that a hostile one can cause."""


@dataclass(slots=True)
class LinkCounts:
    """What came in on one link: the facts that a person needs when nothing works."""

    bytes: int = 0
    frames: int = 0
    bad: int = 0
    unknown: int = 0
    version_1: int = 0
    signed: int = 0
    has_key: bool = False
    systems: set[tuple[int, int]] = field(default_factory=set)
    refused: Counter[str] = field(default_factory=Counter)
    """Frames by the reason why their signature, or its absence, is not believed."""

    def describe(self) -> str:
        """One line: what was refused; bytes, frames, errors, systems and MAVLink version heard."""
        if not self.bytes:
            return "0 bytes heard"
        systems = ", ".join(f"{system}/{component}" for system, component in sorted(self.systems)) or "none"
        versions = "none" if not self.frames else "1 only" if self.version_1 == self.frames else "2"
        heard = (
            f"heard {self.bytes} bytes, {self.frames} frames, {self.bad} CRC or framing errors, "
            f"system/component ids: {systems}, MAVLink version: {versions}"
        )
        if self.signed and not self.has_key:
            return f"{heard}; {self.signed} of the frames are signed, and ours may be refused: give [signing] key_file"
        return f"{self._distrust()}; {heard}" if self.refused else heard

    def _distrust(self) -> str:
        why = ", ".join(f"{count} {reason}" for reason, count in self.refused.items())
        if self.refused[Refusal.UNSIGNED.value] + self.refused[Refusal.WRONG.value] == self.frames:
            return f"every frame heard is unsigned or wrongly signed ({why}): check signing.key_file"
        return f"frames refused for their signature: {why}"


class Decoder:
    """Reads one link. A datagram stands for itself; a byte stream (TCP, serial) carries its tail to the next call."""

    def __init__(
        self,
        *,
        stream: bool = False,
        wanted: Collection[int] | None = None,
        signing: Signing | None = None,
        accept_unsigned: bool = False,
    ) -> None:
        """wanted: message ids worth decoding, None for all; the others are checked and counted only. signing: whom to
        believe, None for everybody. accept_unsigned: believe unsigned frames beside the signed."""
        if dialect.MAVLINK_IGNORE_CRC:
            raise ValueError("MAVLINK_IGNORE_CRC is set in the environment: unset it, frames must be checked")
        self._dialect = dialect.MAVLink(None)
        self._stream = stream
        self._wanted = dialect.mavlink_map.keys() if wanted is None else wanted
        self._signing = signing
        self._accept_unsigned = accept_unsigned
        self._tail = b""
        self.counts = LinkCounts(has_key=signing is not None)
        self.frames: list[bytes] = []
        """The whole frames of the newest call that are believed, unknown ids included, for the recorder."""
        self.behind = False
        """Whether a frame of the newest call was refused for its sender's clock alone."""

    def decode(self, data: bytes) -> list[Message]:
        """The messages of one datagram or chunk; damage and unknown ids are counted, never raised."""
        self.counts.bytes += len(data)
        buffer = self._tail + data if self._tail else data
        self.frames, self.behind = [], False
        messages, at, failures = [], 0, 0
        while at < len(buffer) and failures < _MOST_FAILURES:
            end = _frame_end(buffer, at)
            if self._stream and end is not None and _must_wait(buffer, at, end):
                break
            if end is None or not _whole(buffer, at, end):
                at, failures = at + 1, failures + (end is not None or not failures)
                continue
            frame, at = buffer[at:end], end
            self._count(frame)
            if not self._believed(frame):
                continue
            if _message_id(frame) in self._wanted and (message := self._read(frame)) is not None:
                messages.append(message)
        self.counts.bad += failures > 0
        self._tail = buffer[at:] if self._stream and failures < _MOST_FAILURES else b""
        return messages

    def _believed(self, frame: bytes) -> bool:
        """Whether the frame counts; its refusal is counted, too."""
        refusal = self._refusal(frame)
        if refusal is not None:
            self.counts.refused[refusal.value] += 1
            self.behind |= refusal is Refusal.BEHIND
        elif _message_id(frame) != _NEVER_LOGGED:
            self.frames.append(frame)
        return refusal is None

    def _refusal(self, frame: bytes) -> Refusal | None:
        if self._signing is None:
            return None
        if is_signed(frame):
            return self._signing.check(frame)
        exempt = self._accept_unsigned or _message_id(frame) == _NEVER_SIGNED
        return None if exempt else Refusal.UNSIGNED

    def _read(self, frame: bytes) -> Message | None:
        """The message in a frame whose CRC is right, None if pymavlink cannot read it all the same."""
        try:
            return self._dialect.decode(bytearray(frame))
        except dialect.MAVError:
            self.counts.bad += 1
            return None

    def _count(self, frame: bytes) -> None:
        counts = self.counts
        counts.frames += 1
        counts.version_1 += frame[0] == _V1
        counts.signed += is_signed(frame)
        if _message_id(frame) not in dialect.mavlink_map:
            counts.unknown += 1
        elif len(counts.systems) < _MOST_SYSTEMS:
            counts.systems.add((frame[5], frame[6]) if frame[0] == _V2 else (frame[3], frame[4]))


def _message_id(frame: bytes) -> int:
    return frame[7] | frame[8] << 8 | frame[9] << 16 if frame[0] == _V2 else frame[5]


def _must_wait(buffer: bytes, at: int, end: int) -> bool:
    """Whether a stream has not yet shown all that decides on this frame: the rest of it, or, for an unknown id, the
    byte behind it."""
    return end > len(buffer) or (end == len(buffer) and _message_id(buffer[at:end]) not in dialect.mavlink_map)


def _whole(buffer: bytes, at: int, end: int) -> bool:
    """Whether a good frame lies here: its CRC is right, or, for an id that the dialect does not know and whose CRC
    cannot be told, another frame or the end follows and no good frame lies inside."""
    if end > len(buffer):
        return False
    if _message_id(buffer[at:end]) in dialect.mavlink_map:
        return _good(buffer, at, end)
    if end < len(buffer) and buffer[end] not in (_V1, _V2):
        return False
    starts = (inner for inner in range(at + 1, end) if buffer[inner] in (_V1, _V2))
    return not any((stop := _frame_end(buffer, inner)) and _good(buffer, inner, stop) for inner in starts)


def _good(buffer: bytes, at: int, end: int) -> bool:
    """Whether the frame of a known id that lies here is all there and has the right CRC."""
    if end > len(buffer):
        return False
    frame = buffer[at:end]
    kind = dialect.mavlink_map.get(_message_id(frame))
    if kind is None:
        return False
    tail = len(frame) - (15 if frame[0] == _V2 and frame[2] & _SIGNED else 2)
    crc = dialect.x25crc(frame[1:tail] + bytes((kind.crc_extra,))).crc
    return bool(crc == frame[tail] | frame[tail + 1] << 8)


def _frame_end(buffer: bytes, at: int) -> int | None:
    """Where the frame that starts here claims to end, past the buffer if not all of it is there; None: no frame."""
    magic, left = buffer[at], len(buffer) - at
    if magic not in (_V1, _V2):
        return None
    if left < 3:
        return len(buffer) + 1
    if magic == _V1:
        return at + buffer[at + 1] + 8
    flags = buffer[at + 2]
    return None if flags & ~_SIGNED else at + buffer[at + 1] + (25 if flags else 12)


def split_frames(data: bytes) -> list[bytes]:
    """Our own output cut into its frames; it is whole by construction."""
    frames, at = [], 0
    while at < len(data) and (end := _frame_end(data, at)) is not None:
        frames.append(data[at:end])
        at = end
    return frames


class Encoder:
    """Packs messages as MAVLink 2 in our name, with our own running sequence number; signs them if it can."""

    def __init__(self, system: int, component: int, signing: Signing | None = None) -> None:
        self._dialect = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self._signing = signing

    @property
    def system(self) -> int:
        """System id that frames go out under."""
        return int(self._dialect.srcSystem)

    @system.setter
    def system(self, system: int) -> None:
        self._dialect.srcSystem = system

    def encode(self, message: Message) -> bytes:
        """One frame. `pack` does not advance the sequence number: that is done here."""
        frame = bytes(message.pack(self._dialect))
        self._dialect.seq = (self._dialect.seq + 1) % 256
        return frame if self._signing is None else self._signing.sign(frame)
