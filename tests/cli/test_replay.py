"""`circnav replay`: what it says, and one line for every log that cannot be replayed."""

import csv
import re
import struct
from statistics import mean

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.runlog.tlog import message_id, read_tlog
from tests.flight.recorded import recorded_flight


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flown")
    recorded_flight(folder, "quickstart", "limits.duration_s=10").fly(20).recorder.close()
    return folder


def copy_of(folder, to, leave_out=()):
    to.mkdir(exist_ok=True)
    for path in folder.iterdir():
        if path.name not in leave_out:
            (to / path.name).write_bytes(path.read_bytes())
    return to


def test_a_run_replayed_as_it_was_says_byte_for_byte(circnav, flown):
    ran = circnav("replay", flown)
    assert (ran.code, ran.err) == (0, "")
    assert "byte for byte the same" in ran.out
    assert "range rate       the same" in ran.out
    assert "completed: flown to its end" in ran.out


def test_another_law_is_told_apart_and_drawn(circnav, flown, tmp_path):
    ran = circnav("replay", flown / "flight.tlog", "--law", "switching", "--out", tmp_path / "what-if")
    assert ran.code == 0
    assert "first frame that differs" in ran.out
    assert (tmp_path / "what-if" / "replay.png").read_bytes().startswith(b"\x89PNG")
    assert len((tmp_path / "what-if" / "ticks.csv").read_text().splitlines()) > 100


@pytest.fixture(scope="module")
def circling(tmp_path_factory):
    """Long enough on the circle for the turn-rate gain to be learnt."""
    folder = tmp_path_factory.mktemp("circling")
    recorded_flight(folder, "quickstart", "limits.duration_s=80").fly(90).recorder.close()
    return folder


