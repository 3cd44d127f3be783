"""Conversion between bytes and MAVLink messages with pymavlink's `all` dialect.

`all` is the only module of pymavlink 2.4.50 with all of DISTANCE_SENSOR, RANGING_BEACON and
CURRENT_MODE.
"""

from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.framing import V1, Frame, frame_at, is_good, must_wait, next_start
from circnav_mav.mav.signing import ZERO_KEY, Refusal, Signing, is_signed_with

Message = Any
"""A pymavlink message object: MAVLink_*_message of the `all` dialect."""
Ids = tuple[int, int]
"""(system, component)."""

_NEVER_SIGNED = dialect.MAVLINK_MSG_ID_RADIO_STATUS
"""RADIO_STATUS is accepted unsigned: telemetry radios insert it and have no key. circnav does not
steer by it."""
_NEVER_LOGGED = dialect.MAVLINK_MSG_ID_SETUP_SIGNING
"""SETUP_SIGNING is not recorded: it contains a secret key."""
_MOST_FAILURES = 64
"""Invalid frame starts after which the rest of a datagram is skipped: this bounds the work that a
hostile datagram causes. An invalid header is also counted, because each search for the next start
takes time."""


def ids(message: Message) -> Ids:
    """Return the system and component id of a message's sender."""
    return message.get_srcSystem(), message.get_srcComponent()


@dataclass(slots=True)
class LinkCounts:
    """Statistics of the bytes received on one link, for troubleshooting."""

    bytes: int = 0
    frames: int = 0
    bad: int = 0
    unknown: int = 0
    version_1: int = 0
    signed: int = 0
    """Signed frames. Without a key of our own, frames signed with the all-zero key are not
    counted."""
    zero_key: int = 0
    has_key: bool = False
    systems: set[tuple[int, int]] = field(default_factory=set)
    refused: Counter[str] = field(default_factory=Counter)
    """Number of unauthenticated frames by reason."""

    def describe(self) -> str:
        """Return one line: rejected frames, then bytes, frames, errors, systems and MAVLink version
        received."""
        if not self.bytes:
            return "0 bytes received"
        systems = (
            ", ".join(f"{system}/{component}" for system, component in sorted(self.systems))
            or "none"
        )
        versions = "none" if not self.frames else "1 only" if self.version_1 == self.frames else "2"
        line = (
            f"received {self.bytes} bytes, {self.frames} frames, {self.bad} CRC or framing errors, "
            f"system/component ids: {systems}, MAVLink version: {versions}"
        )
        if self.signed and not self.has_key:
            return (
                f"{line}; {self.signed} of the frames are signed, and ours may be rejected: set"
                " signing.key_file"
            )
        return f"{self._distrust()}; {line}" if self.refused else line

    def _distrust(self) -> str:
        why = ", ".join(f"{count} {reason}" for reason, count in self.refused.items())
        if self.refused[Refusal.UNSIGNED.value] + self.refused[Refusal.WRONG.value] == self.frames:
            return (
                f"every frame received is unsigned or wrongly signed ({why}): check"
                " signing.key_file"
            )
        return f"frames rejected by their signature: {why}"


