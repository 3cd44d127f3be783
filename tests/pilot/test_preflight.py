"""Preflight of each emulated vehicle in lockstep: frames sent, data received, grades and texts."""

import functools
import hashlib
import itertools
import random
import re
import struct
from dataclasses import replace
from pathlib import Path

import pytest
from circnav_sim.config import parse_vehicle
from circnav_sim.vehicle import Vehicle
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.autopilots.parameters import FLIES_ON
from circnav_mav.mav.check_result import Grade
from circnav_mav.mav.codec import LinkCounts
from circnav_mav.mav.commands import USUAL
from circnav_mav.mav.own_motion import Motion
from circnav_mav.mav.signing import Signing
from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import RANGING, VEHICLE
from circnav_mav.preflight.checks import judge
from circnav_mav.preflight.listener import PreflightListener, ReceivedRange
from tests.flight.signed import KEY, OTHER, key_file
from tests.rig import Voice, beacon, heartbeat
from tests.tools.fault_link.frames import message_id

CONFIG = Path(__file__).parents[2] / "config"
MISSIONS = ("arducopter", "arduplane", "ardurover", "px4_copter", "px4_plane")
HEARTBEAT = 0
COMMAND_LONG = 76
PARAM_REQUEST_READ = 20
TIMESYNC = 111
SET_MESSAGE_INTERVAL = 511
REQUEST_MESSAGE = 512
ATTITUDE = 30
VFR_HUD = 74
FAIL = Grade.FAIL
WARN = Grade.WARN
PASS = Grade.PASS


class Bench:
    """The preflight listener and the emulated vehicle of a mission, in lockstep. speed: speed of
    the vehicle's clock relative to real time."""

    def __init__(self, name, *overrides, seconds=5.0, without=None, signing=None):
        """without: keys of [ranging] or [orbit] that are removed from the mission."""
        mission = load_mission(CONFIG / f"{name}.toml", overrides)
        for table, keys in (without or {}).items():
            changed = getattr(mission.file, table).model_copy(update=keys)
            mission = replace(mission, file=mission.file.model_copy(update={table: changed}))
        self.mission = mission
        self.vehicle = Vehicle(parse_vehicle(mission.file.sim, name))
        self.listener = PreflightListener(
            mission, seconds=seconds, signing=signing and Signing(signing)
        )
        self.sent = []
        self.speed = 1.0
        self.receives = lambda frame, now: True
        self.speaks = lambda now: []
        self.now = 0.0
        self.parser = mavlink.MAVLink(None)
        self.links = {
            "main": VEHICLE,
            **({"ranging": RANGING} if mission.file.ranging.endpoint else {}),
        }

    def run(self):
        while not self.listener.done:
            self.step()
        return self.listener

    def step(self):
        self.now = now = round(self.now + 0.01, 6)
        self.vehicle.advance(now * self.speed)
        for sim_link, link in self.links.items():
            for frame in self.vehicle.outgoing(sim_link):
                if self.receives(frame, now):
                    self.listener.receive(frame, now, "sim", link)
        for frame in self.speaks(now):
            self.listener.receive(frame, now, "sim", link)
        out = self.listener.step(now)
        self.vehicle.receive(out)
        self.sent += self.parser.parse_buffer(bytearray(out)) or []

    def lines(self):
        return judge(self.mission, self.run())


def without(number):
    """Return a filter that drops a message."""
    return lambda frame, now: message_id(frame) != number


def twice_a_second(*frames):
    """Return a sender of (voice, message) pairs."""
    return lambda now: (
        [voice.pack(message) for voice, message in frames] if round(now * 100) % 50 == 0 else []
    )


@functools.cache
def good(name):
    """Return the bench of an unchanged vehicle after its preflight."""
    bench = Bench(name)
    bench.run()
    return bench


class Overridden:
    """A proxy of an object in which some values, given by dotted paths, are replaced."""

    def __init__(self, same, changes):
        self._same = same
        self._changes = changes

    def __getattr__(self, name):
        if name in self._changes:
            return self._changes[name]
        below = {
            path.partition(".")[2]: value
            for path, value in self._changes.items()
            if path.startswith(f"{name}.")
        }
        return Overridden(getattr(self._same, name), below) if below else getattr(self._same, name)


def changed_lines(name, changes):
    """Return the lines for a vehicle with some changed observations."""
    return judge(good(name).mission, Overridden(good(name).listener, changes))


def parameter(name, values, *, only=False):
    """Return the lines about parameters for a vehicle with other values."""
    held = {} if only else good(name).listener.parameters
    return of(changed_lines(name, {"parameters": {**held, **values}}), "parameter")


def of(lines, subject):
    return [line for line in lines if line.subject == subject]


def one(lines, subject):
    (line,) = of(lines, subject)
    return line


def failing(lines):
    return [line.subject for line in lines if line.grade is FAIL]


# --- every vehicle


@pytest.mark.parametrize("name", MISSIONS)
def test_each_bundled_vehicle_passes_preflight(name):
    lines = judge(good(name).mission, good(name).listener)
    assert failing(lines) == []
    subjects = {line.subject for line in lines}
    assert {
        "vehicle",
        "firmware",
        "mode",
        "stream",
        "clock",
        "ranging",
        "noise",
        "parameter",
    } <= subjects
    needed = {"arduplane": {"airspeed"}, "px4_plane": {"airspeed"}, "px4_copter": {"altitude"}}
    graded = {subject: one(lines, subject) for subject in ("airspeed", "altitude")}
    assert {line.grade for line in graded.values()} == {PASS}
    assert {
        name for name, line in graded.items() if not line.text.endswith("not needed")
    } == needed.get(name, set())


