"""No command writes over what another one recorded, or over a file of the person's own."""

import json

import pytest

from circnav_mav.runtime.recorder import Recorder, TakenError
from tests.flight.recorded import recorded_flight


@pytest.fixture
def run(tmp_path):
    """A run folder of some seconds."""
    recorded_flight(tmp_path / "run", "quickstart", "limits.duration_s=1").fly(8).recorder.close()
    return tmp_path / "run"


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_replay_is_not_written_over_a_recorded_flight(circnav, run):
    before = contents(run)
    ran = circnav("replay", run, "--out", run)
    assert (ran.code, ran.line) == (
        2,
        f"circnav: --out {run}: holds a recorded flight, name another folder for the replay",
    )
    assert contents(run) == before


def test_a_replay_is_not_written_over_ticks_that_no_replay_made(circnav, run, tmp_path):
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "ticks.csv").write_text("mine")
    assert circnav("replay", run, "--out", tmp_path / "kept").code == 2
    assert (tmp_path / "kept" / "ticks.csv").read_text() == "mine"


def test_a_second_replay_takes_the_place_of_the_first(circnav, run, tmp_path):
    assert circnav("replay", run, "--out", tmp_path / "what-if").code == 0
    assert circnav("replay", run, "--out", tmp_path / "what-if").code == 0


@pytest.mark.parametrize("name", ["flight.tlog", "mission.toml", "ticks.csv"])
def test_an_export_is_not_written_over_the_recording(circnav, run, name):
    pytest.importorskip("mcap", reason="needs the extra [mcap]")
    before = contents(run)
    ran = circnav("export", run, "--mcap", run / name)
    assert (ran.code, ran.line) == (2, f"circnav: --mcap {run / name}: is there and no MCAP file, name another")
    assert contents(run) == before


def test_an_export_is_not_written_in_the_place_of_a_device(circnav, run):
    assert "is there and no file" in circnav("export", run, "--mcap", "/dev/null").line


def test_an_export_that_fails_leaves_the_earlier_one_whole(circnav, run, monkeypatch):
    pytest.importorskip("mcap", reason="needs the extra [mcap]")
    assert circnav("export", run, "--mcap").code == 0
    before = contents(run)

    def full(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("circnav_mav.runlog.export_mcap._tick_rows", full)
    assert "No space left on device" in circnav("export", run, "--mcap").line
    assert contents(run) == before


def test_a_flight_is_not_recorded_over_another(circnav, mission, run):
    before = contents(run)
    ran = circnav("fly", mission, "--out", run)
    assert (ran.code, ran.line) == (2, f"circnav: --out {run}: holds flight.tlog already, name another folder")
    assert contents(run) == before


@pytest.mark.parametrize("name", ["summary.json", "ticks.csv", "turns.csv", "manifest.json"])
def test_what_is_left_of_a_flight_is_not_mixed_with_another(circnav, mission, tmp_path, name):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).write_text("{}")
    assert circnav("fly", mission, "--out", tmp_path / "out").line.endswith(
        f"holds {name} already, name another folder"
    )


def test_a_mission_file_of_the_persons_own_is_not_rewritten_by_its_flight(circnav, mission):
    before = mission.read_bytes()
    ran = circnav("fly", mission, "--set", "orbit.radius_m=80.0", "--out", mission.parent)
    assert (ran.code, ran.line) == (
        2,
        f"circnav: --out {mission.parent}: holds a mission.toml that is not as flown, name another folder",
    )
    assert mission.read_bytes() == before
    assert contents(mission.parent) == {"mission.toml": before}


def test_of_two_flights_that_begin_at_once_one_has_the_folder(tmp_path):
    """Both have looked and found nothing there."""
    Recorder(tmp_path / "run", "name = 'x'\n")
    with pytest.raises(TakenError, match=r"holds flight\.tlog already"):
        Recorder(tmp_path / "run", "name = 'y'\n")
    assert (tmp_path / "run" / "mission.toml").read_text() == "name = 'x'\n"


def test_two_flights_of_one_second_have_folders_of_their_own(circnav, mission, tmp_path, monkeypatch):
    monkeypatch.setattr("circnav_mav.cli.fly.local_time_name", lambda: "20260101-120000")
    for _ in range(2):
        assert circnav("fly", mission).code == 3
    assert sorted(path.name for path in (tmp_path / "runs").iterdir()) == [
        "20260101-120000-small",
        "20260101-120000-small-2",
    ]
    assert json.loads((tmp_path / "runs" / "20260101-120000-small-2" / "summary.json").read_text())