class Decoder:
    """Decoder for a single link. Datagrams are decoded separately. In a byte stream (TCP, serial),
    an incomplete frame is kept until the rest arrives."""

    def __init__(
        self,
        *,
        stream: bool = False,
        wanted: Collection[int] | None = None,
        signing: Signing | None = None,
        accept_unsigned: bool = False,
    ) -> None:
        """wanted: message ids to decode, None for all. Frames with other ids are only checked and
        counted.
        signing: authentication of the frames. None: all frames are accepted.
        accept_unsigned: accept unsigned frames beside the signed ones.
        """
        if dialect.MAVLINK_IGNORE_CRC:
            raise ValueError(
                "MAVLINK_IGNORE_CRC is set in the environment: unset it, frames must be checked"
            )
        self._dialect = dialect.MAVLink(None)
        self._stream = stream
        self._wanted = dialect.mavlink_map.keys() if wanted is None else wanted
        self._signing = signing
        self._accept_unsigned = accept_unsigned
        self._tail = b""
        self.counts = LinkCounts(has_key=signing is not None)
        self.frames: list[bytes] = []
        """Accepted frames of the newest call, for the recorder. Frames with unknown ids are
        included, SETUP_SIGNING is not."""
        self.behind = False
        """True if a frame of the newest call was rejected only because of its sender's clock."""

    def decode(self, received: bytes) -> list[Message]:
        """Return the messages of one datagram or chunk. Damage and unknown ids are counted, never
        raised."""
        self.counts.bytes += len(received)
        self.frames = []
        self.behind = False
        messages: list[Message] = []
        for frame, data in self._valid_frames(self._tail + received):
            self._count(frame, data)
            if self._is_authentic(frame, data) and frame.ident in self._wanted:
                messages += self._read(data)
        return messages

    def _valid_frames(self, buffer: bytes) -> Iterator[tuple[Frame, bytes]]:
        """Yield the frames with a valid CRC and their bytes. Count damage, and keep the incomplete
        frame at the end of a stream."""
        at = 0
        failures = 0
        while at < len(buffer) and failures < _MOST_FAILURES:
            frame = frame_at(buffer, at)
            if self._stream and frame is not None and must_wait(buffer, frame):
                break
            if frame is None or not is_good(buffer, frame):
                at = next_start(buffer, at + 1)
                failures = failures + 1
                continue
            data = buffer[at : frame.end]
            at = frame.end
            if frame.understood:
                yield frame, data
            else:
                self.counts.bad += 1
        self.counts.bad += failures > 0
        self._tail = buffer[at:] if self._stream and failures < _MOST_FAILURES else b""

    def _is_authentic(self, frame: Frame, data: bytes) -> bool:
        """Return True if the frame is accepted. Count a rejection."""
        refusal = None
        if self._signing is not None and frame.signed:
            refusal = self._signing.check(data)
        elif (
            self._signing is not None and not self._accept_unsigned and frame.ident != _NEVER_SIGNED
        ):
            refusal = Refusal.UNSIGNED
        if refusal is not None:
            self.counts.refused[refusal.value] += 1
            self.behind |= refusal is Refusal.BEHIND
        elif frame.ident != _NEVER_LOGGED:
            self.frames.append(data)
        return refusal is None

    def _read(self, data: bytes) -> list[Message]:
        """Return the message of a frame with a valid CRC, none if pymavlink still cannot decode
        it."""
        try:
            return [self._dialect.decode(bytearray(data))]
        except dialect.MAVError:
            self.counts.bad += 1
            return []

    def _count(self, frame: Frame, data: bytes) -> None:
        counts = self.counts
        zero_key = frame.signed and not counts.has_key and is_signed_with(ZERO_KEY, data)
        counts.frames += 1
        counts.version_1 += data[0] == V1
        counts.signed += frame.signed and not zero_key
        counts.zero_key += zero_key
        if not frame.known:
            counts.unknown += 1
        # 32: limit of the listed senders, which bounds the memory that a hostile link can fill.
        elif len(counts.systems) < 32:
            counts.systems.add((frame.system, frame.component))


class Encoder:
    """Encoder of MAVLink 2 frames with our ids and sequence number. With a key, the encoder signs
    the frames."""

    def __init__(self, system: int, component: int, signing: Signing | None = None) -> None:
        self.system = system
        self._dialect = dialect.MAVLink(None, srcComponent=component)
        self._signing = signing

    @property
    def ids(self) -> Ids:
        """Our own system and component id."""
        return self.system, self._dialect.srcComponent

    def encode(self, message: Message) -> bytes:
        """Return one frame and advance the sequence number. pymavlink's `pack` does not advance
        it."""
        self._dialect.srcSystem = self.system
        frame = bytes(message.pack(self._dialect))
        self._dialect.seq = (self._dialect.seq + 1) % 256
        return frame if self._signing is None else self._signing.sign(frame)
