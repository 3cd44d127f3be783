"""What is kept of a flight at its end. Nothing of it can be lost because something else cannot be made."""

import os
import platform
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import circnav_mav
from circnav_mav import __version__
from circnav_mav.cli.exits import Exit
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import Ending, Pilot
from circnav_mav.runlog.atomic_write import write_json, write_text
from circnav_mav.runlog.summary import FlightFacts, summarise
from circnav_mav.runlog.ticks import NO_TICKS, Ticks, Truth, read_ticks, read_truth
from circnav_mav.runtime.onlookers import Onlookers
from circnav_mav.runtime.recorder import Recorder

OUTCOMES = {Ending.COMPLETED: "completed", Ending.INTERRUPTED: "interrupted"}
"""The outcome in summary.json; every other ending is "aborted"."""
LIBRARIES = ("pymavlink", "numpy", "filterpy")
"""What takes part in a flight, besides ourselves and Python."""


def write_manifest(folder: Path, mission: Mission, pilot: Pilot, epoch_us: int, **end: object) -> None:
    """manifest.json: what a run folder says of itself. Written before the first turn of the loop, so that a run whose
    process was killed still opens, and again with its end: outcome, reason, exit. Raises OSError."""
    versions: dict[str, str | None] = {"circnav": __version__, "python": platform.python_version()}
    for library in LIBRARIES:
        with suppress(PackageNotFoundError):
            versions[library] = version(library)
    seed, session, autopilot = (mission.file.sim or {}).get("seed"), pilot.session, dict[str, Any]()
    if session.up:
        system, component = session.vehicle_ids
        autopilot = {"system": system, "component": component, "name": session.adapter.name}
        autopilot["firmware"] = session.vehicle.firmware
    facts = {
        "mission": mission.file.name,
        "voice": pilot.settings.output_mode.value,
        "epoch_us": epoch_us,
        "seeds": {} if seed is None else {"sim": seed},
        "versions": versions,
        "autopilot": autopilot or None,
    }
    write_json(folder / "manifest.json", facts | dict.fromkeys(("outcome", "reason", "exit")) | end)


def close_flight(
    pilot: Pilot,
    recorder: Recorder,
    mission: Mission,
    epoch_us: int,
    code: Exit,
    alarms: list[dict[str, float | str]],
    onlookers: Onlookers,
) -> tuple[dict[str, Any], Exit]:
    """The summary, written as summary.json, and the rest of manifest.json, if the disk takes them; and the exit code: a
    flight that went well is not done if it was not recorded, for whoever flew it for its record."""
    folder = recorder.folder
    gaps = recorder.problem is not None  # from here on it may also be that what was recorded is not understood
    summary = _summary(pilot, recorder, mission, epoch_us)
    summary["notes"] = []
    summary["alarms"] = alarms
    for name, text in onlookers.finish(summary).items():
        gaps |= not _written(summary, name, partial(write_text, folder / name, text))
    gaps |= not _written(summary, f"{folder}:", lambda: write_json(folder / "summary.json", summary))
    code = Exit.NOT_RECORDED if gaps and code is Exit.DONE else code
    end = {"outcome": summary["outcome"], "reason": summary["reason"], "exit": int(code)}
    gaps = not _written(summary, "manifest.json", lambda: write_manifest(folder, mission, pilot, epoch_us, **end))
    return summary, Exit.NOT_RECORDED if gaps and code is Exit.DONE else code


def _written(summary: dict[str, Any], name: str, write: Callable[[], None]) -> bool:
    """Write a file; tells whether the disk took it. The first problem is kept: later ones follow from it."""
    try:
        write()
    except OSError as error:
        problem = f"{name} cannot be written: {error.strerror or error}"
        summary["recording_problem"] = summary["recording_problem"] or problem
        return False
    return True


def _summary(pilot: Pilot, recorder: Recorder, mission: Mission, epoch_us: int) -> dict[str, Any]:
    """The figures that can be worked out; the rest is unknown."""
    outcome = pilot.mission.outcome
    assert outcome is not None
    ticks, truth = _recorded(recorder, epoch_us, pilot.session.vehicle_ids[0] or None)
    facts = FlightFacts(
        mission=mission.file.name,
        outcome=OUTCOMES.get(outcome.ending, "aborted"),
        reason=outcome.reason,
        orbit=mission.orbit,
        samples_accepted=pilot.tracker.accepted,
        samples_rejected=dict(pilot.tracker.ranging.rejected),
        frames_refused=dict(pilot.frames_refused()),
        setpoints_sent=pilot.setpoints_sent,
        firmware=pilot.session.vehicle.firmware,
        version=__version__,
        epoch_us=epoch_us,
        recording_problem=recorder.problem,
        voice=pilot.settings.output_mode.value,
        clock_speed=pilot.session.clock_speed.noticed,
        engaged_s=pilot.mission.engaged_at,
        until_s=recorder.until,
        later_radii=mission.radii[1:],
    )
    for known in ((ticks, truth), (ticks, None)):
        try:
            return summarise(facts, *known)
        except Exception as error:
            problem = f"not all figures could be worked out: {error}"
            facts = replace(facts, recording_problem=facts.recording_problem or problem)
    return summarise(facts, NO_TICKS, None)


def _recorded(recorder: Recorder, epoch_us: int, system: int | None) -> tuple[Ticks, Truth | None]:
    """Ticks and truth as far as they can be read: a disk that was full from the first line on leaves none."""
    ticks, truth = NO_TICKS, None
    try:
        ticks = read_ticks(recorder.folder)
    except Exception as error:
        recorder.problem = recorder.problem or f"ticks.csv: {error}"
    try:
        truth = read_truth(recorder.folder, epoch_us, system)
    except Exception as error:
        recorder.problem = recorder.problem or f"flight.tlog: {error}"
    return ticks, truth


class Drawing:
    """flight.png and report.html of a run folder, made by a process of its own: what draws is never loaded into the
    flight's, and a signal that comes now ends neither; the exit code stays the flight's. It starts at once, and draws
    when it is told to; where the flight's process goes without a word, it goes, too."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._process: subprocess.Popen[str] | None = None
        with suppress(OSError):  # no room for one more process
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "circnav_mav", "report", str(folder), "--after-flight"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                env={**os.environ, "PYTHONPATH": str(Path(circnav_mav.__file__).parents[1])},
                start_new_session=True,
            )

    def draw(self) -> list[str]:
        """Draw the flight, which is over; a line for each picture that could not be made."""
        process, drawn, why = self._process, "", "no room for one more process"
        if process is not None:
            drawn, errors = process.communicate("over\n")
            why = errors.strip().rpartition("\n")[2].removeprefix("circnav: ") or f"exit code {process.returncode}"
        failed = process is None or process.returncode != 0
        return drawn.splitlines() + failed * [f"{self._folder}: flight.png and report.html could not be made: {why}"]
