"""`circnav bench`: cells by name, the table, and names that do not exist."""

import pytest

CELL = ("bench", "--law", "pd", "--situation", "calm")


def test_a_cell_is_flown_and_written(circnav, tmp_path):
    out = circnav(*CELL, "--flights", "4", "--out", tmp_path).done
    assert "kept    4 of 4" in out
    assert "ideal times" in out
    assert (tmp_path / "table.csv").read_text().startswith("situation,policy,flights,kept")
    assert (tmp_path / "table.png").exists()


@pytest.mark.parametrize(
    ("option", "value", "named"),
    [
        ("--seed", "-1", "at least 0"),
        ("--law", "smoth", "smooth"),
        ("--situation", "rain", "wind .33 V"),
        ("--flights", "0", "at least 1"),
        ("--out", "", "is empty"),
    ],
)
def test_what_cannot_be_flown_is_one_line_with_the_remedy(circnav, option, value, named):
    line = circnav("bench", option, value).refused
    assert line.startswith(f"{option}: ")
    assert named in line


def test_a_place_that_cannot_be_written_is_found_out_before_anything_flies(circnav, tmp_path, monkeypatch):
    monkeypatch.setattr("circnav_mav.cli.bench.run", None)
    (tmp_path / "afile").write_text("")
    assert circnav(*CELL, "--out", tmp_path / "afile").refused == f"{tmp_path / 'afile'}: File exists"
    (tmp_path / "out" / "table.csv").mkdir(parents=True)
    assert "Is a directory" in circnav(*CELL, "--out", tmp_path / "out").refused
