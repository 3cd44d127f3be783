"""Signatures, compared with pymavlink's in both directions; rules for their timestamps; and pilots
with a key."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.codec import Decoder
from circnav_mav.mav.framing import split_frames
from circnav_mav.mav.signing import (
    EPOCH,
    LATEST,
    MINUTE,
    Refusal,
    Signing,
    is_signed,
    without_signature,
)
from circnav_mav.pilot import RANGING, Pilot
from tests.flight.signed import KEY, OTHER, voice
from tests.frames import output
from tests.mav.test_codec import decoded
from tests.rig import heartbeat, rig_mission

NOW = 37_000_000_000_000
"""A signing timestamp of the year 2026, 10 us since 2015."""
MESSAGES = (
    mavlink.MAVLink_heartbeat_message(2, 3, 129, 4, 4, 3),
    mavlink.MAVLink_attitude_message(77, 0.1, -0.2, 3.0, 0.4, 0.5, -0.6),
    mavlink.MAVLink_statustext_message(6, b"a text of some length"),
    mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 8, 0x5C7, 0, 0, 0, 15, 0, 0, 0, 0, 0, 0, 0.15
    ),
)
keys = st.binary(min_size=32, max_size=32).filter(any)


def peer(key=KEY, *, timestamp=NOW, **ids):
    """Return a pymavlink sender with a signing key."""
    return voice(key, timestamp, **ids)


def packed(engine, number=0):
    frame = bytes(MESSAGES[number % len(MESSAGES)].pack(engine))
    engine.seq = (engine.seq + 1) % 256
    return frame


@given(
    key=keys,
    link_id=st.integers(0, 255),
    timestamp=st.integers(1, LATEST - 1),
    number=st.integers(0, 3),
)
def test_signed_frame_equals_pymavlink(key, link_id, timestamp, number):
    theirs = packed(peer(key, timestamp=timestamp, link_id=link_id), number)
    ours = Signing(key, link_id=link_id, timestamp=timestamp - 1).sign(packed(peer(None), number))
    assert ours == theirs
    assert Signing(key).check(theirs) is None


@given(payload=st.binary(max_size=255), ident=st.integers(0, 2**24 - 1), seed=st.integers(0, 255))
def test_removing_the_signature_restores_any_frame(payload, ident, seed):
    head = bytes((len(payload), 0, 0, 1, 2, 3)) + ident.to_bytes(3, "little")
    crc = mavlink.x25crc(head + payload + bytes((seed,))).crc
    frame = b"\xfd" + head + payload + crc.to_bytes(2, "little")
    signed = Signing(KEY).sign(frame)
    assert is_signed(signed)
    assert mavlink.x25crc(signed[1:-15] + bytes((seed,))).crc == int.from_bytes(
        signed[-15:-13], "little"
    )
    assert without_signature(signed) == frame == without_signature(frame)


@given(at=st.integers(0, 10_000), bit=st.integers(0, 7))
def test_changed_bit_invalidates_the_signature(at, bit):
    frame = bytearray(packed(peer(), 1))
    frame[at % len(frame)] ^= 1 << bit
    signing = Signing(KEY)
    assert signing.check(bytes(frame)) is Refusal.WRONG
    assert signing.timestamp == 0


def test_repeated_signed_frame_is_rejected_per_stream():
    theirs = peer(timestamp=NOW + 1000)
    signing = Signing(KEY)
    first, second, third = (packed(theirs, number) for number in range(3))
    answers = [signing.check(frame) for frame in (first, first, third, second)]
    assert answers == [None, Refusal.REPEATED, None, Refusal.REPEATED]
    for other in ({"link_id": 1}, {"component": 2}, {"system": 2}):
        assert signing.check(packed(peer(timestamp=NOW, **other))) is None


def test_new_signed_stream_may_lag_one_minute():
    assert Signing(KEY, timestamp=NOW).check(packed(peer(timestamp=NOW - MINUTE))) is None
    assert (
        Signing(KEY, timestamp=NOW).check(packed(peer(timestamp=NOW - MINUTE - 1)))
        is Refusal.BEHIND
    )


@pytest.mark.parametrize("timestamp", [NOW + 1, NOW + 100 * MINUTE, LATEST])
def test_forged_future_timestamp_does_not_block_real_sender(timestamp):
    real = peer()
    signing = Signing(KEY, timestamp=NOW)
    for count in (0, 1):
        assert signing.check(packed(peer(OTHER, timestamp=timestamp))) is Refusal.WRONG
        assert signing.check(packed(real)) is None
        assert signing.timestamp == NOW + count


def test_signing_timestamp_follows_valid_future_timestamp():
    """One sender with the key has a clock in the future. Known senders are still accepted, and a
    new sender is accepted after it has received our timestamp."""
    vehicle = peer()
    station = peer(system=255, timestamp=NOW + 60 * MINUTE)
    radio = peer(component=192)
    signing = Signing(KEY, timestamp=NOW)
    assert signing.check(packed(vehicle)) is None
    assert signing.check(packed(station)) is None
    assert signing.timestamp == NOW + 60 * MINUTE
    assert signing.check(packed(vehicle)) is None
    assert signing.check(packed(radio)) is Refusal.BEHIND
    assert radio.decode(bytearray(signing.sign(packed(peer(None, component=191))))).get_signed()
    assert signing.check(packed(radio)) is None


def test_signing_timestamp_never_goes_back():
    signing = Signing(KEY)
    signing.advance(EPOCH + 1000.0)
    assert signing.timestamp == 100_000_000
    signing.sign(packed(peer(None)))
    for unix in (EPOCH + 999.0, EPOCH - 1.0, 0.0):
        signing.advance(unix)
        assert signing.timestamp == 100_000_001
    signing.advance(EPOCH + 1001.0)
    assert signing.timestamp == 100_100_000
    signing.advance(1e12)
    assert signing.timestamp == LATEST
    assert is_signed(signing.sign(packed(peer(None))))


def test_restarted_peer_accepts_signatures_after_quiet_hour():
    signing = Signing(KEY, timestamp=NOW)
    restarted = peer(timestamp=NOW + 60 * MINUTE)
    signing.advance(EPOCH + (NOW + 60 * MINUTE) / 1e5)
    assert restarted.decode(bytearray(signing.sign(packed(peer(None, component=191))))).get_signed()


@pytest.mark.parametrize("key", [b"", b"short", bytes(33)])
def test_signing_refuses_key_without_32_bytes(key):
    with pytest.raises(ValueError, match="32 bytes"):
        Signing(key)


def test_signing_does_not_print_key():
    assert repr(KEY) not in repr(Signing(KEY))


# --- signed frames in decoder and pilot: accepted, counted, logged and reported


def keyed_decoder(**options):
    return Decoder(signing=Signing(KEY, timestamp=NOW), **options)


def test_unsigned_and_wrongly_signed_frames_are_counted():
    decoder = keyed_decoder()
    theirs = peer()
    version_1 = bytes(heartbeat().pack(peer(None), force_mavlink1=True))
    for frame in (packed(peer(None)), version_1, packed(peer(OTHER))):
        assert decoder.decode(frame) == []
        assert decoder.frames == []
    assert decoder.counts.refused == {"unsigned": 2, "wrong_signature": 1}
    assert "every frame received is unsigned or wrongly signed" in decoder.counts.describe()
    assert "check signing.key_file" in decoder.counts.describe()
    good = [packed(theirs, number) for number in range(4)]
    assert decoded(decoder, [packed(peer(None)).join(good)]) == good
    assert decoder.frames == good
    assert "every frame" not in decoder.counts.describe()
    assert "5 unsigned" in decoder.counts.describe()


def test_radio_status_needs_no_signature():
    status = mavlink.MAVLink_radio_status_message(200, 190, 100, 10, 12, 0, 0)
    decoder = keyed_decoder()
    for version_1 in (False, True):
        (message,) = decoder.decode(bytes(status.pack(peer(None), force_mavlink1=version_1)))
        assert message.get_type() == "RADIO_STATUS"
    assert decoder.decode(bytes(status.pack(peer(OTHER)))) == []


def test_unsigned_frames_are_accepted_with_accept_unsigned():
    frames = packed(peer()) + packed(peer(OTHER)) + packed(peer(None))
    decoder = Decoder()
    assert len(decoder.decode(frames)) == 3
    assert (decoder.counts.signed, decoder.counts.refused) == (2, {})
    assert "2 of the frames are signed, and ours may be rejected" in decoder.counts.describe()
    assert len(keyed_decoder(accept_unsigned=True).decode(frames)) == 2


def test_setup_signing_message_is_not_logged():
    setup = mavlink.MAVLink_setup_signing_message(1, 1, list(KEY), NOW)
    for decoder, frame in (
        (Decoder(), setup.pack(peer(None))),
        (keyed_decoder(), setup.pack(peer())),
    ):
        decoder.decode(bytes(frame))
        assert (decoder.counts.frames, decoder.frames) == (1, [])


def pilot_with(key=KEY, **options):
    return Pilot(rig_mission(), key and Signing(key, timestamp=NOW, **options))


def beat(pilot, theirs, now=0.0, source="vehicle"):
    pilot.receive(bytes(heartbeat().pack(theirs)), now, source)


def test_pilot_signs_every_frame_with_rising_timestamps():
    pilot = pilot_with(link_id=9)
    plain = pilot_with(None)
    beat(pilot, peer())
    beat(plain, peer(None))
    out, same = (
        [
            frame
            for now in range(5)
            for frame in split_frames(output(one, float(now)) + one.hello(float(now)))
        ]
        for one in (pilot, plain)
    )
    assert len(out) > 10
    assert all(map(is_signed, out))
    assert list(map(without_signature, out)) == same
    stamps = [int.from_bytes(frame[-12:-6], "little") for frame in out]
    assert stamps == sorted(set(stamps))
    listener = peer(timestamp=NOW)
    assert all(listener.decode(bytearray(frame)).get_link_id() == 9 for frame in out)


def test_echo_of_own_signed_frames_is_not_another_sender():
    pilot = pilot_with()
    beat(pilot, peer())
    pilot.receive(output(pilot, 0.0), 0.01, "vehicle")
    assert pilot.session.identity.ignored["echo"] > 0
    assert pilot.session.identity.ignored["twin"] == 0


def test_vehicle_with_late_clock_adopts_our_timestamp():
    """An autopilot without GPS starts with its last signing timestamp. The pilot listens on a port
    and does not know the autopilot's address yet."""
    pilot = pilot_with()
    vehicle = peer(timestamp=NOW - 120 * MINUTE)
    beat(pilot, vehicle, source="vehicle's address")
    assert not pilot.session.up
    assert pilot.frames_refused() == {"clock_behind": 1}
    assert pilot.session.reply_to == "vehicle's address"
    for frame in split_frames(output(pilot, 0.0)):
        vehicle.decode(bytearray(frame))
    beat(pilot, vehicle, 1.0, "vehicle's address")
    assert pilot.session.up


def test_frame_rejected_by_signature_is_not_answered():
    pilot = pilot_with()
    for key in (None, OTHER):
        beat(pilot, peer(key))
    pilot.receive(packed(peer(None, component=192)), 0.0, "radio", RANGING)
    assert pilot.session.reply_to is None
    assert pilot.frames_refused() == {"unsigned": 2, "wrong_signature": 1}
