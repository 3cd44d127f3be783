"""A survey of each emulated vehicle in lockstep, and what is said of it: what is sent, what is seen, what is graded."""

import functools
import random
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.check_result import Check, Grade
from circnav_mav.mav.codec import LinkCounts
from circnav_mav.mission.load import load_mission
from circnav_mav.mission.mission import Mission
from circnav_mav.mission.preflight import judge
from circnav_mav.pilot import RANGING, VEHICLE
from circnav_mav.pilot.survey import Observations, RangeHeard, Survey
from sim.config import parse_vehicle
from sim.vehicle import Vehicle
from tests.flight.ground_station import Operator
from tests.rig import Voice, heartbeat

CONFIG = Path(__file__).parents[2] / "config"
MISSIONS = ("arducopter", "arduplane", "ardurover", "px4_copter", "px4_plane", "px4_plane_attitude")
HEARTBEAT, COMMAND_LONG, PARAM_REQUEST_READ, TIMESYNC = 0, 76, 20, 111
SET_MESSAGE_INTERVAL, REQUEST_MESSAGE = 511, 512
FAIL, WARN, PASS = Grade.FAIL, Grade.WARN, Grade.PASS


class Bench:
    """A mission's survey and its emulated vehicle, in lockstep; `speed`: how much faster the vehicle's time runs."""

    def __init__(self, name: str, *overrides: str, seconds: float = 5.0) -> None:
        self.mission = load_mission(CONFIG / f"{name}.toml", overrides)
        assert self.mission.file.sim is not None
        self.vehicle = Vehicle(parse_vehicle(self.mission.file.sim, name))
        self.survey = Survey(self.mission.pilot_settings(), seconds=seconds)
        self.sent: list[Any] = []
        self.speed = 1.0
        self.hears: Callable[[bytes, float], bool] = lambda frame, now: True
        self.speaks: Callable[[float], list[bytes]] = lambda now: []

    def with_keys(self, table: str, **keys: Any) -> "Bench":
        """The same with other values in a table of the mission, also with none where its file has one."""
        changed = getattr(self.mission.file, table).model_copy(update=keys)
        self.mission = replace(self.mission, file=self.mission.file.model_copy(update={table: changed}))
        self.survey = Survey(self.mission.pilot_settings(), seconds=5.0)
        return self

    def run(self) -> Observations:
        parser, now = mavlink.MAVLink(None), 0.0
        links = {"main": VEHICLE, **({"ranging": RANGING} if self.mission.file.ranging.endpoint else {})}
        while not self.survey.done:
            now = round(now + 0.01, 6)
            self.vehicle.advance(now * self.speed)
            for sim_link, link in links.items():
                for frame in self.vehicle.outgoing(sim_link):
                    if self.hears(frame, now):
                        self.survey.receive(frame, now, "sim", link)
            for frame in self.speaks(now):
                self.survey.receive(frame, now, "sim")
            out = self.survey.step(now)
            self.vehicle.receive(out)
            self.sent += parser.parse_buffer(bytearray(out)) or []
        return self.survey.observations()

    def lines(self) -> list[Check]:
        return judge(self.mission, self.run())


@functools.cache
def good_survey(name: str) -> tuple[Bench, Observations]:
    """The survey of a vehicle as it comes, to be looked at."""
    bench = Bench(name)
    return bench, bench.run()


def surveyed(name: str) -> tuple[Mission, Observations]:
    """What a good survey of a vehicle looks like, to be bent."""
    bench, seen = good_survey(name)
    return bench.mission, seen


def bent(name: str, **changes: Any) -> list[Check]:
    """The lines for a vehicle that was seen otherwise in something."""
    mission, seen = surveyed(name)
    assert seen.vehicle is not None
    own = {key: value for key, value in changes.items() if hasattr(seen.vehicle, key)}
    rest = {key: value for key, value in changes.items() if key not in own}
    return judge(mission, replace(seen, vehicle=replace(seen.vehicle, **own), **rest))


