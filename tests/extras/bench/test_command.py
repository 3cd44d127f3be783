"""`circnav bench`: its output, and rejected arguments."""

import pytest

CELL = ("bench", "--law", "smooth", "--situation", "calm")


def test_a_cell_is_flown_and_written(circnav, tmp_path):
    out = circnav(*CELL, "--flights", "2", "--out", tmp_path).done
    assert "kept    2 of 2" in out
    assert "ideal times" in out
    assert (tmp_path / "table.csv").read_text().startswith("situation,policy,flights,kept")
    assert (tmp_path / "table.png").exists()


def test_a_place_that_cannot_be_written_is_found_out_before_anything_flies(
    circnav, tmp_path, monkeypatch
):
    monkeypatch.setattr("circnav_mav.extras.bench.bench.run", None)
    (tmp_path / "out" / "table.csv").mkdir(parents=True)
    assert "Is a directory" in circnav(*CELL, "--out", tmp_path / "out").refused


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ("--law smoth", '--law: "smoth" is not one of: auto; '),
        ("--situation rain", '--situation: "rain" is not one of: calm'),
        ("--law smooth --situation calm --out mission.toml", "mission.toml: File exists"),
        ("--law smooth --situation calm --out=", "--out: is empty, give it a name"),
    ],
)
def test_wrong_usage_is_one_line_and_nothing_is_written(circnav, mission, command, says):
    assert circnav("bench", *command.split()).refused.startswith(says)
    assert list(mission.parent.iterdir()) == [mission]


@pytest.mark.parametrize("option", ["--flights 0", "--seed -1"])
def test_a_number_that_is_none_of_flights_or_seeds_is_exit_code_2(circnav, option):
    assert circnav("bench", *option.split()).code == 2
