"""Decoding of bytes in any chunks with any junk, and encoding of circnav's own frames."""

from itertools import pairwise

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.codec import Decoder, Encoder
from circnav_mav.mav.framing import split_frames

UNKNOWN_ID = 54321
"""An id that is in no dialect of pymavlink 2.4.50."""
HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 129, 4, 4, 3)


def frames(count):
    """Return frames of different lengths (about 21, 37, 51 and 63 bytes) from one sender."""
    speaker = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    made = []
    for i in range(count):
        message = (
            mavlink.MAVLink_heartbeat_message(2, 3, 129, i % 30, 4, 3),
            mavlink.MAVLink_attitude_message(i + 1, 0.1, 0.2, 0.3, 0.4, 0.5, float(i)),
            mavlink.MAVLink_statustext_message(
                6, f"frame number {i}, padded {'.' * (i % 20)}".encode()
            ),
            mavlink.MAVLink_distance_sensor_message(i + 1, 20, 60000, 1000 + i, 4, 0, 24, 0),
        )[i % 4]
        speaker.seq = i % 256
        made.append(bytes(message.pack(speaker)))
    return made


def unknown_frame(ident=UNKNOWN_ID):
    return (
        b"\xfd\x09\x00\x00\x00\x09\x09"
        + ident.to_bytes(3, "little")
        + bytes(range(1, 10))
        + b"\x12\x34"
    )


def decoded(decoder, chunks):
    return [bytes(message.get_msgbuf()) for chunk in chunks for message in decoder.decode(chunk)]


def cut(data, places):
    marks = sorted({0, len(data), *(place % (len(data) + 1) for place in places)})
    return [data[a:b] for a, b in pairwise(marks)]


GOOD = frames(12)
BEAT = GOOD[4]
"""A heartbeat of 21 bytes. Its sequence number 4 is not a message id of MAVLink 1."""
STUMP = bytes((0xFD, 13, 0, 0))
"""First 4 bytes of a frame of 25 bytes. Followed by a heartbeat of 21 bytes, they look like a frame
of an unknown id."""
STARTS = [
    STUMP,
    *(
        b"\xfd",
        b"\xfe",
        b"\xfe\x09",
        b"\xfd\x09\x00",
        b"\xfd\xff\x00\x00",
        b"\x00",
        b"\x00GET / HTTP",
    ),
]
STUMPS = [frame[:length] for frame in GOOD for length in (10, 12, len(frame) - 5)]
PLACES = st.lists(st.integers(0, 10_000), max_size=20)


@given(data=st.lists(st.sampled_from([*GOOD, *STARTS, *STUMPS, unknown_frame()]), max_size=30))
@example(data=[b"\xfd", *GOOD])
@example(data=[*GOOD[:6], b"\xfd\xff\x00\x00", *GOOD[6:]])
@example(data=[STUMP, BEAT, BEAT])
@example(data=[b"\xfe", *[BEAT] * 10, GOOD[2]])  # the length after 0xFE covers most of the datagram
def test_datagram_with_junk_loses_no_good_frame(data):
    """pymavlink's parser takes a stray 0xFD for a frame and loses the 14 good frames within its
    claimed length."""
    assert decoded(Decoder(), [b"".join(data)]) == [piece for piece in data if piece in GOOD]


@given(
    data=st.lists(st.sampled_from([BEAT, STUMP, b"\xfe", b"\x00", unknown_frame()]), max_size=20),
    places=PLACES,
)
def test_damaged_stream_gives_same_messages_in_any_chunks(data, places):
    whole = b"".join(data) + bytes(600)
    assert decoded(Decoder(stream=True), cut(whole, places)) == decoded(
        Decoder(stream=True), [whole]
    )


quiet_junk = st.binary(max_size=40).map(
    lambda data: data.translate(bytes.maketrans(b"\xfd\xfe", b"\x00\x00"))
)
"""Junk without a byte that could start a frame."""


