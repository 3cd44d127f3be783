"""`circnav bench`: cells by name, the table, and names that do not exist."""

import pytest


def test_a_cell_is_flown_and_written(circnav, tmp_path):
    ran = circnav("bench", "--law", "pd", "--situation", "calm", "--flights", "4", "--out", tmp_path)
    assert (ran.code, ran.err) == (0, "")
    assert "kept    4 of 4" in ran.out
    assert "ideal times" in ran.out
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
    ran = circnav("bench", option, value)
    assert ran.code == 2
    assert ran.line.startswith(f"circnav: {option}: ")
    assert named in ran.line


def test_a_place_that_cannot_be_written_is_found_out_before_anything_flies(circnav, tmp_path, monkeypatch):
    monkeypatch.setattr("circnav_mav.cli.bench.run", None)
    (tmp_path / "afile").write_text("")
    ran = circnav("bench", "--law", "pd", "--situation", "calm", "--out", tmp_path / "afile")
    assert (ran.code, ran.line) == (2, f"circnav: {tmp_path / 'afile'}: File exists")
    (tmp_path / "out" / "table.csv").mkdir(parents=True)
    assert "Is a directory" in circnav("bench", "--law", "pd", "--situation", "calm", "--out", tmp_path / "out").line