@pytest.mark.parametrize("name", MISSIONS)
def test_preflight_changes_only_stream_rates_temporarily(name):
    sent = good(name).sent
    assert {message.get_msgId() for message in sent} == {
        HEARTBEAT,
        COMMAND_LONG,
        PARAM_REQUEST_READ,
        TIMESYNC,
    }
    commands = [message for message in sent if message.get_msgId() == COMMAND_LONG]
    assert {message.command for message in commands} == {SET_MESSAGE_INTERVAL, REQUEST_MESSAGE}
    last = {
        message.param1: message.param2
        for message in commands
        if message.command == SET_MESSAGE_INTERVAL
    }
    assert set(last.values()) == {0.0}


@pytest.mark.parametrize(
    ("name", "mode"),
    [
        ("arducopter", "GUIDED"),
        ("arduplane", "GUIDED"),
        ("ardurover", "GUIDED"),
        ("px4_plane", "ALTCTL"),
    ],
)
def test_preflight_leaves_vehicle_unchanged_in_guided_mode(name, mode):
    """The vehicle is armed, in the guided mode and has ranges: `circnav fly` would engage."""
    bench = Bench(name, f'sim.start.mode="{mode}"')
    armed = bench.vehicle.truth.armed
    line = one(bench.lines(), "mode")
    assert (line.grade, "immediately" in line.text) == (WARN, True)
    assert bench.vehicle.truth.armed == armed


@pytest.mark.parametrize("name", MISSIONS)
def test_preflight_reads_each_parameter_value(name):
    listener = good(name).listener
    table = good(name).vehicle._flight.autopilot.params.all_values()
    held = {value.param_id: value.param_value if value.param_type == 9 else None for value in table}
    methods = good(name).mission.methods(type(listener.session.adapter))
    asked = {
        name for method in methods for rule in method.parameters for name in rule.requested
    } & set(held)
    assert set(listener.parameters) == asked
    floats = {name: held[name] for name in asked if held[name] is not None}
    assert {name: listener.parameters[name] for name in floats} == pytest.approx(floats)
    assert listener.parameters.get("COM_RC_IN_MODE", 1.0) in (
        0.0,
        1.0,
        2.0,
    ), "PX4 sends an integer parameter as the bytes of a float"


@pytest.mark.parametrize("name", MISSIONS)
def test_preflight_measures_stream_rates_after_changing_them(name):
    """Messages sent before the rates are lowered are not counted. A stream that ground stations
    often request keeps a rate above the required one: SYS_STATUS of PX4, 5 Hz."""
    for ident, (wanted, measured) in Bench(name, seconds=10.0).run().streams.items():
        expected = max(wanted, measured) if ident in USUAL else wanted
        assert measured == pytest.approx(expected, rel=0.1)


# --- lines that depend only on keys of the mission

BEACON = (
    'ranging.message="ranging_beacon"',
    'ranging.endpoint="sim"',
    'sim.ranging.message="ranging_beacon"',
    'sim.ranging.via="direct"',
    "sim.ranging.beacon_id=1",
)
ROVER = ("link.wait_s=2.0", 'sim.vehicle.profile="ardurover"', 'sim.start.mode="HOLD"')
LOW = ("orbit.height_above_target_m=95.0", "orbit.radius_m=60.0")
RATE = (
    "ranging.message=named_value_float", "ranging.rate_name=RR",
    "sim.ranging.message=named_value_float",
)  # fmt: skip
INSTEAD = ("ranging.message=named_value_float",)
RATE_SENT = (*RATE, "sim.ranging.rate_name=RR")


@pytest.mark.parametrize(
    ("keys", "subject", "grade", "text"),
    [
        (ROVER, "vehicle", FAIL, "ground_rover, the mission is for ardupilot copter"),
        (("link.wait_s=2.0", "sim.vehicle.mavlink_version=1"), "vehicle", FAIL, "MAVLink 1 only"),
        (("bounds.min_battery_percent=30.0", "sim.battery.percent=80.0"), "battery", PASS, "80 %"),
        (("bounds.min_battery_percent=30.0", "sim.battery.percent=25.0"), "battery", FAIL, "25 %"),
        (("ranging.orientation=0",), "ranging", FAIL, "1/192 id 0, orientation 24"),
        (("sim.ranging.rate_hz=0.0",), "ranging", FAIL, " frames"),
        ((*BEACON, "ranging.beacon_id=1"), "ranging", PASS, "10.0 Hz"),
        (("sim.ranging.rate_hz=10.0",), "ranging", PASS, "10.0 Hz"),
        (("sim.ranging.rate_hz=5.0",), "ranging", WARN, "5.0 Hz"),
        # limits.stale_s = 0.5 s needs more than 1.5 Hz
        (("sim.ranging.rate_hz=1.5",), "ranging", FAIL, "Hz"),
        (("sim.events=[{at_s=5.0, action='mute_ranging'}]",), "age", FAIL, "s old"),
        (LOW, "distance", WARN, "possible on the ground only"),
        (RATE_SENT, "range rate", PASS, " Hz, newest "),
        (
            (*RATE_SENT, "sim.ranging.rate_noise_mps=0.8"),
            "range rate",
            WARN,
            "in flight the measured standard",
        ),
        (RATE, "range rate", FAIL, "0 NAMED_VALUE_FLOAT RR"),
        (
            (*RATE_SENT, "sim.ranging.rate_noise_mps=0.0", "sim.ranging.rate_bias_mps=0.0"),
            "range rate",
            WARN,
            "frozen, or its",
        ),
        ((*RATE_SENT, "sim.ranging.rate_bias_mps=20.0"), "range rate", FAIL, "ranges change by"),
        (INSTEAD, "ranging", FAIL, "no usable NAMED_VALUE_FLOAT.*of DISTANCE_SENSOR of 1/192"),
    ],
)
def test_preflight_line_is_graded_by_received_data(keys, subject, grade, text):
    name = "quickstart" if subject == "range rate" else "arducopter"
    line = one(Bench(name, *keys).lines(), subject)
    assert line.grade is grade and re.search(text, line.text), line.text