def parameter(name: str, values: dict[str, float], *, only: bool = False) -> list[Check]:
    """The lines about parameters for a vehicle that has other values."""
    seen = surveyed(name)[1].vehicle
    assert seen is not None
    return of(bent(name, parameters={**({} if only else seen.parameters), **values}), "parameter")


def of(lines: list[Check], subject: str) -> list[Check]:
    return [line for line in lines if line.subject == subject]


def one(lines: list[Check], subject: str) -> Check:
    (line,) = of(lines, subject)
    return line


def failing(lines: list[Check]) -> list[str]:
    return [line.subject for line in lines if line.grade is FAIL]


# --- every vehicle ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MISSIONS)
def test_every_bundled_vehicle_passes(name: str) -> None:
    lines = judge(*surveyed(name))
    assert failing(lines) == []
    assert {"vehicle", "firmware", "mode", "stream", "clock", "ranging", "noise", "parameter"} <= {
        line.subject for line in lines
    }


@pytest.mark.parametrize("name", MISSIONS)
def test_nothing_that_moves_anything_is_sent_and_streams_get_their_own_rates_back_at_the_end(name: str) -> None:
    bench, _ = good_survey(name)
    kinds = {message.get_msgId() for message in bench.sent}
    assert kinds == {HEARTBEAT, COMMAND_LONG, PARAM_REQUEST_READ, TIMESYNC}
    commands = [message for message in bench.sent if message.get_msgId() == COMMAND_LONG]
    assert {message.command for message in commands} == {SET_MESSAGE_INTERVAL, REQUEST_MESSAGE}
    last = {message.param1: message.param2 for message in commands if message.command == SET_MESSAGE_INTERVAL}
    assert set(last.values()) == {0.0}


@pytest.mark.parametrize("name", MISSIONS)
def test_the_vehicle_stays_as_it_was_even_in_our_mode(name: str) -> None:
    """Armed, in the very mode that is flown, range heard: a pilot would take it."""
    mode = {"arducopter": "GUIDED", "arduplane": "GUIDED", "ardurover": "GUIDED", "px4_plane": "ALTCTL"}.get(name)
    bench = Bench(name, *((f'sim.start.mode="{mode}"',) if mode else ()))
    before = bench.vehicle.truth
    lines = judge(bench.mission, bench.run())
    assert bench.vehicle.truth.armed == before.armed
    if mode:
        assert one(lines, "mode").grade is WARN
        assert "at once" in one(lines, "mode").says


@pytest.mark.parametrize("name", MISSIONS)
def test_every_parameter_that_the_vehicle_has_is_read_with_its_value(name: str) -> None:
    bench, seen = good_survey(name)
    assert seen.vehicle is not None
    table = bench.vehicle._flight.autopilot.params.all_values()
    held = {value.param_id: value.param_value if value.param_type == 9 else None for value in table}
    asked = {name for rule in seen.vehicle.adapter.parameters for name, _ in rule.names} & set(held)
    assert set(seen.vehicle.parameters) == asked
    assert {n: v for n, v in seen.vehicle.parameters.items() if held[n] is not None} == {
        n: pytest.approx(held[n]) for n in asked if held[n] is not None
    }
    assert seen.vehicle.parameters.get("COM_RC_IN_MODE", 1.0) in (0.0, 1.0, 2.0), "an integer of PX4 is read as one"


# --- what keys alone change -------------------------------------------------------------------------------------------

BEACON = (
    'ranging.endpoint="udpin:0.0.0.0:14560"', 'ranging.message="ranging_beacon"', "ranging.beacon_id=1",
    'sim.ranging.via="direct"', 'sim.ranging.message="ranging_beacon"',
)  # fmt: skip
ROVER = ("link.wait_s=2.0", 'sim.vehicle.profile="ardurover"', 'sim.start.mode="HOLD"')
LOW = ("orbit.height_above_target_m=95.0", "orbit.radius_m=60.0")


