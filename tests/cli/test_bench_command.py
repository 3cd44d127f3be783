"""`circnav bench`: a cell by its names, and the table."""

CELL = ("bench", "--law", "pd", "--situation", "calm")


def test_a_cell_is_flown_and_written(circnav, tmp_path):
    out = circnav(*CELL, "--flights", "4", "--out", tmp_path).done
    assert "kept    4 of 4" in out
    assert "ideal times" in out
    assert (tmp_path / "table.csv").read_text().startswith("situation,policy,flights,kept")
    assert (tmp_path / "table.png").exists()


def test_a_place_that_cannot_be_written_is_found_out_before_anything_flies(circnav, tmp_path, monkeypatch):
    monkeypatch.setattr("circnav_mav.experiments.bench.run", None)
    (tmp_path / "out" / "table.csv").mkdir(parents=True)
    assert "Is a directory" in circnav(*CELL, "--out", tmp_path / "out").refused