# --- no vehicle, or several


def test_missing_vehicle_fails_with_received_byte_count():
    bench = Bench("arducopter", "link.wait_s=2.0")
    bench.receives = lambda frame, now: False
    (line,) = bench.lines()
    assert (line.grade, line.subject, "0 bytes received" in line.text) == (FAIL, "vehicle", True)


def test_duplicate_of_own_ids_fails_and_other_senders_warn():
    bench = Bench("arducopter")
    twin = (Voice(1, 191), heartbeat(kind=18, autopilot=8))
    vehicle = (Voice(2, 1), heartbeat())
    radio = (Voice(1, 1), heartbeat(0, kind=18, autopilot=8))
    bench.speaks = twice_a_second(twin, vehicle, radio)
    lines = of(bench.lines(), "others")
    assert [line.grade for line in lines] == [FAIL, WARN, WARN]
    texts = (
        "191",
        "heartbeats of another autopilot",
        "that is no autopilot, but has the vehicle's ids 1/1: give that component another id",
    )
    assert all(text in line.text for text, line in zip(texts, lines, strict=True))


def test_preflight_fails_when_vehicle_stops_sending():
    bench = Bench("arducopter")
    bench.receives = lambda frame, now: now < 4.0
    assert {"heartbeat", "age"} <= set(failing(bench.lines()))


# --- signatures


@pytest.mark.parametrize(
    ("ours", "theirs", "grade", "text"),
    [
        (None, None, None, ""),
        (KEY, KEY, PASS, "frames signed, all with our key"),
        (
            None,
            KEY,
            WARN,
            "the mission has no key: our frames may be rejected; set signing.key_file",
        ),
        (KEY, None, FAIL, "every frame received is unsigned or wrongly signed"),
        (KEY, OTHER, FAIL, "every frame received is unsigned or wrongly signed"),
    ],
    ids=["unsigned", "signed", "no key", "vehicle unsigned", "other key"],
)
def test_preflight_grades_signing_mismatch(tmp_path, ours, theirs, grade, text):
    overrides = ["link.wait_s=3.0"]
    overrides += [f"signing.key_file={key_file(tmp_path, ours)}"] if ours else []
    overrides += (
        [f"sim.signing.key_file={key_file(tmp_path, theirs, 'vehicle.key')}"] if theirs else []
    )
    lines = Bench("arducopter", *overrides, seconds=1.0, signing=ours).lines()
    graded = [
        line
        for line in lines
        if line.subject == "signing" or (line.subject, line.grade) == ("vehicle", FAIL)
    ]
    assert [(line.grade, text in line.text) for line in graded] == (
        [(grade, True)] if grade else []
    )


def test_frames_signed_with_zero_key_are_treated_as_unsigned():
    """PX4 without a key signs with 32 zero bytes, as the frames of this test are."""
    bench = Bench("px4_copter", seconds=1.0)
    clock = itertools.count(10**12)
    receive = bench.listener.receive

    def signed(frame, *rest):
        head = frame[:2] + b"\x01" + frame[3:-2]
        crc = mavlink.x25crc(
            head[1:] + bytes((mavlink.mavlink_map[frame[7] | frame[8] << 8].crc_extra,))
        ).crc
        body = head + crc.to_bytes(2, "little") + b"\x00" + next(clock).to_bytes(6, "little")
        receive(body + hashlib.sha256(bytes(32) + body).digest()[:6], *rest)

    bench.listener.receive = signed
    line = one(bench.lines(), "signing")
    assert (line.grade, "all-zero key" in line.text) == (PASS, True)
    received = bench.listener.connection.counts[VEHICLE]
    assert (received.signed, received.zero_key, received.refused) == (0, received.frames, {})


# --- streams


@pytest.mark.parametrize(
    ("name", "keys", "message_id", "grade"),
    [
        ("arduplane", (), 74, FAIL),
        ("arducopter", (), 74, WARN),
        ("px4_copter", (), 74, FAIL),
        ("arducopter", (), 30, FAIL),
        ("arducopter", (), 1, WARN),
        # the bound on the battery ends the mission if this stream is missing
        ("arducopter", ("bounds.min_battery_percent=30.0",), 1, FAIL),
        ("arducopter", (), 2, WARN),
        ("px4_copter", (), 436, WARN),
    ],
)
def test_preflight_grades_missing_stream_by_its_use(name, keys, message_id, grade):
    bench = Bench(name, *keys)
    bench.receives = without(message_id)
    (line,) = [line for line in of(bench.lines(), "stream") if line.grade is not PASS]
    assert (line.grade, mavlink.mavlink_map[message_id].msgname in line.text) == (grade, True)