@pytest.mark.parametrize(
    ("keys", "subject", "grade", "says"),
    [
        (ROVER, "vehicle", FAIL, "ground_rover, the mission is for ardupilot copter"),
        (("link.wait_s=2.0", "sim.vehicle.mavlink_version=1"), "vehicle", FAIL, "MAVLink 1 only"),
        (("bounds.min_battery_percent=30.0", "sim.battery.percent=80.0"), "battery", PASS, "80 %"),
        (("bounds.min_battery_percent=30.0", "sim.battery.percent=25.0"), "battery", FAIL, "25 %"),
        (("ranging.orientation=0",), "ranging", FAIL, "1/192 id 0, orientation 24"),
        (("sim.ranging.rate_hz=0.0",), "ranging", FAIL, " frames"),
        (BEACON, "ranging", PASS, "10.0 Hz"),
        (("sim.ranging.rate_hz=10.0",), "ranging", PASS, "10.0 Hz"),
        (("sim.ranging.rate_hz=5.0",), "ranging", WARN, "5.0 Hz"),
        (("sim.ranging.rate_hz=1.5",), "ranging", FAIL, "Hz"),  # stale after 0.5 s
        (("sim.events=[{at_s=5.0, action='mute_ranging'}]",), "age", FAIL, "s old"),
        (LOW, "distance", WARN, "fine on the ground only"),
    ],
)
def test_a_line_of_a_copter_is_graded(keys: tuple[str, ...], subject: str, grade: Grade, says: str) -> None:
    line = one(Bench("arducopter", *keys).lines(), subject)
    assert (line.grade, says in line.says) == (grade, True), line.says


# --- nobody, or others ------------------------------------------------------------------------------------------------


def test_silence_is_told_with_what_was_heard() -> None:
    bench = Bench("arducopter", "link.wait_s=2.0")
    bench.hears = lambda frame, now: False
    seen = bench.run()
    assert seen.vehicle is None
    (line,) = judge(bench.mission, seen)
    assert (line.grade, line.subject) == (FAIL, "vehicle")
    assert "0 bytes heard" in line.says


def test_a_twin_of_ours_fails_and_another_vehicle_warns() -> None:
    bench, twin, other = Bench("arducopter"), Voice(1, 191), Voice(2, 1)
    bench.speaks = lambda now: (
        [twin.say(heartbeat(kind=18, autopilot=8)), other.say(heartbeat())] if round(now * 100) % 50 == 0 else []
    )
    lines = of(bench.lines(), "others")
    assert [line.grade for line in lines] == [FAIL, WARN]
    assert "191" in lines[0].says


def test_a_vehicle_that_falls_silent_fails() -> None:
    bench = Bench("arducopter")
    bench.hears = lambda frame, now: now < 4.0
    assert {"heartbeat", "age"} <= set(failing(bench.lines()))


# --- streams, motion, battery -----------------------------------------------------------------------------------------


def without(message_id: int) -> Callable[[bytes, float], bool]:
    return lambda frame, now: int.from_bytes(frame[7:10], "little") != message_id


@pytest.mark.parametrize(
    ("name", "keys", "message_id", "grade"),
    [
        ("arduplane", (), 74, FAIL),
        ("arducopter", (), 74, WARN),
        ("px4_copter", (), 74, FAIL),
        ("arducopter", (), 30, FAIL),
        ("arducopter", (), 1, WARN),
        ("arducopter", ("bounds.min_battery_percent=30.0",), 1, FAIL),  # the mission ends by it
        ("arducopter", (), 2, WARN),
        ("px4_copter", (), 436, WARN),
    ],
)
def test_a_missing_stream_is_graded_by_what_comes_with_it(
    name: str, keys: tuple[str, ...], message_id: int, grade: Grade
) -> None:
    bench = Bench(name, *keys)
    bench.hears = without(message_id)
    (line,) = [line for line in of(bench.lines(), "stream") if line.grade is not PASS]
    assert (line.grade, mavlink.mavlink_map[message_id].msgname in line.says) == (grade, True)


