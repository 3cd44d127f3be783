"""No command overwrites the records of another one, or a file of the user."""

import json

import pytest

from circnav_mav.runtime.recorder import Recorder, TakenError

pytestmark = pytest.mark.usefixtures("undrawn")


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_replay_overwrites_only_replays(circnav, flown, tmp_path):
    before = contents(flown)
    line = circnav("replay", flown, "--out", flown).refused
    assert line == f"--out {flown}: holds a recorded flight, name another folder for the replay"
    assert contents(flown) == before
    for _ in range(2):
        assert circnav("replay", flown, "--out", tmp_path / "what-if").done
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "ticks.csv").write_text("mine")
    assert circnav("replay", flown, "--out", tmp_path / "kept").refused
    assert contents(tmp_path / "kept") == {"ticks.csv": b"mine"}


@pytest.mark.parametrize(
    ("name", "obstacle"),
    [
        *(
            (name, f"{name} already")
            for name in ("flight.tlog", "summary.json", "ticks.csv", "steps.csv")
        ),
        ("manifest.json", "manifest.json already"),
        ("mission.toml", "another mission.toml"),
    ],
)
def test_existing_files_prevent_a_flight(circnav, mission, tmp_path, name, obstacle):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).write_text("{}")
    line = circnav(
        "fly", mission, "--set", "orbit.radius_m=80.0", "--out", tmp_path / "out"
    ).refused
    assert line == f"--out {tmp_path / 'out'}: holds {obstacle}, name another folder"
    assert contents(tmp_path / "out") == {name: b"{}"}


def test_concurrent_flights_cannot_share_a_folder(tmp_path):
    """Both flights find the folder free before either one creates it."""
    Recorder(tmp_path / "run", "name = 'x'\n")
    with pytest.raises(TakenError, match=r"holds flight\.tlog already"):
        Recorder(tmp_path / "run", "name = 'y'\n")
    assert (tmp_path / "run" / "mission.toml").read_text() == "name = 'x'\n"


def test_simultaneous_flights_have_separate_folders(circnav, mission, tmp_path, monkeypatch):
    monkeypatch.setattr("circnav_mav.cli.fly.local_time_name", lambda unix=None: "20260101-120000")
    for name in ("20260101-120000-small", "20260101-120000-small-2"):
        assert circnav("fly", mission).code == 3
        assert json.loads((tmp_path / "runs" / name / "summary.json").read_text())


def test_tilde_in_output_path_is_expanded(circnav, mission, tmp_path, monkeypatch):
    """A shell does not expand `~` in `--out=~/run`. A folder of that name would invite `rm -r
    ~`."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert circnav("fly", mission, "--out=~/run").code == 3
    assert (tmp_path / "home" / "run" / "summary.json").exists()
    assert not (tmp_path / "~").exists()
