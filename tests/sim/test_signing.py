"""The emulated autopilots with a signing key: signed and accepted frames, also after a reboot."""

import pytest
from circnav_sim.config import ConfigError, load_vehicle, parse_vehicle
from circnav_sim.signing import EPOCH_S, TICKS_PER_S
from pymavlink.dialects.v20 import all as mavlink

from tests.sim.station import Station, build

KEY = bytes(range(32))
OTHER = bytes(range(100, 132))
UNIX = 1_790_000_000.0
NOW = round((UNIX - EPOCH_S) * TICKS_PER_S)


@pytest.fixture
def key_file(tmp_path):
    path = tmp_path / "vehicle.key"
    path.write_text(KEY.hex())
    return path


@pytest.fixture
def make(key_file):
    def vehicle(profile="arducopter", **signing):
        mode = "OFFBOARD" if profile.startswith("px4") else "GUIDED"
        made = build(
            vehicle={"profile": profile},
            start={"mode": mode},
            signing={"key_file": str(key_file), **signing},
        )
        made.set_time(UNIX)
        return made

    return vehicle


@pytest.fixture
def vehicle(make):
    return make()


def station(vehicle, key, timestamp=NOW, **ids):
    made = Station(vehicle, **ids)
    for engine in (made._out, made._in):
        engine.signing.secret_key = key
        engine.signing.timestamp = timestamp
    made._out.signing.sign_outgoing = key is not None
    return made


def accepted(vehicle, by):
    """Return True if the vehicle flies a velocity setpoint of this sender."""
    before = len(vehicle.setpoint_log)
    vehicle.advance(vehicle.time + 0.1)
    by.velocity(3.0, 0.1)
    return len(vehicle.setpoint_log) > before


def test_autopilot_and_radio_sign_all_frames(vehicle):
    listener = mavlink.MAVLink(None)
    listener.signing.secret_key = KEY
    listener.signing.timestamp = NOW
    station(vehicle, KEY).heartbeat()
    vehicle.advance(2.0)
    received = [listener.decode(bytearray(frame)) for frame in vehicle.outgoing()]
    assert all(message.get_signed() for message in received)
    assert {message.get_srcComponent() for message in received} == {1, 192}


def test_autopilot_obeys_only_holder_of_its_key(vehicle):
    """After a forged frame with a future timestamp, the real sender is still obeyed."""
    assert accepted(vehicle, station(vehicle, KEY))
    assert not accepted(vehicle, station(vehicle, None))
    assert not accepted(vehicle, station(vehicle, OTHER, component=192))
    assert not accepted(vehicle, station(vehicle, OTHER, NOW * 2))
    assert vehicle.refused == 3
    assert accepted(vehicle, station(vehicle, KEY, component=193))


@pytest.mark.parametrize(
    ("profile", "accepts_heartbeat"), [("arducopter", False), ("px4_copter", True)]
)
def test_unsigned_frames_follow_rules_of_the_firmware(make, profile, accepts_heartbeat):
    vehicle = make(profile)
    station(vehicle, None).send(mavlink.MAVLink_radio_status_message(200, 190, 100, 10, 12, 0, 0))
    assert vehicle.refused == 0
    station(vehicle, None).heartbeat()
    assert (vehicle.refused == 0) is accepts_heartbeat
    usb = make(profile, accept_unsigned=True)
    assert accepted(usb, station(usb, None))


def test_replayed_and_late_signed_frames_are_ignored(vehicle):
    ours = station(vehicle, KEY)
    target = (0, 1, 1, 8, 0x5C7, 0, 0, 0, 3, 0, 0, 0, 0, 0, 0, 0.1)
    frame = mavlink.MAVLink_set_position_target_local_ned_message(*target).pack(ours._out)
    vehicle.receive(frame)
    vehicle.receive(frame)
    assert len(vehicle.setpoint_log) == 1
    assert not accepted(vehicle, station(vehicle, KEY, NOW - 61 * TICKS_PER_S, component=192))
    assert accepted(vehicle, station(vehicle, KEY, NOW - 59 * TICKS_PER_S, component=193))


@pytest.mark.parametrize("profile", ["arducopter", "px4_copter"])
def test_autopilot_without_gps_adopts_signed_time(key_file, profile):
    """A signed heartbeat also sets the autopilot's clock, although PX4 accepts unsigned
    heartbeats."""
    vehicle = build(signing={"key_file": str(key_file)}, vehicle={"profile": profile})
    vehicle.advance(1.5)
    assert stamps(vehicle)[-1] < TICKS_PER_S
    station(vehicle, KEY).heartbeat()
    vehicle.advance(3.0)
    assert stamps(vehicle)[-1] >= NOW


def test_rebooted_autopilot_signs_one_minute_ahead(vehicle):
    ours = station(vehicle, KEY)
    assert accepted(vehicle, ours)
    before = stamps(vehicle)[-1]
    vehicle._reboot(1.0)
    vehicle.advance(vehicle.time + 2.5)
    assert stamps(vehicle)[0] > before + 59 * TICKS_PER_S


def test_signing_key_path_is_relative_to_vehicle_file(key_file):
    for text in (
        '[signing]\nkey_file = "vehicle.key"\n',
        '[sim.signing]\nkey_file = "vehicle.key"\n',
    ):
        path = key_file.with_name("vehicle.toml")
        path.write_text(text)
        assert load_vehicle(path).signing.key_file == str(key_file)


@pytest.mark.parametrize(("data", "error"), [(None, "No such file"), (b"short", "holds 5 bytes")])
def test_unusable_signing_key_is_refused_in_one_line(tmp_path, data, error):
    path = tmp_path / "bad.key"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(ConfigError, match=error) as caught:
        parse_vehicle({"signing": {"key_file": str(path)}}, "v.toml")
    assert str(caught.value).startswith("v.toml: signing.key_file: ")


def stamps(vehicle):
    return [int.from_bytes(frame[-12:-6], "little") for frame in vehicle.outgoing()]
