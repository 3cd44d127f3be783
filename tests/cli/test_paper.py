"""`circnav paper`: six figures and a table."""


def test_six_figures_and_a_table(circnav, tmp_path):
    assert "10.98684 m" in circnav("paper", "--out", tmp_path / "paper", "--starts", "4").done
    names = {path.name for path in (tmp_path / "paper").iterdir()}
    assert names == {f"example_{n}_{kind}.png" for n in (1, 2, 3) for kind in ("track", "error")} | {"table.md"}
