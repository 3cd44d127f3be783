"""Bytes to messages: any chunking, any junk, anything at all; and our own frames."""

from itertools import pairwise

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.codec import Decoder, Encoder
from circnav_mav.mav.framing import split_frames

UNKNOWN_ID = 54321
"""An id that no dialect of pymavlink 2.4.50 has."""


def frames(count, start=0):
    """Frames of mixed lengths (21, 37, 51 and 63 bytes or so) of one speaker, and how each is recognised."""
    speaker = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    made = []
    for i in range(start, start + count):
        message = (
            mavlink.MAVLink_heartbeat_message(2, 3, 129, i % 30, 4, 3),
            mavlink.MAVLink_attitude_message(i + 1, 0.1, 0.2, 0.3, 0.4, 0.5, float(i)),
            mavlink.MAVLink_statustext_message(6, f"frame number {i}, padded {'.' * (i % 20)}".encode()),
            mavlink.MAVLink_distance_sensor_message(i + 1, 20, 60000, 1000 + i, 4, 0, 24, 0),
        )[i % 4]
        speaker.seq = i % 256
        made.append(bytes(message.pack(speaker)))
    return made


def unknown_frame(length=9, seq=0, ident=UNKNOWN_ID):
    payload = bytes(range(1, length + 1))
    return bytes((0xFD, length, 0, 0, seq, 9, 9)) + ident.to_bytes(3, "little") + payload + b"\x12\x34"


def decoded(decoder, chunks):
    return [bytes(message.get_msgbuf()) for chunk in chunks for message in decoder.decode(chunk)]


def cut(data, places):
    marks = sorted({0, len(data), *(place % (len(data) + 1) for place in places)})
    return [data[a:b] for a, b in pairwise(marks)]


GOOD = frames(12)


@given(places=st.lists(st.integers(0, 10_000), max_size=20))
def test_a_stream_with_ids_that_nobody_knows_is_read_alike_in_any_chunks(places):
    data = [frame for pair in zip(GOOD, [unknown_frame(seq=i) for i in range(12)], strict=True) for frame in pair]
    decoder = Decoder(stream=True)
    assert decoded(decoder, cut(b"".join(data), places)) == GOOD
    assert decoder.counts.unknown == 11, "the last one is believed only when another frame follows it"


quiet_junk = st.binary(max_size=40).map(lambda data: data.translate(bytes.maketrans(b"\xfd\xfe", b"\x00\x00")))
"""Junk without a byte that could start a frame."""


@given(junk=st.lists(quiet_junk, min_size=12, max_size=12), places=st.lists(st.integers(0, 10_000), max_size=20))
def test_junk_between_the_frames_loses_none_of_a_datagram_nor_of_a_stream_in_any_chunks(junk, places):
    data = b"".join(noise + frame for noise, frame in zip(junk, GOOD, strict=True))
    decoder = Decoder()
    assert decoded(decoder, [data]) == GOOD
    assert decoder.counts.bad == any(junk)
    assert decoded(Decoder(stream=True), cut(data, places)) == GOOD


@pytest.mark.parametrize("start", [b"\xfd", b"\xfe", b"\xfd\xff\x00\x00"])
def test_a_false_start_costs_no_frame_of_a_stream_once_its_claimed_length_has_come(start):
    late = frames(40)
    got = decoded(Decoder(stream=True), [start + b"".join(GOOD), *late])
    assert got[: len(GOOD)] == GOOD
    assert set(late[:25]) <= set(got)


@given(index=st.integers(0, 11), at=st.integers(0, 200), bit=st.integers(0, 7))
def test_a_flipped_bit_costs_at_most_the_frame_it_is_in(index, at, bit):
    broken = bytearray(GOOD[index])
    broken[at % len(broken)] ^= 1 << bit
    others = GOOD[:index] + GOOD[index + 1 :]
    got = decoded(Decoder(), [b"".join([*GOOD[:index], bytes(broken), *GOOD[index + 1 :]])])
    assert [frame for frame in got if frame in others] == others
    assert bytes(broken) not in got


SPEAKER = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
SPEAKER.seq = 3  # no known MAVLink 1 id
HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 129, 4, 4, 3)
BEAT = bytes(HEARTBEAT.pack(SPEAKER))
"""A heartbeat of 21 bytes."""


