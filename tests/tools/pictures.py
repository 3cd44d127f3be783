"""python -m tests.tools.pictures [NAME ...]: draw the pictures of README and docs.

Flies the flight of each picture with the present version, and writes the picture to docs/. NAME is
quickstart, report, live, paper or fleet; default: all, some minutes of processor time. `report` and
`live` need Chromium. Each PNG keeps the figures of its flight as a text chunk, which
tests/docs/test_pictures.py compares with a new flight.
"""

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PIL import Image
from PIL.PngImagePlugin import PngInfo

from tests.browser import Browser
from tests.process import ROOT
from tests.process import circnav as process_of

DOCS = ROOT / "docs"
KEY = "circnav"
"""Name of the text chunk with the figures."""
OUTAGE = 'sim.events=[{at_s=60.0, action="mute_ranging"}, {at_s=64.0, action="unmute_ranging"}]'
WIND = ("--set", "sim.wind.speed_mps=4.0", "--set", "sim.wind.from_deg=0.0")
QUICKSTART = ("fly", "quickstart")
REPORT = ("fly", "quickstart", *WIND, "--set", OUTAGE)
LIVE = ("fly", "plane", *WIND, "--duration", "60")
FLEET = ("fly", "plane", "--fleet", "6")


def run(*arguments: str) -> None:
    """Run circnav without a display. Raises CalledProcessError."""
    command = [sys.executable, "-m", "circnav_mav", *arguments]
    subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)


def flight_figures(folder: Path) -> dict[str, float | None]:
    """Return the figures of a flight by its true track."""
    truth = json.loads((folder / "summary.json").read_text())["truth"]
    names = ("radius_mean_m", "radius_rms_error_m", "settled_s", "closest_approach_m")
    return {name: None if truth[name] is None else round(truth[name], 2) for name in names}


def fly(arguments: tuple[str, ...], folder: Path) -> dict[str, Any]:
    """Fly into a folder. Return the figures."""
    run(*arguments, "--out", str(folder))
    return flight_figures(folder)


def fly_fleet(folder: Path) -> dict[str, Any]:
    """Fly six planes into a folder. Return the figures of the fleet."""
    run(*FLEET, "--out", str(folder))
    found = json.loads((folder / "fleet.json").read_text())
    return {name: value for name, value in found.items() if isinstance(value, int | float)}


def study_paper(folder: Path) -> dict[str, Any]:
    """Simulate the paper's examples into a folder. Return their table."""
    run("paper", "--out", str(folder))
    return {"table": (folder / "table.md").read_text()}


def write(picture: Path, name: str, figures: dict[str, Any]) -> None:
    """Write a PNG with the figures of its flight to docs/."""
    info = PngInfo()
    info.add_text(KEY, json.dumps(figures))
    with Image.open(picture) as image:
        image.load()
        image.save(DOCS / name, pnginfo=info, optimize=True)


def kept(name: str) -> dict[str, Any]:
    """Return the figures of a picture in docs/."""
    with Image.open(DOCS / name) as image:
        image.load()
        return json.loads(image.text[KEY])


def draw_quickstart(folder: Path) -> None:
    """The picture of a flight, at the top of README."""
    write(folder / "run" / "flight.png", "quickstart.png", fly(QUICKSTART, folder / "run"))


def draw_report(folder: Path) -> None:
    """The report of a flight with an outage of the ranges."""
    figures = fly(REPORT, folder / "run")
    browser = Browser(folder / "profile")
    try:
        browser.open((folder / "run" / "report.html").as_uri(), width=985, height=1075)
        browser.picture(folder / "report.png")
    finally:
        browser.close()
    write(folder / "report.png", "report.png", figures)


def draw_live(folder: Path) -> None:
    """The live page, on a computer and on a phone."""
    out = ("--web", "0", "--speed", "2", "--out", str(folder / "run"))
    browser = Browser(folder / "profile")
    try:
        with process_of(*LIVE, *out) as flown:
            assert flown.stdout is not None
            address = next(line for line in flown.stdout if line.startswith("live page at "))
            url = address.split()[-1]
            browser.open(url, width=1085, height=1000, dark=True)
            browser.until("newest && newest.now > 40")
            browser.picture(folder / "live-desktop.png")
            browser.open(url, width=360, height=880)
            browser.until("newest && document.querySelector('#track path.line')")
            browser.picture(folder / "live-phone.png")
            flown.communicate()
    finally:
        browser.close()
    for name in ("live-desktop.png", "live-phone.png"):
        write(folder / name, name, flight_figures(folder / "run"))


def draw_paper(folder: Path) -> None:
    """Example 3 of the paper."""
    figures = study_paper(folder / "paper")
    write(folder / "paper" / "example_3_track.png", "paper_example_3.png", figures)


def draw_fleet(folder: Path) -> None:
    """Six planes on one circle, as a picture and as an animation."""
    figures = fly_fleet(folder / "fleet")
    write(folder / "fleet" / "fleet.png", "fleet.png", figures)
    shutil.copy(folder / "fleet" / "fleet.gif", DOCS)


PICTURES: dict[str, Callable[[Path], None]] = {
    "quickstart": draw_quickstart,
    "report": draw_report,
    "live": draw_live,
    "paper": draw_paper,
    "fleet": draw_fleet,
}

if __name__ == "__main__":
    names = sys.argv[1:] or list(PICTURES)
    if unknown := set(names) - set(PICTURES):
        sys.exit(f"{', '.join(unknown)}: is none of {', '.join(PICTURES)}")
    for name in names:
        with tempfile.TemporaryDirectory() as place:
            PICTURES[name](Path(place))
        print(name)