@pytest.mark.parametrize("name", MISSIONS)
def test_rates_are_measured_after_the_streams_have_come_up(name: str) -> None:
    """A vehicle that sends much unasked before it is asked for less must not look richer than it is."""
    seen = Bench(name, seconds=10.0).run()
    assert seen.vehicle is not None
    for wanted, measured in seen.vehicle.streams.values():
        assert measured == pytest.approx(wanted, rel=0.1)


@pytest.mark.parametrize(
    ("armed", "reported", "grade"), [(True, 0.0, FAIL), (False, 0.0, WARN), (False, float("nan"), FAIL)]
)
def test_a_plane_without_airspeed_fails_in_the_air_and_is_warned_of_on_the_ground(
    armed: bool, reported: float, grade: Grade
) -> None:
    vehicle = surveyed("arduplane")[1].vehicle
    assert vehicle is not None
    motion = replace(vehicle.motion, airspeed=None)
    line = one(bent("arduplane", motion=motion, airspeed_told=reported, armed=armed), "airspeed")
    assert (line.grade, "sensor" in line.says) == (grade, reported != 0.0)


# --- time -------------------------------------------------------------------------------------------------------------


def test_a_simulator_five_times_as_fast_needs_the_autopilots_clock() -> None:
    bench = Bench("arducopter")
    bench.speed = 5.0
    lines = bench.lines()
    line = one(lines, "clock")
    assert line.grade is FAIL
    assert "5.0" in line.says
    assert 'link.clock = "autopilot"' in line.says
    assert of(lines, "stamps") == []  # the same cause needs no second cure


def test_a_run_that_follows_the_autopilot_says_at_what_speed() -> None:
    bench = Bench("arducopter", 'link.clock="autopilot"')
    line = one(judge(bench.mission, bench.run(), clock_speed=5.0), "clock")
    assert (line.grade, "5.0" in line.says) == (PASS, True)


def test_frames_that_wait_in_a_busy_machine_are_not_another_clock_speed() -> None:
    bench, late = Bench("arducopter"), []

    def hears(frame: bytes, now: float) -> bool:
        if 2.0 <= now % 4.0 < 2.3:  # the first that is measured is among them
            late.append(frame)
            return False
        return True

    bench.hears = hears
    bench.speaks = lambda now: [late.pop(0) for _ in range(len(late))] if not 2.0 <= now % 4.0 < 2.3 else []
    line = one(bench.lines(), "clock")
    assert (line.grade, "1.00" in line.says) == (PASS, True), line.says


def test_a_reboot_while_listening_fails() -> None:
    bench = Bench("arducopter", "sim.events=[{at_s=4.0, action='reboot'}]", seconds=8.0)
    lines = of(bench.lines(), "clock")
    assert [line.grade for line in lines] == [FAIL, PASS]
    assert "rebooted 1 times" in lines[0].says


@pytest.mark.parametrize(
    ("changes", "subject", "grade"),
    [
        ({"round_trip": 0.02}, "round trip", PASS),
        ({"round_trip": 0.3}, "round trip", WARN),
        ({"round_trip": 0.8}, "round trip", FAIL),
        ({"round_trip": None}, "round trip", WARN),
        ({"firmware": None}, "firmware", WARN),
        ({"links": {VEHICLE: LinkCounts(frames=100)}}, "MAVLink", PASS),
        ({"links": {VEHICLE: LinkCounts(frames=100, version_1=3)}}, "MAVLink", WARN),
        ({"armed": True, "mode": 4}, "mode", WARN),  # a flight would take the vehicle at once
        ({"armed": True, "mode": 5}, "mode", PASS),
        ({"armed": False, "mode": 4}, "mode", PASS),
    ],
)
def test_what_was_seen_of_a_copter_is_graded(changes: dict[str, Any], subject: str, grade: Grade) -> None:
    assert one(bent("arducopter", **changes), subject).grade is grade