# --- time


@pytest.mark.parametrize(
    ("clock", "speed", "clock_speed", "grade", "text"),
    [
        ("local", 5.0, 1.0, FAIL, '5.000 times our speed: set link.clock = "autopilot"'),
        ("local", 0.975, 1.0, WARN, "times our speed: ranges may count as old"),
        ("autopilot", 1.0, 5.0, PASS, "5.000 times our speed, and the flight follows it"),
    ],
)
def test_preflight_requires_autopilot_clock_for_fast_simulator(
    clock, speed, clock_speed, grade, text
):
    bench = Bench("arducopter", f'link.clock="{clock}"')
    bench.speed = speed
    lines = judge(bench.mission, bench.run(), clock_speed)
    line = one(lines, "clock")
    assert (line.grade, text in line.text) == (grade, True), line.text
    assert failing(lines) == ["clock"] * (grade is FAIL), (
        "a wrong clock speed fails only the line `clock`"
    )


def test_preflight_clock_speed_ignores_delayed_frames():
    bench = Bench("arducopter")
    late = []

    def receives(frame, now):
        if 2.0 <= now % 4.0 < 2.3:  # delayed frames, including the first frame of the measurement
            late.append(frame)
            return False
        return True

    bench.receives = receives
    bench.speaks = lambda now: (
        [late.pop(0) for _ in range(len(late))] if not 2.0 <= now % 4.0 < 2.3 else []
    )
    line = one(bench.lines(), "clock")
    assert (line.grade, "1.00" in line.text) == (PASS, True), line.text


def test_preflight_fails_when_vehicle_reboots():
    bench = Bench("arducopter", "sim.events=[{at_s=4.0, action='reboot'}]", seconds=8.0)
    lines = of(bench.lines(), "clock")
    assert [line.grade for line in lines] == [FAIL, PASS]
    assert "rebooted 1 times" in lines[0].text


def airspeed(reported, *, armed):
    """Return changes of the observation: the vehicle has no airspeed sensor, and VFR_HUD reports
    this airspeed."""
    return {
        "session.motion.at": lambda now: Motion(),
        "airspeed": reported,
        "session.vehicle.armed": armed,
    }


def mode(number, *, armed):
    return {"session.vehicle.mode": number, "session.vehicle.armed": armed}


def ranges(count=None, speed=1, **changed):
    """Return changes of the received ranges. speed: speed of their timestamps."""

    def change():
        received = good("arducopter").listener.ranges[:count]
        return {"ranges": [replace(one, stamp=speed * one.stamp, **changed) for one in received]}

    return change


def unstamped():
    return {"ranging": Overridden(good("arducopter").listener.ranging, {"stamped": False})}


def frames(**counts):
    return {"connection.counts": {VEHICLE: LinkCounts(**counts)}}


@pytest.mark.parametrize(
    ("changes", "subject", "grade", "text"),
    [
        ({"session.timesync.typical": 0.02}, "round trip", PASS, "20 ms"),
        ({"session.timesync.typical": 0.3}, "round trip", WARN, "300 ms"),
        ({"session.timesync.typical": 0.8}, "round trip", FAIL, "800 ms"),
        ({"session.timesync.typical": None}, "round trip", WARN, "no answer"),
        ({"session.vehicle.firmware": None}, "firmware", WARN, "no answer"),
        (frames(frames=100), "MAVLink", PASS, "version 2 only"),
        (frames(frames=9, version_1=3), "MAVLink", WARN, "3 of 9"),
        (mode(4, armed=True), "mode", WARN, "immediately"),
        (mode(5, armed=True), "mode", PASS, "requested by circnav"),
        (mode(4, armed=False), "mode", PASS, "requested by circnav"),
        (airspeed(0.0, armed=True), "airspeed", FAIL, "not received; a"),
        (airspeed(0.0, armed=False), "airspeed", WARN, "engages from"),
        (airspeed(float("nan"), armed=False), "airspeed", FAIL, "check the airspeed sensor"),
        (airspeed(None, armed=False), "airspeed", FAIL, "no VFR_HUD"),
        (ranges(50, speed=2), "stamps", FAIL, 'set ranging.stamp = "arrival"'),
        (
            lambda: ranges(50, speed=2)() | {"boot": None},
            "stamps",
            FAIL,
            'set ranging.stamp = "arrival"',
        ),
        (ranges(3, speed=2), "stamps", WARN, "too few ranges to check"),
        (unstamped, "stamps", WARN, "no timestamp"),
        (ranges(r=150.0), "noise", WARN, "radio is frozen"),
    ],
)
def test_preflight_grades_state_of_vehicle_and_radio(changes, subject, grade, text):
    name = "arduplane" if subject == "airspeed" else "arducopter"
    line = one(changed_lines(name, changes() if callable(changes) else changes), subject)
    assert (line.grade, text in line.text) == (grade, True), line.text


# --- ranging


