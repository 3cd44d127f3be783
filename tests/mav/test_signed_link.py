"""Signed frames through the decoder and the pilot: what is believed, counted, logged and told."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.codec import Decoder
from circnav_mav.mav.framing import split_frames
from circnav_mav.mav.signing import MINUTE, Signing, is_signed, without_signature
from circnav_mav.pilot import RANGING, Pilot
from tests.mav.test_codec import decoded
from tests.mav.test_signing import KEY, NOW, OTHER, peer, said
from tests.rig import MISSION, heartbeat


def believing(**options):
    return Decoder(signing=Signing(KEY, timestamp=NOW), **options)


def test_unsigned_and_wrongly_signed_frames_are_refused_counted_and_not_logged():
    decoder = believing()
    version_1 = bytes(heartbeat().pack(peer(None), force_mavlink1=True))
    for frame in (said(peer(None)), version_1, said(peer(OTHER))):
        assert decoder.decode(frame) == []
        assert decoder.frames == []
    assert decoder.counts.refused == {"unsigned": 2, "wrong_signature": 1}
    assert "every frame heard is unsigned or wrongly signed" in decoder.counts.describe()
    assert "check signing.key_file" in decoder.counts.describe()


def test_a_refused_frame_says_nothing_about_the_ones_beside_it():
    decoder, theirs = believing(), peer()
    good = [said(theirs, number) for number in range(4)]
    assert decoded(decoder, [said(peer(None)).join(good)]) == good
    assert decoder.frames == good
    assert "every frame" not in decoder.counts.describe()
    assert "3 unsigned" in decoder.counts.describe()


def test_radio_status_needs_no_signature_but_a_wrong_one_is_wrong():
    status = mavlink.MAVLink_radio_status_message(200, 190, 100, 10, 12, 0, 0)
    decoder = believing()
    for version_1 in (False, True):
        (message,) = decoder.decode(bytes(status.pack(peer(None), force_mavlink1=version_1)))
        assert message.get_type() == "RADIO_STATUS"
    assert decoder.decode(bytes(status.pack(peer(OTHER)))) == []


def test_without_a_key_everybody_is_believed_and_with_one_unsigned_frames_where_the_mission_says_so():
    frames = said(peer()) + said(peer(OTHER)) + said(peer(None))
    decoder = Decoder()
    assert len(decoder.decode(frames)) == 3
    assert (decoder.counts.signed, decoder.counts.refused) == (2, {})
    assert "2 of the frames are signed, and ours may be refused" in decoder.counts.describe()
    assert len(believing(accept_unsigned=True).decode(frames)) == 2


def test_somebodys_key_does_not_get_into_a_log():
    setup = mavlink.MAVLink_setup_signing_message(1, 1, list(KEY), NOW)
    for decoder, frame in ((Decoder(), setup.pack(peer(None))), (believing(), setup.pack(peer()))):
        decoder.decode(bytes(frame))
        assert (decoder.counts.frames, decoder.frames) == (1, [])


@pytest.fixture
def pilot():
    """That believes who has the key."""
    return Pilot(MISSION, Signing(KEY, timestamp=NOW))


def test_all_that_a_pilot_says_is_signed_with_one_running_timestamp():
    pilot = Pilot(MISSION, Signing(KEY, link_id=9, timestamp=NOW))
    pilot.receive(bytes(heartbeat().pack(peer())), 0.0, "vehicle")
    out = [frame for now in range(5) for frame in split_frames(pilot.step(float(now)) + pilot.hello(float(now)))]
    assert len(out) > 10
    assert all(map(is_signed, out))
    stamps = [int.from_bytes(frame[-12:-6], "little") for frame in out]
    assert stamps == sorted(set(stamps))
    listener = peer(timestamp=NOW)
    assert all(listener.decode(bytearray(frame)).get_link_id() == 9 for frame in out)


def test_a_pilot_without_key_says_the_same_unsigned():
    plain, signed = Pilot(MISSION), Pilot(MISSION, Signing(KEY, timestamp=NOW))
    for pilot, theirs in ((plain, peer(None)), (signed, peer())):
        pilot.receive(bytes(heartbeat().pack(theirs)), 0.0, "vehicle")
    assert list(map(without_signature, split_frames(signed.step(0.0)))) == split_frames(plain.step(0.0))


def test_an_echo_of_our_signed_frames_is_no_twin(pilot):
    pilot.receive(bytes(heartbeat().pack(peer())), 0.0, "vehicle")
    pilot.receive(pilot.step(0.0), 0.01, "vehicle")
    assert pilot.session.ignored["echo"] > 0
    assert pilot.session.ignored["twin"] == 0


def test_a_vehicle_whose_clock_is_hours_behind_is_greeted_takes_our_time_over_and_is_heard(pilot):
    """An autopilot without GPS begins where it last ended. We wait on a port, and know nobody to speak to yet."""
    vehicle = peer(timestamp=NOW - 120 * MINUTE)
    pilot.receive(bytes(heartbeat().pack(vehicle)), 0.0, "vehicle's address")
    assert not pilot.session.up
    assert pilot.frames_refused() == {"clock_behind": 1}
    assert pilot.reply_to == "vehicle's address"
    for frame in split_frames(pilot.step(0.0)):
        vehicle.decode(bytearray(frame))
    pilot.receive(bytes(heartbeat().pack(vehicle)), 1.0, "vehicle's address")
    assert pilot.session.up


@pytest.mark.parametrize("key", [None, OTHER])
def test_a_frame_that_is_not_believed_gets_no_answer(pilot, key):
    pilot.receive(bytes(heartbeat().pack(peer(key))), 0.0, "somebody")
    assert pilot.reply_to is None


def test_the_ranging_link_is_judged_by_the_same_key(pilot):
    pilot.receive(said(peer(None, component=192)), 0.0, "radio", RANGING)
    pilot.receive(said(peer(OTHER)), 0.0, "somebody")
    assert pilot.frames_refused() == {"unsigned": 1, "wrong_signature": 1}