@pytest.mark.parametrize(
    ("name", "needed"), [("arduplane", {"airspeed"}), ("px4_copter", {"height"}), ("arducopter", set())]
)
def test_what_this_vehicle_is_flown_without_is_called_not_needed(name: str, needed: set[str]) -> None:
    lines = judge(*surveyed(name))
    told = {subject: one(lines, subject) for subject in ("airspeed", "height")}
    assert {line.grade for line in told.values()} == {PASS}
    assert {subject for subject, line in told.items() if not line.says.endswith("not needed")} == needed


# --- ranging ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("noise", "grade"), [(0.05, PASS), (0.5, PASS), (1.2, WARN), (3.0, FAIL)])
def test_noise_is_measured_against_what_the_mission_assumes(noise: float, grade: Grade) -> None:
    line = one(Bench("arducopter", f"sim.ranging.noise_m={noise}", seconds=20.0).lines(), "noise")
    assert line.grade is grade
    assert float(line.says.split()[0]) == pytest.approx(noise, rel=0.25, abs=0.02)


@pytest.mark.parametrize("heard", [12, 50])
def test_an_honest_radio_is_not_doubted_for_want_of_ranges(heard: int) -> None:
    """Few ranges scatter in their scatter: of 300 short surveys of the noise that the mission states, at most three
    may ask for another sigma_m, and none may fail."""
    grades = []
    for seed in range(300):
        draw = random.Random(seed)
        ranges = tuple(RangeHeard(i / 10, i / 10, i / 10, 50 + draw.gauss(0, 0.5), 0.5) for i in range(heard))
        lines = bent("arducopter", ranges=ranges, end=heard / 10, seconds=heard / 10)
        grades.append(one(lines, "noise").grade)
    assert grades.count(WARN) <= 3
    assert FAIL not in grades


def test_neither_outliers_nor_gaps_nor_motion_count_as_noise() -> None:
    """A range that shrinks at 20 m/s and bends at 4 m/s^2, every fifth one lost, one of twenty off by 30 m."""
    draw, ranges = random.Random(3), []
    for i in range(600):
        t = i / 10
        off = 30.0 if i % 20 == 7 else 0.0
        if i % 5:
            ranges.append(RangeHeard(t, t, t, 2000 - 20 * t + 2 * t * t + off + draw.gauss(0, 0.5), 0.5))
    lines = bent("arducopter", ranges=tuple(ranges), end=60.0, seconds=60.0)
    assert float(one(lines, "noise").says.split()[0]) == pytest.approx(0.5, rel=0.15)
    assert one(lines, "outliers").grade is WARN or "5 %" in one(lines, "outliers").says


def unnamed_px4() -> Bench:
    """Whose mission does not name the radio's component."""
    return Bench("px4_copter").with_keys("ranging", component_id=None)


def test_the_echo_of_the_radios_ranges_is_no_fault() -> None:
    """PX4 sends a forwarded DISTANCE_SENSOR a second time under its own id, in every flight."""
    line = one(unnamed_px4().lines(), "rejected")
    assert (line.grade, "wrong_source" in line.says) == (PASS, True)


def test_several_senders_are_warned_of_unless_the_mission_names_ours() -> None:
    named, unnamed = Bench("px4_copter", "ranging.component_id=192"), unnamed_px4()
    radio = Voice(1, 193)
    for bench in (named, unnamed):
        bench.speaks = lambda now: (
            [radio.say(mavlink.MAVLink_distance_sensor_message(round(now * 1000), 20, 60000, 9000, 4, 0, 24, 0))]
            if round(now * 100) % 10 == 0
            else []
        )
    assert one(named.lines(), "rejected").grade is PASS
    line = one(unnamed.lines(), "rejected")
    assert (line.grade, "component_id" in line.says) == (WARN, True)