@pytest.mark.parametrize(("noise", "grade"), [(0.05, PASS), (0.5, PASS), (1.2, WARN), (3.0, FAIL)])
def test_preflight_grades_measured_noise_against_mission(noise, grade):
    line = one(Bench("arducopter", f"sim.ranging.noise_m={noise}", seconds=20.0).lines(), "noise")
    assert line.grade is grade
    assert float(line.text.split()[2]) == pytest.approx(noise, rel=0.25, abs=0.02)


@pytest.mark.parametrize("received", [12, 50])
def test_preflight_assumes_range_noise_when_ranges_are_few(received):
    """The scatter of few ranges is uncertain. In 300 short preflights with the noise that the
    mission assumes, at most three may propose another sigma_m and none may fail."""
    grades = []
    for seed in range(300):
        draw = random.Random(seed)
        ranges = [
            ReceivedRange(i / 10, i / 10, i / 10, 50 + draw.gauss(0, 0.5), 0.5)
            for i in range(received)
        ]
        lines = changed_lines(
            "arducopter", {"ranges": ranges, "end": received / 10, "seconds": received / 10}
        )
        grades.append(one(lines, "noise").grade)
    assert grades.count(WARN) <= 3
    assert FAIL not in grades


def test_measured_noise_excludes_outliers_gaps_and_motion():
    """The range falls at 20 m/s with an acceleration of 4 m/s^2. Every fifth range is lost, and one
    range in twenty has an error of 30 m."""
    draw = random.Random(3)
    ranges = []
    for i in range(600):
        t = i / 10
        off = 30.0 if i % 20 == 7 else 0.0
        if i % 5:
            ranges.append(
                ReceivedRange(t, t, t, 2000 - 20 * t + 2 * t * t + off + draw.gauss(0, 0.5), 0.5)
            )
    lines = changed_lines("arducopter", {"ranges": ranges, "end": 60.0, "seconds": 60.0})
    assert float(one(lines, "noise").text.split()[2]) == pytest.approx(0.5, rel=0.15)
    assert one(lines, "outliers").grade is WARN or "5 %" in one(lines, "outliers").text


UNNAMED = {"ranging": {"component_id": None, "orientation": None}}


def test_preflight_passes_ranges_repeated_by_px4():
    """PX4 forwards DISTANCE_SENSOR of the radio and also sends it again under its own id."""
    lines = Bench("px4_copter", without=UNNAMED).lines()
    assert (one(lines, "ranging").grade, one(lines, "rejected").grade) == (PASS, PASS)
    assert "wrong_source" in one(lines, "rejected").text


def of_another(now, sender=(1, 192), *, beacon_id=None, id=0, orientation=24):
    """Return frames of a second sensor that measures a target at 90 m, with the stamps of the first
    sensor."""
    if round(now * 100) % 10:
        return []
    if beacon_id is not None:
        return [
            Voice(*sender).pack(
                beacon(90_000, round(now * 1e6), round(now * 10) & 255, beacon_id=beacon_id)
            )
        ]
    stamp = round(now * 1000)
    return [
        Voice(*sender).pack(
            mavlink.MAVLink_distance_sensor_message(stamp, 20, 60000, 9000, 4, id, orientation, 0)
        )
    ]


@pytest.mark.parametrize(
    ("other", "missions", "named"),
    [
        ({"id": 3}, (), "ranging.sensor_id=0"),
        ({"sender": (1, 193)}, (), "ranging.component_id=192"),
        ({"sender": (77, 192)}, (), "ranging.system_id=1"),
        ({"beacon_id": 5}, BEACON, "ranging.beacon_id=1"),
    ],
    ids=["sensor", "component", "system", "beacon"],
)
def test_preflight_names_key_that_selects_range_source(other, missions, named):
    bench = Bench("arducopter", *missions, without=UNNAMED)
    bench.speaks = lambda now: of_another(now, **other)
    lines = bench.lines()
    line = one(lines, "ranging")
    key, _, value = named.partition("=")
    assert line.grade is FAIL and not of(lines, "noise")
    assert (
        line.text.startswith("2 range sources: 1/192 ")
        and "(90.0 m)" in line.text
        and key in line.text
    )
    assert f" {key.removeprefix('ranging.')} {value} " in line.text or key.endswith(
        ("component_id", "system_id")
    )
    bench = Bench(
        "arducopter", *missions, without={"ranging": {**UNNAMED["ranging"], key[8:]: int(value)}}
    )
    bench.speaks = lambda now: of_another(now, **other)
    lines = bench.lines()
    assert (one(lines, "ranging").grade, one(lines, "noise").grade) == (PASS, PASS)


BY_HOME = {"orbit": {"height_above_target_m": None, "target_above_home_m": 5.0}}
"""Changes of a mission that gives the beacon's altitude above home instead of the height."""


def test_preflight_reports_radius_error_per_meter_of_height():
    lines = Bench("arduplane", "sim.start.altitude_m=80.0", without=BY_HOME).lines()
    line = one(lines, "height")
    assert line.grade is PASS
    assert line.text.startswith("75.0 m above the target. 1 m of height: 0.50 m of radius")
    assert one(lines, "distance").text.endswith("at a height of 75.0 m above the target")
    assert "HOME_POSITION" in str([line.text for line in of(lines, "stream")])