def late(folder, column):
    """A column of ticks.csv from second 60 to 75, on the circle."""
    with (folder / "ticks.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if 60 < float(row["time"]) < 75]
    return [float(row[column]) for row in rows if row[column]]


def test_another_law_is_not_taught_by_headings_that_answer_the_turns_that_were_flown(circnav, circling, tmp_path):
    """The vehicle turns as it is told, and on the circle the mean of the paper's first law is the circle's own turn."""
    ran = circnav("replay", circling, "--law", "smooth", "--out", tmp_path / "smooth")
    assert mean(late(circling, "turn_gain")) == pytest.approx(1, abs=0.02)
    assert mean(late(tmp_path / "smooth", "turn_gain")) == pytest.approx(1, abs=0.02)
    assert mean(late(tmp_path / "smooth", "turn_rate")) == pytest.approx(-0.15, abs=0.01)
    assert "turn gain  held at" in ran.out


def test_a_gain_that_was_given_is_not_learnt_of_turns_that_were_commanded_with_it(circnav, tmp_path):
    recorded_flight(tmp_path, "quickstart", "limits.duration_s=10", "vehicle.turn_gain=0.8").fly(15).recorder.close()
    ran = circnav("replay", tmp_path, "--set", 'vehicle.turn_gain="learn"', "--out", tmp_path / "learning")
    assert "turn gain  held at 0.8" in ran.out
    assert "turn rate        the same" in ran.out


def test_another_duration_alone_is_replayed_with_the_gain_as_it_was_learnt(circnav, flown):
    ran = circnav("replay", flown, "--set", "limits.duration_s=5")
    assert "turn gain" not in ran.out
    assert "turn rate        the same" in ran.out


def test_a_plain_tlog_is_replayed_with_a_mission(circnav, flown, tmp_path, config):
    log = tmp_path / "yesterday.tlog"
    log.write_bytes((flown / "flight.tlog").read_bytes())
    ran = circnav("replay", log, "--mission", config / "quickstart.toml", "--set", "orbit.radius_m=80")
    assert ran.code == 0
    assert "steering" in ran.out


@pytest.mark.parametrize(
    ("make", "options", "code", "says"),
    [
        (lambda flown, to: to / "nowhere", [], 2, "no such run folder"),
        (lambda flown, to: emptied_folder(to), [], 2, "is not a run folder"),
        (lambda flown, to: copy_of(flown, to, ["turns.csv"]), [], 2, "has no turns.csv"),
        (lambda flown, to: copy_of(flown, to, ["manifest.json"]), [], 2, "epoch_us"),
        (lambda flown, to: emptied(copy_of(flown, to)), [], 3, "an empty run"),
        (lambda flown, to: flown, ["--law", "spiral"], 2, "guidance.law: 'spiral' is not one of"),
        (lambda flown, to: flown, ["--estimator", "guess"], 2, "guidance.estimator: 'guess' is not"),
        (lambda flown, to: written(to, b"not a log"), ["--mission", "QUICKSTART"], 3, "no MAVLink frame in it"),
        (lambda flown, to: written(to, b""), ["--mission", "QUICKSTART"], 3, "no MAVLink frame in it"),
        (lambda flown, to: written(to, b""), [], 2, "a plain tlog needs --mission"),
        (lambda flown, to: written(to, b""), ["--mission", "no.toml"], 2, "cannot be read"),
    ],
    ids=[f"{number}" for number in range(11)],
)
def test_what_cannot_be_replayed_is_one_line(circnav, flown, tmp_path, config, make, options, code, says):
    log = make(flown, tmp_path / "run")
    ran = circnav("replay", log, *(config / "quickstart.toml" if o == "QUICKSTART" else o for o in options))
    assert ran.code == code
    assert says in ran.line


def emptied(folder):
    for name in ("flight.tlog", "turns.csv", "ticks.csv"):
        (folder / name).write_bytes(b"")
    return folder


def written(to, data):
    to.mkdir()
    (to / "x.tlog").write_bytes(data)
    return to / "x.tlog"


def test_a_log_without_ranging_says_what_is_missing(circnav, flown, tmp_path, config):
    log = tmp_path / "x.tlog"
    log.write_bytes((flown / "flight.tlog").read_bytes())
    ran = circnav("replay", log, "--mission", config / "quickstart.toml", "--set", "ranging.message=ranging_beacon")
    assert ran.code == 3
    assert "0 ranges of ranging_beacon taken" in ran.line


def records_of(flown):
    """The (stamp, frame) pairs of the flight as a plain tlog has them, ours among them."""
    return list(read_tlog(flown / "flight.tlog"))


def log_of(records, to):
    to.write_bytes(b"".join(struct.pack(">Q", stamp) + frame for stamp, frame in records))
    return to


def test_a_clock_that_was_set_while_the_log_was_written_is_one_warning(circnav, flown, tmp_path, config):
    records = [(us - 3_600_000_000 * (at > 500), frame) for at, (us, frame) in enumerate(records_of(flown))]
    ran = circnav("replay", log_of(records, tmp_path / "x.tlog"), "--mission", config / "quickstart.toml")
    assert ran.code == 0
    assert ran.out.count("WARNING    x.tlog: its clock steps 1 time by -3600.0 s") == 1
    steering = int(re.search(r"(\d+) of them steering", ran.out)[1])
    assert steering > 100


@pytest.mark.parametrize("stamp", [0, 1_790_000_000_000_000])
def test_a_log_without_time_is_one_line(circnav, flown, tmp_path, config, stamp):
    log = log_of([(stamp, frame) for _, frame in records_of(flown)], tmp_path / "x.tlog")
    ran = circnav("replay", log, "--mission", config / "quickstart.toml")
    assert ran.code == 3
    assert "its stamps never go on" in ran.line


def with_more(flown, to, *, orientation=24, ident=0, sender=(1, 33), vehicle=()):
    """The flight with another range sensor beside each of its ranges, and heartbeats of another vehicle."""
    more = []
    link = mavlink.MAVLink(None, *sender)
    for at, (stamp, frame) in enumerate(records_of(flown)):
        more.append((stamp, frame))
        if message_id(frame) == mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR:
            boot = (stamp - more[0][0]) // 1000 + 1
            message = mavlink.MAVLink_distance_sensor_message(boot, 1, 60000, 5000 + at % 7, 3, ident, orientation, 255)
            more.append((stamp, bytes(message.pack(link))))
            for system in vehicle:
                beat = mavlink.MAVLink_heartbeat_message(2, 3, 0x81, 4, 4, 3)
                more.append((stamp, bytes(beat.pack(mavlink.MAVLink(None, system, 1)))))
    return log_of(more, to)


def test_a_plain_replay_says_whose_data_it_used(circnav, flown, tmp_path, config):
    log = with_more(flown, tmp_path / "x.tlog", orientation=25, vehicle=(7,))
    ran = circnav("replay", log, "--mission", config / "quickstart.toml")
    assert ran.code == 0
    assert "vehicle    system 1, component 1: ardupilotmega quadrotor, flown as ardupilot copter" in ran.out
    assert re.search(r"ranging    DISTANCE_SENSOR of 1/\d+ \(id \d+, orientation 24\): \d+ of \d+ usable", ran.out)
    assert re.search(r"unused     DISTANCE_SENSOR of 1/33 \(id 0, orientation 25\): \d+", ran.out)
    assert re.search(r"others     system 7, component 1: ardupilotmega quadrotor, \d+ heartbeats", ran.out)
    assert "WARNING" not in ran.out


@pytest.mark.parametrize(
    ("other", "key", "done"),
    [
        ({"sender": (1, 33)}, "ranging.component_id", "the first heard was taken"),
        ({"sender": (9, None)}, "ranging.system_id", "the first heard was taken"),
        ({"sender": (1, None), "ident": 5}, "ranging.sensor_id", "their ranges were mixed"),
        ({"sender": (1, None), "orientation": 2}, "ranging.orientation", "their ranges were mixed"),
    ],
)
def test_sensors_that_fit_the_mission_alike_are_warned_of_with_the_key_that_chooses(
    circnav, flown, tmp_path, config, other, key, done
):
    ours = next(frame for _, frame in records_of(flown) if message_id(frame) == mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR)
    system, component = other["sender"]
    sender = (system, ours[6] if component is None else component)
    mission = tmp_path / "any_orientation.toml"
    text = (config / "quickstart.toml").read_text()
    mission.write_text(text.replace("orientation = 24", "# left out:", 1))
    log = with_more(flown, tmp_path / "x.tlog", **other | {"sender": sender})
    ran = circnav("replay", log, "--mission", mission)
    assert f"WARNING    2 sensors fit the mission, {done}: name yours with {key}\n" in ran.out
    named = {"ranging.component_id": sender[1], "ranging.system_id": 1, "ranging.sensor_id": 0,
             "ranging.orientation": 24}[key]  # fmt: skip
    ran = circnav("replay", log, "--mission", mission, "--set", f"{key}={named}")
    assert ran.code == 0
    assert "sensors fit" not in ran.out


def test_a_log_with_ranges_of_another_message_names_their_sender(circnav, flown, tmp_path, config):
    log = log_of(records_of(flown), tmp_path / "x.tlog")
    ran = circnav("replay", log, "--mission", config / "quickstart.toml", "--set", "ranging.message=named_value_float")
    assert ran.code == 3
    assert "unused     DISTANCE_SENSOR of 1/192 (id 0, orientation 24): 111" in ran.out
    assert "NAMED_VALUE" not in ran.out


def test_a_run_that_never_steered_exits_as_a_plain_log_does(circnav, tmp_path, config):
    """No range ever comes: the flight ends with nothing heard, and so does its replay, however it is replayed."""
    recorded_flight(tmp_path / "run", "quickstart", "limits.duration_s=5", "link.wait_s=2", "ranging.sensor_id=9").fly(
        20
    ).recorder.close()
    folder = circnav("replay", tmp_path / "run")
    assert folder.code == 3
    assert "byte for byte the same" in folder.out
    assert "nothing to steer by: no " in folder.line
    log = log_of(records_of(tmp_path / "run"), tmp_path / "x.tlog")
    plain = circnav("replay", log, "--mission", config / "quickstart.toml", "--set", "ranging.sensor_id=9")
    assert plain.code == 3
    assert "nothing to steer by: 0 ranges" in plain.line


def test_a_replay_that_ends_before_its_log_says_when(circnav, flown):
    ran = circnav("replay", flown, "--set", "limits.duration_s=3")
    assert ran.code == 0
    assert re.search(r"completed: flown to its end \(at \d\.\d s; the log goes on to 1\d\.\d s\)", ran.out)
    assert "stalled" not in ran.out


def test_an_empty_name_is_no_folder_to_write_to(circnav, flown, tmp_path):
    assert circnav("replay", flown, "--out", "").line == "circnav: --out: is empty, give it a name"
    assert list(tmp_path.iterdir()) == []


def test_a_gain_of_another_law_is_not_taken_over(circnav, tmp_path, config):
    recorded_flight(tmp_path / "run", "paper_example_1", "limits.duration_s=2").fly(5).recorder.close()
    ran = circnav("replay", tmp_path / "run", "--law", "switching")
    assert ran.code == 2
    assert "belongs to the law smooth" in ran.line


def emptied_folder(to):
    to.mkdir()
    return to