@pytest.mark.parametrize(
    ("speed", "heard", "rest", "grade", "says"),
    [
        (0, 50, {}, WARN, "the messages carry no time"),
        (2, 50, {}, FAIL, 'set ranging.stamp = "arrival"'),
        (2, 50, {"boot": None}, FAIL, 'set ranging.stamp = "arrival"'),
        (2, 3, {}, WARN, "too few to tell"),
    ],
)
def test_stamps_without_time_or_of_a_clock_at_another_speed_are_found(
    speed: float, heard: int, rest: dict[str, None], grade: Grade, says: str
) -> None:
    ranges = surveyed("arducopter")[1].ranges[:heard]
    ranges = tuple(replace(one, stamp=speed * one.stamp if speed else one.arrival) for one in ranges)
    line = one(bent("arducopter", ranges=ranges, **rest), "stamps")
    assert (line.grade, says in line.says) == (grade, True), line.says


def test_a_range_that_never_changes_is_no_pass() -> None:
    still = tuple(replace(one, r=150.0) for one in surveyed("arducopter")[1].ranges)
    line = one(bent("arducopter", ranges=still), "noise")
    assert (line.grade, "a frozen radio" in line.says) == (WARN, True)


RADIO = (
    "ranging.message=named_value_float", "ranging.rate_name=RR", "ranging.rate_sigma_mps=0.2",
    "sim.ranging.message=named_value_float",
)  # fmt: skip
SENDS = "sim.ranging.rate_name=RR"


@pytest.mark.parametrize(
    ("keys", "grade", "says"),
    [
        ((SENDS,), PASS, " Hz, newest "),
        ((SENDS, "sim.ranging.rate_noise_mps=0.8"), WARN, "set ranging.rate_sigma_mps to it"),
        ((), FAIL, "0 NAMED_VALUE_FLOAT RR"),
        ((SENDS, "sim.ranging.rate_noise_mps=0.0", "sim.ranging.rate_bias_mps=0.0"), WARN, "frozen, or too"),
        ((SENDS, "sim.ranging.rate_bias_mps=20.0"), FAIL, "ranges change by"),
    ],
)
def test_the_range_rate_is_judged_by_its_rate_its_noise_and_the_ranges(
    keys: tuple[str, ...], grade: Grade, says: str
) -> None:
    line = one(Bench("quickstart", *RADIO, *keys).lines(), "range rate")
    assert (line.grade, says in line.says) == (grade, True), line.says


def test_without_the_key_nothing_is_said_of_a_range_rate() -> None:
    assert of(Bench("quickstart").lines(), "range rate") == []


def by_home(*overrides: str) -> Bench:
    """The plane with its height told by the beacon's place above home."""
    return Bench("arduplane", *overrides).with_keys("orbit", height_above_target_m=None, target_above_home_m=5.0)


def test_a_height_by_the_altitude_is_told_with_what_a_metre_of_it_costs() -> None:
    lines = by_home("sim.start.altitude_m=80.0").lines()
    line = one(lines, "height cost")
    assert (line.grade, line.says[:68]) == (
        WARN,
        "1 m of error in the height of 75.0 m above the target is 0.50 m of r",
    )
    assert one(lines, "distance").says.endswith("on the map at 75.0 m above the target")
    assert "HOME_POSITION" in str([line.says for line in of(lines, "stream")])


def test_a_height_above_a_home_that_is_not_told_fails() -> None:
    bench = by_home()
    bench.hears = lambda frame, now: frame[7:10] != b"\xf2\x00\x00"
    line = one(bench.lines(), "height cost")
    assert (line.grade, line.says.startswith("no home altitude (HOME_POSITION)")) == (FAIL, True)


