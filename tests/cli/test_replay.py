"""`circnav replay`: its output, and one line for every log that cannot be replayed."""

import csv
import re
import struct
from statistics import mean

import pytest

from circnav_mav.runlog.tlog import read_tlog
from tests.flight.recorded import recorded_flight


def test_unchanged_replay_is_identical(circnav, flown):
    out = circnav("replay", flown).done
    assert "byte for byte the same" in out
    assert "range rate       the same" in out
    assert "completed: flown to its end" in out
    errors = r"truth .*: range 0\.\d+ m, range rate \d\.\d+ m/s, position \d"
    assert re.search(errors, out)
    out = circnav("replay", flown, "--set", "limits.duration_s=3").done
    assert "turn gain" not in out
    assert "turn rate        the same" in out
    assert re.search(
        r"completed: flown to its end \(at \d\.\d s; the log goes on to 1\d\.\d s\)", out
    )
    assert "stalled" not in out


def test_replay_of_another_law_differs(circnav, flown, tmp_path):
    out = circnav(
        "replay", flown / "flight.tlog", "--law", "switching", "--out", tmp_path / "what-if"
    ).done
    assert "first difference: a frame at" in out
    assert (tmp_path / "what-if" / "replay.png").read_bytes().startswith(b"\x89PNG")
    assert len((tmp_path / "what-if" / "ticks.csv").read_text().splitlines()) > 100


def late(folder, column):
    """Return the mean of a column of ticks.csv from 30 to 40 s, on the circle."""
    with (folder / "ticks.csv").open(newline="") as file:
        return mean(
            float(row[column])
            for row in csv.DictReader(file)
            if 30 < float(row["time"]) < 40 and row[column]
        )


def test_replay_with_other_settings_uses_recorded_vehicle_response(circnav, tmp_path):
    """The recorded vehicle turns as commanded by the flight, not by the replay. On the circle the
    mean of the paper's first law is the circle's turn rate."""
    circling = tmp_path / "run"
    recorded_flight(circling, "quickstart", "limits.duration_s=40").fly(50).recorder.close()
    out = circnav("replay", circling, "--estimator", "kalman").done
    assert "completed: flown to its end" in out
    out = circnav("replay", circling, "--law", "smooth", "--out", tmp_path / "smooth").done
    assert late(circling, "turn_gain") == pytest.approx(1, abs=0.02)
    assert late(tmp_path / "smooth", "turn_gain") == pytest.approx(1, abs=0.02)
    assert late(tmp_path / "smooth", "turn_rate") == pytest.approx(-0.15, abs=0.01)
    assert "completed: flown to its end" in out


def test_replay_with_learned_gain_uses_flown_commands(circnav, tmp_path):
    recorded_flight(tmp_path, "quickstart", "limits.duration_s=10", "vehicle.turn_gain=0.8").fly(
        15
    ).recorder.close()
    out = circnav("replay", tmp_path, "--set", 'vehicle.turn_gain="learn"').done
    assert "response   learned from the commands of the flight" in out
    assert re.search(r"turn rate        differs by 0.0\d+ rad/s RMS", out)


def without(run, *names):
    for name in names:
        (run / name).unlink()
    return run


def emptied(run):
    for name in ("flight.tlog", "steps.csv", "ticks.csv"):
        (run / name).write_bytes(b"")
    return run


def plain(run, data=b""):
    (run / "x.tlog").write_bytes(data)
    return run / "x.tlog"


REFUSED = {
    "no log": (lambda run: without(run, "flight.tlog"), "", 2, "is not a run folder"),
    "no steps": (lambda run: without(run, "steps.csv"), "", 2, "has no steps.csv"),
    "no manifest": (lambda run: without(run, "manifest.json"), "", 2, "epoch_us"),
    "empty": (emptied, "", 3, "nothing to replay: flight.tlog or steps.csv is empty, or damaged"),
    "law": (lambda run: run, "--law spiral", 2, "guidance.law: 'spiral' is not one of"),
    "estimator": (lambda run: run, "--estimator guess", 2, "guidance.estimator: 'guess' is not"),
    "gain": (lambda run: run, "--law smooth --set guidance.gain=1e-9", 2, "refused by its checks"),
    "no tlog": (lambda run: plain(run, b"x"), "--mission quickstart", 3, "no MAVLink frame in it"),
    "empty tlog": (plain, "--mission quickstart", 3, "no MAVLink frame in it"),
    "no mission": (plain, "", 2, "a plain tlog needs --mission"),
    "missing mission": (plain, "--mission no.toml", 2, "cannot be read"),
}


@pytest.mark.parametrize(("make", "options", "code", "error"), REFUSED.values(), ids=REFUSED)
def test_impossible_replay_is_refused_in_one_line(circnav, run, make, options, code, error):
    ran = circnav("replay", make(run), *options.split())
    assert ran.code == code
    assert error in ran.line


def test_replay_refuses_gain_of_another_law(circnav, tmp_path):
    recorded_flight(tmp_path, "paper_example_1", "limits.duration_s=2").fly(5).recorder.close()
    assert "belongs to the law smooth" in circnav("replay", tmp_path, "--law", "switching").refused


# --- a plain tlog


@pytest.fixture(scope="session")
def records(flown):
    """The (stamp, frame) pairs of the flight as in a plain tlog, including frames sent by
    circnav."""
    return list(read_tlog(flown / "flight.tlog"))


@pytest.fixture
def replay(circnav, tmp_path):
    """Replay records as a plain tlog with overrides: replay(records, "key=value")."""

    def replay(records, *overrides, mission="quickstart"):
        log = tmp_path / "x.tlog"
        log.write_bytes(b"".join(struct.pack(">Q", stamp) + frame for stamp, frame in records))
        return circnav(
            "replay",
            log,
            "--mission",
            mission,
            *(part for one in overrides for part in ("--set", one)),
        )

    return replay


def steering(out):
    return int(re.search(r"(\d+) of them steering", out)[1])


def test_replay_of_plain_tlog_steers_by_its_ranges(replay, records):
    assert steering(replay(records).done) > 100


def test_replay_refuses_plain_tlog_with_bad_timestamps(replay, records):
    for stamp in (0, 1_790_000_000_000_000):
        ran = replay((stamp, frame) for _, frame in records)
        assert (ran.code, "its timestamps do not increase" in ran.line) == (3, True)
    two_clocks = (
        (us - 3_600_000_000 * (at > 500), frame) for at, (us, frame) in enumerate(records)
    )
    assert "its clock jumps" in replay(two_clocks).refused


def test_replay_that_never_steers_exits_with_3(circnav, replay, tmp_path):
    """The log contains no range. Tested with a run folder and with a plain tlog."""
    short = ("limits.duration_s=5", "link.wait_s=2", "ranging.sensor_id=9")
    recorded_flight(tmp_path / "run", "quickstart", *short).fly(20).recorder.close()
    folder = circnav("replay", tmp_path / "run")
    assert folder.code == 3
    assert "byte for byte the same" in folder.out
    assert "never steered: no " in folder.line
    plain = replay(read_tlog(tmp_path / "run" / "flight.tlog"), "ranging.sensor_id=9")
    assert plain.code == 3
    assert "never steered: 0 ranges" in plain.line
