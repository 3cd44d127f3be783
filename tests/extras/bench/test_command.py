"""`circnav bench`: its output, and rejected arguments."""

from dataclasses import replace

import pytest

from circnav_mav.extras.bench.situations import SITUATIONS

CELL = ("bench", "--law", "smooth", "--situation", "calm")


def test_bench_writes_table_and_picture(circnav, tmp_path, monkeypatch):
    short = replace(SITUATIONS["calm"], start=(80.0, 160.0), duration=125.0)
    monkeypatch.setitem(SITUATIONS, "calm", short)
    out = circnav(*CELL, "--flights", "1", "--out", tmp_path, "--format", "pdf").done
    assert "kept    1 of 1" in out
    assert "ideal times" in out
    assert (tmp_path / "table.csv").read_text().startswith("situation,policy,flights,kept")
    assert (tmp_path / "table.pdf").read_bytes().startswith(b"%PDF")


def test_bench_rejects_unwritable_output_before_flights(circnav, tmp_path, monkeypatch):
    monkeypatch.setattr("circnav_mav.extras.bench.bench.run", None)
    (tmp_path / "out" / "table.csv").mkdir(parents=True)
    assert "Is a directory" in circnav(*CELL, "--out", tmp_path / "out").refused


@pytest.mark.parametrize(
    ("command", "error"),
    [
        ("--law smoth", '--law: "smoth" is not one of: auto; '),
        ("--situation rain", '--situation: "rain" is not one of: calm'),
        ("--law smooth --situation calm --out mission.toml", "mission.toml: File exists"),
        ("--law smooth --situation calm --out=", "--out: is empty, give it a name"),
    ],
)
def test_bench_rejects_invalid_arguments_without_writing(circnav, mission, command, error):
    assert circnav("bench", *command.split()).refused.startswith(error)
    assert list(mission.parent.iterdir()) == [mission]


@pytest.mark.parametrize("option", ["--flights 0", "--seed -1"])
def test_bench_rejects_invalid_counts_with_exit_code_2(circnav, option):
    assert circnav("bench", *option.split()).code == 2