# --- parameters -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "key", "grades"),
    [
        ("arducopter", "GUID_TIMEOUT", {0.05: FAIL, 0.3: WARN, 3.0: PASS, 10.0: WARN}),
        ("arducopter", "GUID_OPTIONS", {1 << 5: WARN, 1 << 2: PASS}),
        ("arducopter", "FS_GCS_ENABLE", {1: WARN}),
        ("arducopter", "SYSID_MYGCS", {1: WARN}),
        ("arducopter", "FS_EKF_ACTION", {0: WARN}),
        ("arducopter", "FENCE_ENABLE", {0: PASS, 1: WARN}),
        ("arducopter", "WPNAV_SPEED", {500.0: PASS, 499.0: WARN}),
        ("arduplane", "ROLL_LIMIT_DEG", {45.0: PASS, 44.0: FAIL}),
        ("arduplane", "AIRSPEED_CRUISE", {23.0: PASS, 25.0: WARN, 15.0: FAIL}),
        ("arduplane", "AIRSPEED_MIN", {23.0: FAIL}),
        ("arduplane", "AIRSPEED_MAX", {21.0: FAIL}),
        ("arduplane", "FS_GCS_ENABL", {1: WARN}),
        ("ardurover", "WP_SPEED", {2.0: FAIL, 0.0: PASS}),
        ("ardurover", "FS_GCS_ENABLE", {1: WARN}),
        ("px4_copter", "COM_OF_LOSS_T", {0.05: FAIL}),
        ("px4_copter", "COM_OBL_RC_ACT", {5: PASS, 7: FAIL}),
        ("px4_copter", "MC_YAWRATE_MAX", {30.0: FAIL}),
        ("px4_copter", "COM_RC_IN_MODE", {1: WARN, 0: PASS}),
        ("px4_copter", "MAV_FWDEXTSP", {0: FAIL}),
        ("px4_plane", "COM_RC_IN_MODE", {0: FAIL, 4: FAIL, 3: WARN}),
        ("px4_plane", "COM_RC_LOSS_T", {0.05: FAIL}),
        ("px4_plane", "NAV_RCL_ACT", {1: PASS, 2: PASS, 6: FAIL, 0: WARN}),
        ("px4_plane", "COM_RCL_EXCEPT", {0: WARN, 5: WARN, 3: PASS}),
        ("px4_plane", "FW_R_LIM", {45.0: FAIL}),
        ("px4_plane", "FW_AIRSPD_TRIM", {11.0: WARN}),
        ("px4_plane_attitude", "MAV_FWDEXTSP", {0: FAIL}),
    ],
)
def test_a_parameter_is_graded_by_what_it_implies(name: str, key: str, grades: dict[float, Grade]) -> None:
    for value, grade in grades.items():
        (line,) = [line for line in parameter(name, {key: float(value)}) if line.says.startswith(f"{key} = ")]
        assert line.grade is grade, line.says


@pytest.mark.parametrize(
    ("action", "excepted", "grade", "says"),
    [
        (2, 0, WARN, "does not stay there, it flies home (RTL)"),
        (3, 0, WARN, "does not stay there, it lands"),
        (1, 0, PASS, "Hold is also what NAV_RCL_ACT asks for"),
        (2, 2, PASS, "stays there without our sticks"),
    ],
)
def test_a_px4_plane_flown_by_stick_is_told_where_it_goes_when_our_sticks_end(
    action: int, excepted: int, grade: Grade, says: str
) -> None:
    bench = Bench("px4_plane")
    operator = Operator(bench.vehicle)
    operator.set_px4_integer("NAV_RCL_ACT", action)
    operator.set_px4_integer("COM_RCL_EXCEPT", excepted)
    (line,) = [line for line in bench.lines() if line.says.startswith("COM_RCL_EXCEPT = ")]
    assert (line.grade, says in line.says) == (grade, True), line.says