@given(junk=st.lists(quiet_junk, min_size=12, max_size=12), places=PLACES)
def test_junk_between_frames_loses_no_frame_in_any_chunks(junk, places):
    data = b"".join(noise + frame for noise, frame in zip(junk, GOOD, strict=True))
    decoder = Decoder()
    assert decoded(decoder, [data]) == GOOD
    assert decoder.counts.bad == any(junk)
    assert decoded(Decoder(stream=True), cut(data, places)) == GOOD


@pytest.mark.parametrize("start", [b"\xfd", b"\xfe", b"\xfd\xff\x00\x00", STUMP])
def test_false_start_byte_in_stream_loses_no_frame(start):
    first = [BEAT, *GOOD]
    late = frames(40)
    got = decoded(Decoder(stream=True), [start + b"".join(first), *late])
    assert got[: len(first)] == first
    assert set(late[:25]) <= set(got)


def test_unknown_frame_in_stream_needs_following_frame():
    decoder = Decoder(stream=True)
    assert (
        decoded(decoder, cut(b"".join(frame + unknown_frame() for frame in GOOD), range(0, 900, 7)))
        == GOOD
    )
    assert decoder.counts.unknown == 11


@given(index=st.integers(0, 11), at=st.integers(0, 200), bit=st.integers(0, 7))
def test_flipped_bit_loses_only_one_frame(index, at, bit):
    broken = bytearray(GOOD[index])
    broken[at % len(broken)] ^= 1 << bit
    others = GOOD[:index] + GOOD[index + 1 :]
    got = decoded(Decoder(), [b"".join([*GOOD[:index], bytes(broken), *GOOD[index + 1 :]])])
    assert [frame for frame in got if frame in others] == others
    assert bytes(broken) not in got


@given(data=st.binary(max_size=400), stream=st.booleans())
@example(data=b"\xfd", stream=False)
@example(data=b"\xfe\xff" * 200, stream=True)
def test_decoder_never_raises(data, stream):
    decoder = Decoder(stream=stream)
    decoder.decode(data)
    decoder.decode(data)
    assert decoder.counts.bytes == 2 * len(data)


def test_incomplete_datagram_does_not_affect_next_datagram():
    """An incomplete frame at the end of a datagram is lost."""
    decoder = Decoder()
    assert decoded(decoder, [GOOD[0] + GOOD[1][:10]]) == [GOOD[0]]
    assert decoded(decoder, [GOOD[1][10:] + GOOD[2]]) == [GOOD[2]]
    assert decoder.counts.bad == 2


VERSION_1 = bytes(HEARTBEAT.pack(mavlink.MAVLink(None, srcSystem=7), force_mavlink1=True))


COUNTS = {
    "nothing": (b"", "0 bytes received", 0),
    "no frame": (
        b"GET / HTTP/1.1\r\n\r\n",
        "received 18 bytes, 0 frames, 1 CRC or framing errors, {}: none, {}: none",
        0,
    ),
    "version 1": (
        VERSION_1,
        "received 17 bytes, 1 frames, 0 CRC or framing errors, {}: 7/0, {}: 1 only",
        0,
    ),
    "junk and an unknown id": (
        b"\0" + BEAT + unknown_frame(),
        "received 43 bytes, 2 frames, 1 CRC or framing errors, {}: 7/1, {}: 2",
        1,
    ),
}


@pytest.mark.parametrize(("data", "words", "unknown"), COUNTS.values(), ids=COUNTS)
def test_decoder_counts_are_described_in_one_line(data, words, unknown):
    decoder = Decoder()
    decoder.decode(data)
    assert decoder.counts.describe() == words.format("system/component ids", "MAVLink version")
    assert decoder.counts.unknown == unknown


def test_flood_of_ids_does_not_grow_counters():
    decoder = Decoder()
    for ident in range(70_000, 73_000):
        decoder.decode(unknown_frame(ident=ident))
    for system in range(1, 251):
        decoder.decode(
            bytes(HEARTBEAT.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=system)))
        )
    assert decoder.counts.unknown == 3000
    assert decoder.counts.frames == 3250
    assert len(decoder.counts.systems) == 32
    assert len(decoder.frames) == 1


