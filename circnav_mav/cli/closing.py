"""Files written at the end of a flight. If one file cannot be written, the other files still
are."""

import platform
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from circnav_mav import __version__
from circnav_mav.cli.exits import Exit
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import Ending, Pilot
from circnav_mav.runlog.atomic_write import json_text, write_json, write_text
from circnav_mav.runlog.summary import FlightFacts, summarise
from circnav_mav.runlog.ticks import NO_TICKS, Ticks, Truth, read_ticks, read_truth
from circnav_mav.runtime.listeners import Listeners
from circnav_mav.runtime.recorder import Recorder
from circnav_mav.runtime.reserve import Reserve

OUTCOMES = {
    ending: ending.value for ending in (Ending.COMPLETED, Ending.INTERRUPTED, Ending.TAKEN_OVER)
}
"""Value of `outcome` in summary.json for each ending. For an ending that is not listed, it is
"aborted"."""
LIBRARIES = ("pymavlink", "numpy", "filterpy")
"""Packages whose versions are written to the manifest, besides circnav and Python."""


def write_manifest(
    folder: Path, mission: Mission, pilot: Pilot, epoch_us: int, **end: object
) -> None:
    """Write manifest.json, the description of a run folder. Raises OSError.

    The file is written before the first step of the loop, so that the run of a killed process can
    be opened, and again at the end.

    end: outcome, reason and exit code, known only at the end.
    """
    versions: dict[str, str | None] = {"circnav": __version__, "python": platform.python_version()}
    for library in LIBRARIES:
        with suppress(PackageNotFoundError):
            versions[library] = version(library)
    seed = (mission.file.sim or {}).get("seed")
    session = pilot.session
    autopilot = dict[str, Any]()
    if session.up:
        system, component = session.vehicle_ids
        autopilot = {"system": system, "component": component, "name": session.adapter.name}
        autopilot["firmware"] = session.vehicle.firmware
    facts = {
        "mission": mission.file.name,
        "output_mode": pilot.output_mode.value,
        "epoch_us": epoch_us,
        "utc_epoch_us": session.vehicle.utc.offset and round(session.vehicle.utc.offset * 1e6),
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
    listeners: Listeners,
    reserve: Reserve | None = None,
) -> tuple[dict[str, Any], Exit]:
    """Write summary.json and the end of manifest.json. Return the summary and the exit code, which
    is NOT_RECORDED instead of DONE if the recording has gaps. reserve: descriptors and disk space
    for these files, None in a simulated fleet."""
    folder = recorder.folder
    if reserve is not None:
        reserve.release()
    # Read the recorder's problem before `_summary` is called: it adds problems of reading the
    # files, which are no gaps in the recording.
    gaps = recorder.problem is not None
    summary = _summary(pilot, recorder, mission, epoch_us)
    exit_result = pilot.exit_action.result(pilot.session)
    summary["notes"] = [f"  exit       {exit_result}"] if exit_result else []
    summary["alarms"] = alarms
    for name, text in listeners.finish(summary).items():
        gaps |= not _written(summary, name, partial(write_text, folder / name, text))
    write = write_text if reserve is None else reserve.write
    gaps |= not _written(
        summary, f"{folder}:", lambda: write(folder / "summary.json", json_text(summary))
    )
    code = Exit.NOT_RECORDED if gaps and code is Exit.DONE else code
    end = {"outcome": summary["outcome"], "reason": summary["reason"], "exit": int(code)}
    gaps = not _written(
        summary, "manifest.json", lambda: write_manifest(folder, mission, pilot, epoch_us, **end)
    )
    return summary, Exit.NOT_RECORDED if gaps and code is Exit.DONE else code


def _written(summary: dict[str, Any], name: str, write: Callable[[], None]) -> bool:
    """Write a file. Return True on success. On failure, store the problem in the summary if no
    earlier problem is stored: the first one usually causes the later ones."""
    try:
        write()
    except OSError as error:
        problem = f"{name} cannot be written: {error.strerror or error}"
        summary["recording_problem"] = summary["recording_problem"] or problem
        return False
    return True


def _summary(pilot: Pilot, recorder: Recorder, mission: Mission, epoch_us: int) -> dict[str, Any]:
    """Return the contents of summary.json, with null for figures that cannot be computed."""
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
        output_mode=pilot.output_mode.value,
        clock_speed=pilot.session.vehicle.clock_speed.noticed,
        engaged_s=pilot.mission.engaged_at,
        until_s=recorder.until,
    )
    for known in ((ticks, truth), (ticks, None)):
        try:
            return summarise(facts, *known)
        except Exception as error:
            problem = f"not all figures could be computed: {error}"
            facts = replace(facts, recording_problem=facts.recording_problem or problem)
    return summarise(facts, NO_TICKS, None)


def _recorded(recorder: Recorder, epoch_us: int, system: int | None) -> tuple[Ticks, Truth | None]:
    """Return ticks and truth as far as they can be read. If the disk was full from the start, there
    are no ticks and no truth."""
    ticks = NO_TICKS
    truth = None
    try:
        ticks = read_ticks(recorder.folder)
    except Exception as error:
        recorder.problem = recorder.problem or f"ticks.csv: {error}"
    try:
        truth = read_truth(recorder.folder, epoch_us, system)
    except Exception as error:
        recorder.problem = recorder.problem or f"flight.tlog: {error}"
    return ticks, truth