def test_preflight_fails_without_home_altitude_for_height():
    bench = Bench("arduplane", without=BY_HOME)
    bench.receives = without(242)
    line = one(bench.lines(), "height")
    assert (line.grade, line.text.startswith("no home altitude (HOME_POSITION)")) == (FAIL, True)


# --- parameters


@pytest.mark.parametrize(
    ("name", "key", "grades"),
    [
        ("arducopter", "GUID_TIMEOUT", {0.05: FAIL, 0.3: WARN, 3.0: PASS, 10.0: WARN}),
        ("arducopter", "GUID_OPTIONS", {1 << 5: WARN, 1 << 2: PASS}),
        ("arducopter", "FS_GCS_ENABLE", {1: WARN}),
        ("arducopter", "SYSID_MYGCS", {1: WARN}),
        ("arducopter", "FS_THR_ENABLE", {0: WARN, 1: PASS, 3: PASS}),
        ("arducopter", "FS_EKF_ACTION", {0: WARN}),
        ("arducopter", "FENCE_ENABLE", {0: PASS, 1: WARN}),
        ("arducopter", "WPNAV_SPEED", {500.0: PASS, 499.0: WARN}),
        ("arducopter", "WPNAV_ACCEL", {240.0: PASS, 230.0: WARN}),
        ("arducopter", "ATC_ANGLE_MAX", {30.0: PASS, 23.0: PASS, 21.0: WARN, 8.0: WARN}),
        ("arducopter", "WP_ACC", {2.4: PASS, 2.3: WARN}),
        ("arducopter", "ANGLE_MAX", {3000.0: PASS, 2300.0: PASS, 2100.0: WARN, 800.0: WARN}),
        ("px4_copter", "MPC_TILTMAX_AIR", {45.0: PASS, 20.0: WARN}),
        ("arduplane", "ROLL_LIMIT_DEG", {45.0: PASS, 44.0: FAIL}),
        ("arduplane", "AIRSPEED_CRUISE", {23.0: PASS, 25.0: WARN, 15.0: FAIL}),
        ("arduplane", "AIRSPEED_MIN", {23.0: FAIL}),
        ("arduplane", "AIRSPEED_MAX", {21.0: FAIL}),
        ("arduplane", "FS_GCS_ENABL", {1: WARN}),
        ("arduplane", "FS_SHORT_ACTN", {0: PASS, 1: PASS}),
        ("arduplane", "FS_LONG_ACTN", {0: WARN, 1: PASS}),
        ("ardurover", "WP_SPEED", {2.0: FAIL, 0.0: PASS}),
        ("ardurover", "FS_GCS_ENABLE", {1: WARN}),
        ("ardurover", "FS_THR_ENABLE", {0: WARN, 1: PASS}),
        ("px4_copter", "COM_OF_LOSS_T", {0.05: FAIL}),
        ("px4_copter", "COM_OBL_RC_ACT", {5: PASS, 7: FAIL}),
        ("px4_copter", "MC_YAWRATE_MAX", {30.0: FAIL}),
        ("px4_copter", "COM_RC_IN_MODE", {1: WARN, 0: PASS}),
        ("px4_copter", "NAV_RCL_ACT", {0: WARN, 2: PASS, 6: FAIL}),
        ("px4_copter", "MAV_FWDEXTSP", {0: FAIL}),
        ("px4_plane", "COM_RC_IN_MODE", {0: FAIL, 4: FAIL, 3: WARN}),
        ("px4_plane", "COM_RC_LOSS_T", {0.05: FAIL}),
        ("px4_plane", "NAV_RCL_ACT", {1: PASS, 2: PASS, 6: FAIL, 0: WARN}),
        ("px4_plane", "COM_RCL_EXCEPT", {0: WARN, 5: WARN, 3: PASS}),
        ("px4_plane", "FW_R_LIM", {45.0: FAIL}),
        ("px4_plane", "FW_AIRSPD_TRIM", {11.0: WARN}),
    ],
)
def test_preflight_grades_parameter_by_value(name, key, grades):
    for value, grade in grades.items():
        line = next(
            line
            for line in parameter(name, {key: float(value)})
            if line.text.startswith(f"{key} = ")
        )
        assert line.grade is grade, line.text


LATER = "as ardupilot copter without GPS: "


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("GUID_OPTIONS", 8, "bit 3: thrust 0.5 would be half of the full thrust"),
        ("FS_EKF_ACTION", 3, "lands even in modes that need no position"),
        ("ANGLE_MAX", 1500, "the copter tilts 15 deg at most, vehicle.max_bank_deg = 25"),
    ],
)
def test_preflight_checks_parameters_of_attitude_flight_after_gps_loss(key, value, text):
    """The mission of the copter may change from velocities to attitudes."""
    (line,) = [line for line in parameter("arducopter", {key: value}) if line.grade is FAIL]
    assert line.text.startswith(f"{key} = {value}") and f": {LATER}{text}" in line.text


def test_preflight_ignores_attitude_parameters_if_flight_ends_without_gps():
    mission = load_mission(CONFIG / "arducopter.toml", ['engage.on_gps_loss="exit"'])
    values = {**good("arducopter").listener.parameters, "GUID_OPTIONS": 8.0, "ANGLE_MAX": 1500.0}
    lines = judge(mission, Overridden(good("arducopter").listener, {"parameters": values}))
    assert [line for line in of(lines, "parameter") if line.grade is FAIL] == []
    assert not [line for line in lines if "GUIDED_NOGPS" in line.text and line.subject == "mode"]