def test_decoder_skips_rest_of_datagram_after_64_false_starts():
    """A false start is a start byte without a good frame. After 64 of them the rest of the datagram
    is dropped, and the next datagram is read."""
    decoder = Decoder()
    for start in (b"\xfd\x01\x00", b"\xfd", b"\xfd\xff\x02", b"\xfe"):
        assert decoded(decoder, [start * 63 + GOOD[0]]) == [GOOD[0]]
        assert decoded(decoder, [start * 64 + GOOD[0]]) == []
    assert decoded(decoder, [GOOD[1]]) == [GOOD[1]]


def test_unwanted_message_is_logged_but_not_decoded():
    """A message of an unknown id is treated in the same way."""
    decoder = Decoder(wanted={mavlink.MAVLINK_MSG_ID_HEARTBEAT})
    assert [m.get_type() for m in decoder.decode(b"".join([b"\x00", *GOOD, unknown_frame()]))] == [
        "HEARTBEAT"
    ] * 3
    assert decoder.counts.frames == 13
    assert decoder.frames == [*GOOD, unknown_frame()]
    broken = bytearray(GOOD[1])
    broken[15] ^= 1
    assert decoder.decode(bytes(broken)) == []
    assert (decoder.counts.bad, decoder.frames) == (2, [])


@pytest.mark.parametrize(
    ("flags", "signature", "understood"),
    [(0x01, bytes(13), True), (0x02, b"", False), (0x03, bytes(13), False)],
)
def test_frame_with_unknown_flags_is_dropped(flags, signature, understood):
    """The frame contains payload, CRC and a signature of 13 bytes, which the log keeps. 50 is the
    CRC_EXTRA of HEARTBEAT."""
    body = GOOD[0][1:2] + bytes((flags,)) + GOOD[0][3:-2]
    flagged = (
        b"\xfd" + body + mavlink.x25crc(body + bytes((50,))).crc.to_bytes(2, "little") + signature
    )
    expected = [flagged, GOOD[1]] if understood else [GOOD[1]]
    decoder = Decoder()
    assert decoded(decoder, [flagged + GOOD[1]]) == expected
    assert decoder.frames == expected


@pytest.mark.parametrize("stream", [False, True])
@pytest.mark.parametrize("flags", [0x02, 0x04, 0x06, 0x40])
def test_decoder_discards_payload_of_frame_with_unknown_flag(flags, stream):
    """The payload of a TUNNEL is a complete HEARTBEAT of the vehicle in another mode, which must
    not be decoded. The flags 0x02 and 0x04 of pymavlink's extended header append 3 and 4 bytes."""
    extension = bytes(3 * bool(flags & 0x02) + 4 * bool(flags & 0x04))
    payload = (bytes((1, 0, 0, 0, len(BEAT))) + BEAT).ljust(133, b"\x00")
    head = bytes((133, flags, 0, 7, 44, 191)) + (385).to_bytes(3, "little") + extension
    extra = bytes((mavlink.MAVLink_tunnel_message.crc_extra,))
    crc = mavlink.x25crc(head + payload + extra).crc.to_bytes(2, "little")
    decoder = Decoder(stream=stream)
    assert decoded(decoder, [b"\xfd" + head + payload + crc + GOOD[1]]) == [GOOD[1]]
    assert (decoder.counts.bad, decoder.frames) == (1, [GOOD[1]])


def test_decoder_refuses_mavlink_ignore_crc(monkeypatch):
    monkeypatch.setattr(mavlink, "MAVLINK_IGNORE_CRC", True)
    with pytest.raises(ValueError, match="MAVLINK_IGNORE_CRC"):
        Decoder()


def test_splitting_restores_encoded_frames():
    encoder = Encoder(3, 191)
    out = [encoder.encode(HEARTBEAT) for _ in range(3)]
    assert split_frames(b"".join(out + GOOD)) == out + GOOD


def test_encoder_numbers_frames_of_its_system():
    encoder = Encoder(3, 191)
    out = [encoder.encode(HEARTBEAT) for _ in range(258)]
    assert all(frame[0] == 0xFD and frame[5:7] == bytes((3, 191)) for frame in out)
    assert [frame[4] for frame in out] == [i % 256 for i in range(258)]
    encoder.system = 9
    assert encoder.encode(HEARTBEAT)[5] == 9
    assert encoder.system == 9
