"""`circnav paper`: six figures and a table, or one line."""


def test_six_figures_and_a_table(circnav, tmp_path):
    ran = circnav("paper", "--out", tmp_path / "paper", "--starts", "4")
    assert (ran.code, ran.err) == (0, "")
    assert "10.98684 m" in ran.out
    names = {path.name for path in (tmp_path / "paper").iterdir()}
    assert names == {f"example_{n}_{kind}.png" for n in (1, 2, 3) for kind in ("track", "error")} | {"table.md"}


def test_what_cannot_be_done_is_one_line(circnav, tmp_path):
    (tmp_path / "file").write_text("")
    assert "File exists" in circnav("paper", "--out", tmp_path / "file").line
    assert "--starts" in circnav("paper", "--starts", "0").line
    assert circnav("paper", "--starts", "1", "--out", "").line == "circnav: --out: is empty, give it a name"


def test_a_seed_below_0_is_one_line(circnav):
    ran = circnav("paper", "--starts", "3", "--seed", "-1")
    assert (ran.code, ran.line) == (2, "circnav: --seed: must be at least 0, not -1")