def test_copter_needs_accelerations_after_gps_loss():
    """Without GPS the airspeed is measured by RAW_IMU."""
    streams = {**good("arducopter").listener.streams, 27: (25.0, 0.0)}
    (line,) = [
        line for line in changed_lines("arducopter", {"streams": streams}) if "RAW_IMU" in line.text
    ]
    assert line.grade is FAIL and "copter without GPS: the airspeed is measured by it" in line.text


COMPASSES = {"COMPASS_ENABLE": 1, "COMPASS_USE": 1, "COMPASS_USE2": 1, "COMPASS_USE3": 1}


@pytest.mark.parametrize("name", ["arducopter", "arduplane", "ardurover"])
@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({**COMPASSES, "COMPASS_USE": 0, "COMPASS_USE3": 0}, ""),
        ({"COMPASS_USE": 1}, ""),
        (
            {**dict.fromkeys(COMPASSES, 0), "COMPASS_ENABLE": 1},
            "no compass is used, so the heading",
        ),
        ({**COMPASSES, "COMPASS_ENABLE": 0}, "COMPASS_ENABLE = 0, so the heading drifts"),
        ({"EK3_SRC1_YAW": 1}, ""),
        ({"EK3_SRC1_YAW": 3}, ""),
        ({"EK3_SRC1_YAW": 2}, "heading by GPS alone, so the heading drifts without GPS"),
        ({"EK3_SRC1_YAW": 8}, "heading without a compass, so the heading drifts without GPS"),
    ],
    ids=str,
)
def test_preflight_warns_of_heading_without_compass(name, values, text):
    lines = [line for line in parameter(name, values) if FLIES_ON[1] not in line.text]
    warned = [line.text for line in lines if line.grade is WARN]
    assert [text in line for line in warned] == ([True] if text else [])


@pytest.mark.parametrize(("value", "grade"), [(0, PASS), (1, PASS), (5, WARN), (6, WARN)])
@pytest.mark.parametrize("name", ["px4_copter", "px4_copter_nogps", "px4_plane"])
def test_preflight_warns_of_px4_heading_without_compass(name, value, grade):
    lines = [line for line in parameter(name, {"EKF2_MAG_TYPE": value}) if "EKF2" in line.text]
    assert [line.grade for line in lines] == [grade]


@pytest.mark.parametrize(
    ("values", "fails"),
    [
        ({"MAN_DEADZONE": 0.1}, 0),
        ({"MAN_DEADZONE": 0.0}, 1),
        ({"MPC_HOLD_DZ": 0.1, "MPC_YAW_EXPO": 0.6}, 0),
        ({"MPC_HOLD_DZ": 0.0, "MPC_YAW_EXPO": 0.6}, 1),
        ({"MPC_HOLD_DZ": 0.1, "MPC_YAW_EXPO": 0.0}, 1),
    ],
    ids=str,
)
def test_preflight_checks_yaw_stick_parameters_of_each_px4_version(values, fails):
    """PX4 names the dead zone of the stick by its version, and has its curve up to 1.16."""
    held = {**good("px4_copter_nogps").listener.parameters}
    held.pop("MAN_DEADZONE")
    lines = changed_lines("px4_copter_nogps", {"parameters": {**held, **values}})
    lines = [line for line in of(lines, "parameter") if any(name in line.text for name in values)]
    assert len(lines) == len(values)
    assert [line.grade for line in lines].count(FAIL) == fails


@pytest.mark.parametrize(
    ("value", "text"), [(0, "no action"), (1, "the copter lands"), (2, "flies home (RTL)")]
)
def test_preflight_names_dead_reckoning_failsafe(value, text):
    lines = [
        line for line in parameter("arducopter", {"FS_DR_ENABLE": value}) if "FS_DR" in line.text
    ]
    assert [line.grade for line in lines] == [PASS, PASS]
    assert text in lines[0].text and LATER + "no action in GUIDED_NOGPS" in lines[1].text


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("arducopter", {"FS_THR_ENABLE": 1, "FS_OPTIONS": 4}),
        ("ardurover", {"FS_THR_ENABLE": 1, "FS_ACTION": 0}),
        ("px4_copter", {"NAV_RCL_ACT": 2, "COM_RCL_EXCEPT": 4}),
    ],
)
def test_preflight_warns_if_flight_continues_without_transmitter(name, values):
    lines = parameter(name, values)
    warned = [line for line in lines if line.text.startswith(f"{next(iter(values))} = ")]
    assert [line.grade for line in warned] == [WARN] and FLIES_ON[1] in warned[0].text


def sticks_lost(action, exceptions):
    return {"NAV_RCL_ACT": action, "COM_RCL_EXCEPT": exceptions}