def test_a_stump_whose_claimed_end_is_the_next_frames_end_swallows_nothing():
    """4 bytes of a 25 byte frame, then 21 bytes of another: together they look like a frame of an unknown id."""
    stump = bytes((0xFD, 13, 0, 0))
    assert decoded(Decoder(), [stump + BEAT + BEAT]) == [BEAT] * 2
    assert decoded(Decoder(stream=True), [stump + BEAT, BEAT, bytes(300)]) == [BEAT] * 2


def test_a_stray_fe_that_claims_a_whole_datagram_swallows_nothing():
    """0xFE claims 253 + 8 bytes, with the next frame's sequence number for its id."""
    rest = bytes(mavlink.MAVLink_statustext_message(6, b"x" * 37).pack(mavlink.MAVLink(None, srcSystem=7)))
    datagram = b"\xfe" + BEAT * 10 + rest
    assert len(datagram) == 261
    assert decoded(Decoder(), [datagram]) == [BEAT] * 10 + [rest]


@given(
    data=st.lists(st.sampled_from([BEAT, bytes((0xFD, 13, 0, 0)), b"\xfe", b"\x00", unknown_frame()]), max_size=20),
    places=st.lists(st.integers(0, 10_000), max_size=10),
)
def test_even_a_damaged_stream_is_read_alike_in_any_chunks(data, places):
    whole = b"".join(data) + bytes(600)
    assert decoded(Decoder(stream=True), cut(whole, places)) == decoded(Decoder(stream=True), [whole])


STARTS = [b"\xfd", b"\xfe", b"\xfe\x09", b"\xfd\x09\x00", b"\xfd\xff\x00\x00", bytes((0xFD, 13, 0, 0)), b"\x00"]
STUMPS = [frame[:length] for frame in GOOD for length in (10, 12, len(frame) - 5)]


@given(data=st.lists(st.sampled_from([*GOOD, *STARTS, *STUMPS]), max_size=30))
@example(data=[b"\xfd", *GOOD])
@example(data=[*GOOD[:6], b"\xfd\xff\x00\x00", *GOOD[6:]])
def test_no_good_frame_of_a_datagram_is_lost_to_false_starts_and_stumps_round_it(data):
    """The parser of pymavlink loses the 14 frames inside the length that a stray 0xFD claims (mavlink.md, rule 2)."""
    assert decoded(Decoder(), [b"".join(data)]) == [piece for piece in data if piece in GOOD]


@given(data=st.binary(max_size=400), stream=st.booleans())
@example(data=b"\xfd", stream=False)
@example(data=b"\xfe\xff" * 200, stream=True)
def test_no_bytes_whatever_raise(data, stream):
    decoder = Decoder(stream=stream)
    decoder.decode(data)
    decoder.decode(data)
    assert decoder.counts.bytes == 2 * len(data)


@settings(max_examples=300)
@given(
    ident=st.sampled_from(sorted(mavlink.mavlink_map)),
    payload=st.binary(min_size=0, max_size=255),
    version=st.sampled_from([1, 2]),
    source=st.tuples(st.integers(0, 255), st.integers(0, 255)),
)
def test_no_payload_with_a_right_crc_raises(ident, payload, version, source):
    """Fuzz with wrong CRCs and you hit nothing."""
    if version == 2 or ident > 255:
        body = b"\xfd" + bytes((len(payload), 0, 0, 0, *source)) + ident.to_bytes(3, "little") + payload
    else:
        body = b"\xfe" + bytes((len(payload), 0, *source, ident)) + payload
    crc = mavlink.x25crc(body[1:] + bytes((mavlink.mavlink_map[ident].crc_extra,))).crc
    decoder = Decoder()
    messages = decoder.decode(body + crc.to_bytes(2, "little"))
    assert decoder.counts.frames == 1
    assert [message.get_msgId() for message in messages] in ([ident], [])
    assert len(messages) + decoder.counts.bad == 1
    for message in messages:
        str(message)


def test_a_datagram_stands_for_itself():
    """Half a frame at its end is lost and does not spoil the next one."""
    decoder = Decoder()
    assert decoded(decoder, [GOOD[0] + GOOD[1][:10]]) == [GOOD[0]]
    assert decoded(decoder, [GOOD[1][10:] + GOOD[2]]) == [GOOD[2]]
    assert decoder.counts.bad == 2


