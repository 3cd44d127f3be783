"""The end of a flight: what is kept of it, whatever cannot be made or worked out, and whoever has gone."""

import csv
import json
import os
import pty
import sys

import pytest

from circnav_mav.pilot.mission_state import Phase
from tests.process import QUICKSTART, ROOT

SHORT = ("--duration", 4)
"""Slow enough that neither process is missed where it stands still for a second."""


def strict(path):
    """What a JSON file holds, read by the letter of the standard."""

    def refused(name):
        raise AssertionError(f"{name} is no JSON")

    return json.loads(path.read_text(), parse_constant=refused)


def fails(*arguments):
    raise IndexError("list index out of range")


def flown(circnav, folder):
    """A short flight of the bundled vehicle."""
    return circnav("fly", QUICKSTART, *SHORT, "--out", folder)


@pytest.mark.parametrize("picture", ["flight.png", "report.html"])
def test_a_picture_that_cannot_be_made_costs_one_line(circnav, tmp_path, picture):
    (tmp_path / "run" / picture).mkdir(parents=True)
    ran = flown(circnav, tmp_path / "run")
    assert (ran.code, ran.err) == (0, "")
    assert "COMPLETED" in ran.out
    assert ran.out.count("WARNING") == 1
    assert f"{picture}: could not be made: " in ran.out
    assert strict(tmp_path / "run" / "summary.json")["outcome"] == "completed"
    assert strict(tmp_path / "run" / "manifest.json")["exit"] == 0


def test_a_display_that_fails_ends_no_flight_and_costs_one_line(circnav, monkeypatch, tmp_path):
    monkeypatch.setattr("circnav_mav.runtime.display.Display.show", fails)
    ran = flown(circnav, tmp_path / "run")
    assert (ran.code, ran.err) == (0, "")
    assert "COMPLETED" in ran.out
    assert ran.out.count("WARNING") == 1
    assert "display: stopped at " in ran.out
    assert strict(tmp_path / "run" / "summary.json")["outcome"] == "completed"


@pytest.mark.parametrize("what", ["read_truth", "read_ticks", "runlog.summary._truth"])
def test_truth_or_ticks_that_cannot_be_understood_cost_their_figures_alone(circnav, monkeypatch, tmp_path, what):
    monkeypatch.setattr(f"circnav_mav.{what}" if "." in what else f"circnav_mav.cli.closing.{what}", fails)
    ran = flown(circnav, tmp_path / "run")
    assert (ran.code, ran.err) == (0, "")
    assert "COMPLETED" in ran.out
    assert ran.out.count("WARNING") == 1
    summary = strict(tmp_path / "run" / "summary.json")
    assert "list index out of range" in summary["recording_problem"]
    assert (summary["truth"] is None) == (what != "read_ticks")
    assert strict(tmp_path / "run" / "manifest.json")["exit"] == 0


def moments(folder, *phases):
    """When a flight was in these phases."""
    with (folder / "ticks.csv").open() as file:
        return [float(row["time"]) for row in csv.DictReader(file) if row["phase"] in phases]


@pytest.mark.parametrize("term", ["xterm", "dumb"], ids=["picture", "lines"])
def test_a_flight_outlives_its_terminal(tmp_path, term):
    """A real terminal, closed while the circle is flown: the kernel sends its signal to the session, and whatever is
    written from then on is an error."""
    folder, engaged = tmp_path / "run", Phase.ENGAGED.value.encode()
    process, terminal = pty.fork()
    if process == 0:
        os.environ.update(TERM=term, PYTHONPATH=str(ROOT))
        arguments = ["fly", QUICKSTART, "--speed", "6", "--duration", "24", "--out", str(folder)]
        os.execv(sys.executable, [sys.executable, "-m", "circnav_mav", *arguments])
    shown = b""
    while engaged not in shown.lower():
        shown += os.read(terminal, 65536)
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 0
    summary = strict(folder / "summary.json")
    assert (summary["outcome"], summary["recording_problem"]) == ("completed", None)
    assert moments(folder, "leaving")[0] >= summary["engaged_s"] + 24.0 > moments(folder, "engaged", "holding")[-1]
    assert summary["truth"]["radius_mean_m"] is not None
    assert strict(folder / "manifest.json")["exit"] == 0
    assert (folder / "report.html").stat().st_size > 10_000