def in_32_bits(value: float) -> float:
    (held,) = struct.unpack("<f", struct.pack("<f", value))
    return float(held)


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
def test_a_limit_that_is_the_missions_own_number_is_within_it(
    name: str, key: str, parameter: str, number: float, stricter: float, grade: Grade
) -> None:
    """In 32 bits 2.3 is less than 2.3, and 24 degrees are a last bit more once they have been radians."""
    seen, mission = surveyed(name)[1], load_mission(CONFIG / f"{name}.toml", [f"{key}={number}"])
    assert seen.vehicle is not None
    for value, expected in ((number, PASS), (stricter, grade)):
        values = {**seen.vehicle.parameters, parameter: in_32_bits(value)}
        lines = of(judge(mission, replace(seen, vehicle=replace(seen.vehicle, parameters=values))), "parameter")
        (line,) = [line for line in lines if line.says.startswith(f"{parameter} = ")]
        assert line.grade is expected, line.says


def test_a_rover_without_wp_speed_is_clipped_at_its_cruise_speed() -> None:
    lines = parameter("ardurover", {"WP_SPEED": 0.0, "CRUISE_SPEED": 2.0})
    assert [line.says.split()[0] for line in lines if line.grade is FAIL] == ["CRUISE_SPEED"]
    assert failing(parameter("ardurover", {"WP_SPEED": 5.0, "CRUISE_SPEED": 2.0})) == []


@pytest.mark.parametrize(
    ("name", "key", "value", "says", "grade"),
    [
        ("arducopter", "MAV_GCS_SYSID", 255.0, "255: ", PASS),
        ("arducopter", "SYSID_MYGCS", 255.0, "255: ", PASS),
        ("arducopter", "WP_SPD", 4.0, "4: ", WARN),
        ("arducopter", "WPNAV_SPEED", 400.0, "400 (4 m/s): ", WARN),
        ("arduplane", "LIM_ROLL_CD", 4400.0, "4400 (44 deg): ", FAIL),
        ("arduplane", "LIM_ROLL_CD", 6500.0, "6500 (65 deg): ", PASS),
    ],
)
def test_a_parameter_is_known_by_its_name_and_unit_in_the_connected_version(
    name: str, key: str, value: float, says: str, grade: Grade
) -> None:
    (line,) = [line for line in parameter(name, {key: value}, only=True) if "no answer" not in line.says]
    assert (line.grade, line.says.startswith(f"{key} = {says}")) == (grade, True), line.says


def test_a_parameter_that_the_vehicle_does_not_know_is_said_and_not_fatal() -> None:
    lines = parameter("arducopter", {}, only=True)
    assert {line.grade for line in lines} == {WARN}
    assert "MAV_GCS_SYSID or SYSID_MYGCS: no answer, this version may not have it" in [line.says for line in lines]
    assert len(lines) == 6, "and nothing of the fence, which is optional"


def test_a_value_set_by_a_ground_station_is_what_is_read() -> None:
    bench = Bench("arducopter")
    bench.vehicle.receive(Voice(255, 190).say(mavlink.MAVLink_param_set_message(1, 1, b"GUID_TIMEOUT", 7.0, 9)))
    seen = bench.run()
    assert seen.vehicle is not None
    assert seen.vehicle.parameters["GUID_TIMEOUT"] == 7.0


def test_lost_datagrams_do_not_lose_parameters() -> None:
    draw = random.Random(5)
    bench = Bench("arducopter")
    bench.hears = lambda frame, now: draw.random() > 0.3
    seen = bench.run()
    assert seen.vehicle is not None
    assert len(seen.vehicle.parameters) >= 5


def test_slow_answers_are_waited_for_beyond_the_time_to_listen() -> None:
    bench = Bench("arducopter", seconds=0.5)
    bench.hears = lambda frame, now: now > 2.6 or without(22)(frame, now)
    seen = bench.run()
    assert seen.vehicle is not None
    assert len(seen.vehicle.parameters) > 0


def test_troubles_that_the_vehicle_tells_are_repeated() -> None:
    bench, vehicle = Bench("arducopter"), Voice(1, 1)
    text = mavlink.MAVLink_statustext_message(4, b"PreArm: Compass not healthy")
    bench.speaks = lambda now: [vehicle.say(text)] if round(now * 100) == 400 else []
    assert [line.says for line in of(bench.lines(), "says")] == ['"PreArm: Compass not healthy"']
