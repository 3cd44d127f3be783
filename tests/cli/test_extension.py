"""The core with two extras that this test writes: command, option, mission table, check, listener,
files and report section. A listener that fails in flight does not end the flight."""

import json
import re
import shutil
import subprocess
import sys

import pytest

from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import Pilot
from circnav_mav.runlog.loop_steps import recorded_steps
from circnav_mav.runlog.replay import replay
from tests.process import PATIENCE, QUICKSTART, ROOT

PACKAGES = {
    "__init__": "",
    "sight/__init__": (
        """
from circnav_mav.extension import Extension

EXTENSION = Extension(
    commands={"look": "circnav_mav.extras.sight.parts:look"},
    tables={"sight": "circnav_mav.extras.sight.parts:SightTable"},
    checks=["circnav_mav.extras.sight.parts:check"],
    fly_options=["circnav_mav.extras.sight.parts:OPTION"],
    listener="circnav_mav.extras.sight.parts:open_listener",
    report_section="circnav_mav.extras.sight.parts:report_section",
    schemas={"sight": "circnav_mav.extras.sight.parts:SightTable"},
)
"""
    ),
    "sight/parts": (
        '''
import click

from circnav_mav.mav.check_result import WARN, Check
from circnav_mav.mission.schema import Table
from circnav_mav.runtime.listeners import Listener


class SightTable(Table):
    """[sight]: what is seen."""

    miles: float = 0.0


OPTION = click.option("--glass", metavar="COLOR", help="Glass to look through.")


@click.command()
def look():
    """Look."""
    click.echo("seen")


def check(mission):
    if mission.file.sight.miles > 5:
        yield Check(WARN, "sight", f"{mission.file.sight.miles:g} miles: haze")


class Sight(Listener):
    name = "sight"

    def __init__(self, glass):
        self.glass, self.steps, self.ticks = glass, 0, set()

    def start(self, epoch_us):
        assert epoch_us > 0

    def on_step(self, newest, step, recording_problem):
        self.steps += 1
        self.ticks |= {newest.phase.value} if newest else set()
        return ()

    def finish(self, summary):
        summary["sight"] = {"steps": self.steps}
        summary["notes"].append(f"  sight      through {self.glass} glass")
        return {"sight.txt": " ".join(sorted(self.ticks))}


def open_listener(given):
    return Sight(given.options["glass"]) if given.options["glass"] else None


def report_section(run):
    sight = run.summary.get("sight")
    return f"<h2>Seen for {sight['steps']} steps</h2>" if sight else ""
'''
    ),
    "broken/__init__": (
        """
from circnav_mav.extension import Extension

PARTS = "circnav_mav.extras.broken.parts"
EXTENSION = Extension(listener=f"{PARTS}:open_listener", report_section=f"{PARTS}:report_section")
"""
    ),
    "broken/parts": (
        """
from circnav_mav.runtime.listeners import Listener


class Broken(Listener):
    name = "broken"

    def on_step(self, newest, step, recording_problem):
        return 1 / 0 if step.time > 5.0 else ()


def open_listener(given):
    return Broken() if given.mission.file.sight.miles == 3 else None


def report_section(run):
    return 1 / 0 if "sight" in run.summary else ""
"""
    ),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A copy of the core and its bytecode, with two packages as its only extras."""
    folder = tmp_path_factory.mktemp("copy")
    shutil.copytree(
        ROOT / "circnav_mav",
        folder / "circnav_mav",
        ignore=shutil.ignore_patterns("extras"),
    )
    shutil.copytree(ROOT / "config", folder / "circnav_mav" / "config")
    shutil.copytree(ROOT / "sim", folder / "circnav_sim")
    for name, text in PACKAGES.items():
        path = folder / "circnav_mav" / "extras" / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


@pytest.fixture
def circnav(folder):
    """Return a function that runs `circnav ARGUMENTS` in that folder and returns the output."""

    def circnav(*arguments):
        ran = subprocess.run(
            [sys.executable, "-m", "circnav_mav", *map(str, arguments)],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
            env={"PYTHONPATH": str(folder), "PATH": "/usr/bin:/bin"},
        )
        assert (ran.returncode, ran.stderr) == (0, ""), ran.stdout
        return ran.stdout

    return circnav


def test_extension_adds_command_table_check_and_schema(circnav):
    assert circnav("--help").splitlines()[-1].split() == ["look", "Look."]
    assert circnav("look") == "seen\n"
    checked = circnav("check", "quickstart", "--set", "sight.miles=7")
    assert re.search("^WARN  sight +7 miles: haze$", checked, re.MULTILINE)
    schema = json.loads(circnav("schema", "mission"))
    assert schema["definitions"]["SightTable"]["properties"]["miles"]["type"] == "number"
    assert "locate" not in schema["properties"]


def test_failing_listener_does_not_end_the_flight(circnav, folder):
    run = folder / "run"
    options = ("--duration", "8", "--set", "sight.miles=3", "--glass", "green")
    printed = circnav("fly", "quickstart", "--out", run, *options)
    assert "COMPLETED: flown to its end" in printed
    assert "  sight      through green glass\n" in printed
    (failed,) = re.findall(
        r"  WARNING    (broken: stopped at 5\.\d s: ZeroDivisionError\('division by zero'\))\n",
        printed,
    )
    assert (
        "report.html: circnav_mav.extras.broken.parts:report_section: left out: division by zero\n"
        in printed
    )
    summary = json.loads((run / "summary.json").read_text())
    assert [(alarm["name"], alarm["text"]) for alarm in summary["alarms"]] == [
        ("extra_stopped", failed)
    ]
    assert summary["sight"]["steps"] > 100
    assert {"engaged", "ended"} <= set((run / "sight.txt").read_text().split())
    page = (run / "report.html").read_text()
    assert f"<h2>Seen for {summary['sight']['steps']} steps</h2>" in page
    assert "through green glass" in page
    alone = load_mission(QUICKSTART, ["limits.duration_s=8"])
    assert replay(Pilot(alone), recorded_steps(run)).identical