@pytest.mark.parametrize(
    ("name", "values", "grade", "text"),
    [
        ("px4_plane", sticks_lost(2, 0), WARN, "does not stay there, but flies home (RTL)"),
        ("px4_plane", sticks_lost(3, 0), WARN, "does not stay there, but lands"),
        ("px4_plane", sticks_lost(1, 0), PASS, "NAV_RCL_ACT commands Hold, too"),
        ("px4_plane", sticks_lost(2, 2), PASS, "stays there without our stick messages"),
        # without WP_SPEED a rover drives at its cruise speed at most
        ("ardurover", {"WP_SPEED": 0, "CRUISE_SPEED": 2}, FAIL, "CRUISE_SPEED = 2"),
        ("ardurover", {"WP_SPEED": 5, "CRUISE_SPEED": 2}, PASS, "CRUISE_SPEED = 2"),
        # the parameter has another name and unit in each firmware version
        ("arducopter", {"MAV_GCS_SYSID": 255}, PASS, "MAV_GCS_SYSID = 255: "),
        ("arducopter", {"SYSID_MYGCS": 255}, PASS, "SYSID_MYGCS = 255: "),
        ("arducopter", {"WP_SPD": 4}, WARN, "WP_SPD = 4: "),
        ("arducopter", {"WPNAV_SPEED": 400}, WARN, "WPNAV_SPEED = 400 (4 m/s): "),
        ("arduplane", {"LIM_ROLL_CD": 4400}, FAIL, "LIM_ROLL_CD = 4400 (44 deg): "),
        # in GUIDED, the GUIDED action of the fence changes nothing
        ("arduplane", {"FENCE_ACTION": 6, "FENCE_ENABLE": 1}, FAIL, "FENCE_ACTION = 6: "),
        ("arduplane", {"FENCE_ACTION": 6, "FENCE_ENABLE": 0}, PASS, "FENCE_ACTION = 6: "),
        ("arduplane", {"FENCE_ACTION": 1, "FENCE_ENABLE": 1}, PASS, "FENCE_ACTION = 1: "),
        ("arduplane", {"LIM_ROLL_CD": 6500}, PASS, "LIM_ROLL_CD = 6500 (65 deg): "),
    ],
    ids=str,
)
def test_preflight_grades_parameter_by_related_parameters(name, values, grade, text):
    lines = parameter(name, {key: float(value) for key, value in values.items()}, only=True)
    (line,) = [line for line in lines if text in line.text]
    assert line.grade is grade
    assert [line for line in lines if line.grade is FAIL] == ([line] if grade is FAIL else [])


@pytest.mark.parametrize(
    ("name", "key", "parameter", "number", "stricter", "grade"),
    [
        ("ardurover", "vehicle.speed_mps", "WP_SPEED", 2.3, 2.28, FAIL),
        ("arducopter", "vehicle.speed_mps", "WP_SPD", 4.2, 4.18, WARN),
        ("arduplane", "vehicle.max_bank_deg", "ROLL_LIMIT_DEG", 42.3, 42.2, FAIL),
        ("arduplane", "vehicle.speed_mps", "AIRSPEED_MIN", 22.2, 22.3, FAIL),
        ("arduplane", "vehicle.speed_mps", "AIRSPEED_MAX", 22.3, 22.2, FAIL),
        ("px4_copter", "vehicle.max_turn_rate_deg_s", "MC_YAWRATE_MAX", 24.0, 23.9, FAIL),
    ],
)
def test_parameter_equal_to_limit_passes_despite_32_bit_rounding(
    name, key, parameter, number, stricter, grade
):
    """Parameters are 32-bit floats: 2.3 is rounded down, and 24 deg converted from radians is
    rounded up."""
    listener = good(name).listener
    mission = load_mission(CONFIG / f"{name}.toml", [f"{key}={number}"])
    for value, expected in ((number, PASS), (stricter, grade)):
        (in_32_bits,) = struct.unpack("<f", struct.pack("<f", value))
        values = {**listener.parameters, parameter: in_32_bits}
        lines = judge(mission, Overridden(listener, {"parameters": values}))
        (line,) = [line for line in lines if line.text.startswith(f"{parameter} = ")]
        assert line.grade is expected, line.text


def test_preflight_warns_of_unknown_parameter():
    lines = parameter("arducopter", {}, only=True)
    assert {line.grade for line in lines} == {WARN}
    words = "MAV_GCS_SYSID (from 4.7) or SYSID_MYGCS (up to 4.6): no answer"
    assert f"{words}, this version may not have it" in [line.text for line in lines]
    assert len(lines) == 6, "an optional fence has no line"


def test_preflight_reads_value_set_by_ground_station():
    bench = Bench("arducopter")
    bench.vehicle.receive(
        Voice(255, 190).pack(mavlink.MAVLink_param_set_message(1, 1, b"GUID_TIMEOUT", 7.0, 9))
    )
    assert bench.run().parameters["GUID_TIMEOUT"] == 7.0


@pytest.mark.parametrize(("seconds", "least"), [(5.0, 5), (0.5, 1)], ids=["lost", "slow"])
def test_preflight_requests_missing_parameters_again(seconds, least):
    draw = random.Random(5)
    bench = Bench("arducopter", seconds=seconds)
    bench.receives = lambda frame, now: (
        now > 2.6 or without(22)(frame, now) if seconds < 1 else draw.random() > 0.3
    )
    assert len(bench.run().parameters) >= least


def test_preflight_prints_vehicle_statustext():
    bench = Bench("arducopter")
    text = mavlink.MAVLink_statustext_message(4, b"PreArm: Compass not healthy")
    bench.speaks = twice_a_second((Voice(1, 1), text))
    assert [line.text for line in of(bench.lines(), "STATUSTEXT")] == [
        '"PreArm: Compass not healthy"'
    ]
