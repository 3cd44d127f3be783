"""The pictures of README and docs show flights of the present version."""

import re

import pytest

from tests.command_line import circnav, undrawn
from tests.process import ROOT
from tests.tools import pictures

__all__ = ["circnav", "undrawn"]

FLIGHTS = {
    "quickstart.png": lambda folder: pictures.fly(pictures.QUICKSTART, folder),
    "report.png": lambda folder: pictures.fly(pictures.REPORT, folder),
    "live-desktop.png": lambda folder: pictures.fly(pictures.LIVE, folder),
    "paper_example_3.png": pictures.study_paper,
    "fleet.png": pictures.fly_fleet,
}
LONG = {"paper_example_3.png", "fleet.png", "report.png", "live-desktop.png"}
"""Pictures that only the nightly tests compare, because their flights take much processor time."""


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.nightly] * (name in LONG)) for name in FLIGHTS],
)
@pytest.mark.usefixtures("undrawn")
def test_picture_shows_flight_of_present_version(name, circnav, monkeypatch, tmp_path):
    """After a change of guidance: python -m tests.tools.pictures."""
    monkeypatch.setattr(pictures, "run", lambda *arguments: circnav(*arguments).done)
    flown = FLIGHTS[name](tmp_path / "run")
    drawn = pictures.kept(name)
    assert drawn.keys() == flown.keys()
    for figure, value in flown.items():
        assert drawn[figure] == (value if isinstance(value, str) else pytest.approx(value, abs=0.1))


def test_pages_show_only_drawn_pictures():
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    shown = {name for page in pages for name in re.findall(r"([\w-]+\.png)\)", page.read_text())}
    assert shown == {*FLIGHTS, "live-phone.png"}
    assert shown == {path.name for path in (ROOT / "docs").glob("*.png")}
    settled = pictures.kept("report.png")["settled_s"]
    assert settled is not None and settled < 60