def test_counts_are_facts_for_a_person():
    decoder = Decoder()
    assert decoder.counts.describe() == "0 bytes heard"
    data = b"\x00\x01" + b"".join(GOOD[:3]) + unknown_frame()
    decoder.decode(data)
    counts = decoder.counts
    assert (counts.bytes, counts.frames, counts.bad, counts.unknown, counts.version_1) == (len(data), 4, 1, 1, 0)
    assert counts.systems == {(7, 1)}
    assert counts.describe() == (
        f"heard {len(data)} bytes, 4 frames, 1 CRC or framing errors, system/component ids: 7/1, MAVLink version: 2"
    )


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", "system/component ids: none, MAVLink version: none"),
        (bytes(HEARTBEAT.pack(SPEAKER, force_mavlink1=True)), "MAVLink version: 1 only"),
        (bytes(HEARTBEAT.pack(SPEAKER, force_mavlink1=True)) + GOOD[0], "MAVLink version: 2"),
    ],
    ids=["no frame", "version 1", "both"],
)
def test_a_peer_that_speaks_version_1_only_is_told_from_one_that_speaks_both_or_none(data, words):
    decoder = Decoder()
    decoder.decode(data)
    assert decoder.counts.describe().endswith(words)


def test_a_flood_of_ids_and_systems_leaves_the_counters_small():
    decoder = Decoder()
    for ident in range(70_000, 73_000):
        decoder.decode(unknown_frame(ident=ident))
    for system in range(1, 251):
        decoder.decode(bytes(HEARTBEAT.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=system))))
    assert decoder.counts.unknown == 3000
    assert decoder.counts.frames == 3250
    assert len(decoder.counts.systems) == 32
    assert len(decoder.frames) == 1


def test_a_hostile_datagram_is_given_up_after_64_false_starts():
    """Work is bounded: what follows in that datagram is lost, the next datagram is not."""
    decoder = Decoder()
    for start in (b"\xfd\x01\x00", b"\xfd", b"\xfd\xff\x02", b"\xfe"):
        assert decoded(decoder, [start * 63 + GOOD[0]]) == [GOOD[0]]
        assert decoded(decoder, [start * 64 + GOOD[0]]) == []
    assert decoded(decoder, [GOOD[1]]) == [GOOD[1]]


def test_what_nobody_reads_is_checked_counted_and_kept_for_the_log_but_not_decoded():
    """With ids that nobody knows."""
    decoder = Decoder(wanted={mavlink.MAVLINK_MSG_ID_HEARTBEAT})
    assert [m.get_type() for m in decoder.decode(b"".join([b"\x00", *GOOD, unknown_frame()]))] == ["HEARTBEAT"] * 3
    assert decoder.counts.frames == 13
    assert decoder.frames == [*GOOD, unknown_frame()]
    broken = bytearray(GOOD[1])
    broken[15] ^= 1
    assert decoder.decode(bytes(broken)) == []
    assert (decoder.counts.bad, decoder.frames) == (2, [])


@pytest.mark.parametrize(
    ("flags", "signature", "understood"), [(0x01, bytes(13), True), (0x02, b"", False), (0x03, bytes(13), False)]
)
def test_a_signed_frame_is_read_and_one_with_flags_that_we_do_not_understand_is_dropped(flags, signature, understood):
    """Payload, CRC, then 13 bytes of signature, which is kept for the log. 50: CRC_EXTRA of HEARTBEAT."""
    body = GOOD[0][1:2] + bytes((flags,)) + GOOD[0][3:-2]
    flagged = b"\xfd" + body + mavlink.x25crc(body + bytes((50,))).crc.to_bytes(2, "little") + signature
    expected = [flagged, GOOD[1]] if understood else [GOOD[1]]
    decoder = Decoder()
    assert decoded(decoder, [flagged + GOOD[1]]) == expected
    assert decoder.frames == expected


def test_frames_whose_crc_is_not_checked_are_refused_at_the_start(monkeypatch):
    monkeypatch.setattr(mavlink, "MAVLINK_IGNORE_CRC", True)
    with pytest.raises(ValueError, match="MAVLINK_IGNORE_CRC"):
        Decoder()


def test_our_frames_are_mavlink_2_in_our_name_with_a_running_sequence_and_are_cut_apart_again():
    encoder = Encoder(3, 191)
    out = [encoder.encode(HEARTBEAT) for _ in range(258)]
    assert all(frame[0] == 0xFD and frame[5:7] == bytes((3, 191)) for frame in out)
    assert [frame[4] for frame in out] == [i % 256 for i in range(258)]
    assert split_frames(b"".join(out + GOOD)) == out + GOOD
    encoder.system = 9
    assert encoder.encode(HEARTBEAT)[5] == 9
    assert encoder.system == 9
