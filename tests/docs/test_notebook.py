"""The notebook in examples/: its cells run from top to bottom, and functions take objects."""

import json
from io import BytesIO

import pytest
from matplotlib import pyplot

import circnav_mav
from circnav_mav import bench, campaign
from tests.process import ROOT


@pytest.mark.parametrize("flights", [1, pytest.param(6, marks=pytest.mark.nightly)])
def test_notebook_that_compares_own_law_runs_completely(flights, monkeypatch):
    """The notebook itself flies 6 flights of each law."""
    shown = []

    def show():
        """Draw all open figures as PNG, as Jupyter's inline backend does."""
        for number in pyplot.get_fignums():
            with BytesIO() as file:
                pyplot.figure(number).savefig(file, format="png")
                shown.append(file.getvalue())

    monkeypatch.setattr(pyplot, "show", show)
    pyplot.switch_backend("agg")
    text = (ROOT / "examples" / "own_law.ipynb").read_text()
    assert text.count("flights=6") == 1
    cells = json.loads(text.replace("flights=6", f"flights={flights}"))["cells"]
    assert not any(cell.get("outputs") for cell in cells)
    names = {"__name__": "notebook"}
    for number, cell in enumerate(cells):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"cell {number}", "exec"), names)
    rows = names["rows"]
    assert [row["policy"] for row in rows] == ["smooth", "feedforward", "notebook:own"] * 2
    calm = [row for row in rows if "calm" in row["situation"]]
    assert all(row["kept"] == row["flights"] == flights for row in calm)
    if flights == 6:  # the least number that gives an interval
        assert all(row["rms_low"] <= row["rms_median"] <= row["rms_high"] for row in rows)
    assert len(names["axes"].containers) == 2
    assert [picture[:4] for picture in shown] == [b"\x89PNG"]
    pyplot.close("all")


def steady(orbit):
    """Law that keeps the turn rate of the circle."""
    return lambda estimate: orbit.direction.turn_sign * orbit.speed / orbit.radius


def test_campaign_function_flies_law_objects_beside_named_laws():
    vary = {"guidance.law": ["smooth", steady], "limits.duration_s": [3.0]}
    rows = campaign(ROOT / "config" / "campaign_mission.toml", vary, 2)
    assert [row["guidance.law"] for row in rows] == ["smooth", f"{__name__}:steady"]
    assert [row["outcome"] for row in rows] == ["completed"] * 2
    with pytest.warns(UserWarning, match="speed_mps has no effect"):
        wind = {"sim.wind.speed_mps": [3.0], "limits.duration_s": [3.0]}
        campaign(ROOT / "config" / "quickstart.toml", wind, 1)
    with pytest.raises(ValueError, match="law: is an empty list"):
        campaign(ROOT / "config" / "campaign_mission.toml", {"guidance.law": []}, 2)


def test_bench_function_refuses_unusable_arguments():
    with pytest.raises(ValueError, match='situation "rain" is not one of: calm'):
        bench(["smooth"], ["rain"])
    with pytest.raises(ValueError, match="define it with a name"):
        bench([lambda orbit: None])
    with pytest.raises(AttributeError):
        _ = circnav_mav.benchmark
