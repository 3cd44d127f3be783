"""The search for frames in bytes: the fast search finds the same frames as a search at every byte,
and unknown frames take little time."""

import itertools
import sys

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.codec import Decoder
from circnav_mav.mav.framing import MAGICS, frame_at, is_good

IDS = sorted(mavlink.mavlink_map)


def right_crc(frame):
    """Return the right CRC of a complete frame without signature."""
    ident = int.from_bytes(frame[7:10], "little") if frame[0] == 0xFD else frame[5]
    return mavlink.x25crc(
        frame[1:-2] + bytes((mavlink.mavlink_map[ident].crc_extra,))
    ).crc.to_bytes(2, "little")


def good_by_every_byte(buffer, frame):
    """Reference for `is_good`: check a frame by the definition, byte by byte."""
    if frame.end > len(buffer):
        return False
    body = buffer[frame.start : frame.end - 13 if frame.signed else frame.end]
    if frame.known:
        return body[-2:] == right_crc(body)
    if not frame.understood:
        return False
    if frame.end < len(buffer) and buffer[frame.end] not in MAGICS:
        return False
    inside = (frame_at(buffer, at) for at in range(frame.start + 1, frame.end))
    return not any(
        inner is not None and inner.known and good_by_every_byte(buffer, inner) for inner in inside
    )


@st.composite
def known(draw, longest=40):
    """Draw a good frame of any length, version and known id, signed or not."""
    ident = draw(st.sampled_from(IDS))
    payload = draw(st.binary(max_size=longest))
    if ident < 256 and draw(st.booleans()):
        frame = bytes((0xFE, len(payload), 1, 2, 3, ident)) + payload + bytes(2)
        return frame[:-2] + right_crc(frame)
    signed = draw(st.booleans())
    frame = (
        bytes((0xFD, len(payload), signed, 0, 1, 2, 3))
        + ident.to_bytes(3, "little")
        + payload
        + bytes(2)
    )
    return frame[:-2] + right_crc(frame) + bytes(13 * signed)


SPICY = st.lists(
    st.sampled_from([0xFD, 0xFE, 0, 1, 2, 9, 11, 12, 60, 100, 132, 255]) | st.integers(0, 255),
    max_size=40,
).map(bytes)
"""Bytes with many start bytes of frames."""


@st.composite
def unknown(draw):
    """Draw a frame of an unknown id with any content. Its length field may exceed the bytes that
    follow."""
    inside = b"".join(draw(st.lists(known() | SPICY, max_size=4)))[:255]
    length = min(len(inside) + draw(st.sampled_from([0, 0, 0, 1, 5, 30])), 255)
    return (
        bytes((0xFD, length, draw(st.integers(0, 1)), 0, 1, 9, 9, 0x31, 0xD4, 0))
        + inside
        + draw(st.binary(max_size=15))
    )


MIXED = st.lists(known() | unknown() | SPICY | st.binary(max_size=30), max_size=6).map(b"".join)


@settings(max_examples=300)
@given(buffer=MIXED)
@example(buffer=b"\xfe" * 300)
@example(buffer=b"\xfd\x00\x00" * 100)
@example(buffer=b"\xfd\x04\xfd" + b"\xfd" * 9 + bytes(4))
def test_fast_frame_check_equals_reference_at_every_byte(buffer):
    for at in range(len(buffer)):
        frame = frame_at(buffer, at)
        if frame is not None:
            assert is_good(buffer, frame) == good_by_every_byte(buffer, frame), at


@settings(max_examples=300)
@given(frame=known(longest=255))
def test_random_frame_with_right_crc_never_raises(frame):
    """The decoder rejects random bytes by their CRC, so only frames with a right CRC reach the code
    behind it."""
    decoder = Decoder()
    messages = decoder.decode(frame)
    assert decoder.counts.frames == 1
    assert len(messages) + decoder.counts.bad == 1
    for message in messages:
        ident = frame[5] if frame[0] == 0xFE else int.from_bytes(frame[7:10], "little")
        assert (message.get_msgId(), bool(str(message))) == (ident, True)


def cost(data):
    """Return the number of Python lines executed to read some bytes, which is the same on every
    machine under any load."""
    decoder = Decoder(wanted=())
    lines = itertools.count()

    def trace(frame, event, argument):
        if event == "line":
            next(lines)
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        decoder.decode(data)
    finally:
        sys.settrace(before)
    return next(lines)


@pytest.mark.parametrize("payload", [bytes(255), b"\xfd" * 255], ids=["zeros", "false starts"])
def test_long_frames_of_unknown_ids_are_read_quickly(payload):
    """A flood of such frames must not delay the ranges."""
    head = bytes((0, 0, 1, 9, 9, 0x31, 0xD4, 0))
    few = payload[:9]
    long, short = (
        bytes((0xFD, len(inside))) + head + inside + b"\x12\x34" for inside in (payload, few)
    )
    assert cost(long * 20) < 4 * cost(short * 20)


@pytest.mark.parametrize(
    "data",
    [
        bytes(65_000),
        *(
            start * (65_000 // len(start))
            for start in (b"\xfd", b"\xfe", b"\xfd\xff", b"\xfd\x00\x02")
        ),
    ],
    ids=["zeros", "fd", "fe", "fd ff", "fd 00 02"],
)
def test_long_datagram_of_false_starts_is_read_quickly(data):
    """Such datagrams once took 41 ms each and stopped a flight."""
    beat = bytes(
        mavlink.MAVLink_heartbeat_message(2, 3, 129, 4, 4, 3).pack(
            mavlink.MAVLink(None, srcSystem=1)
        )
    )
    assert cost(data) < cost(beat * 50)
