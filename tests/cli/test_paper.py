"""`circnav paper`: six figures and a table, or one line."""

import pytest


def test_six_figures_and_a_table(circnav, tmp_path):
    assert "10.98684 m" in circnav("paper", "--out", tmp_path / "paper", "--starts", "4").done
    names = {path.name for path in (tmp_path / "paper").iterdir()}
    assert names == {f"example_{n}_{kind}.png" for n in (1, 2, 3) for kind in ("track", "error")} | {"table.md"}


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--out", "file"], "file: File exists"),
        (["--out", ""], "--out: is empty, give it a name"),
        (["--starts", "0"], "--starts: must be at least 1, not 0"),
        (["--seed", "-1"], "--seed: must be at least 0, not -1"),
    ],
)
def test_what_cannot_be_done_is_one_line(circnav, tmp_path, options, line):
    (tmp_path / "file").write_text("")
    assert circnav("paper", *options).refused == line
