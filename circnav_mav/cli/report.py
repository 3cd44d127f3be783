"""`circnav report`, and the report at the end of `fly`."""

import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from circnav_mav import __version__
from circnav_mav.cli.drawing import LOG
from circnav_mav.cli.exits import Exit, Refused, refusing, say, warn
from circnav_mav.cli.progress import progress
from circnav_mav.cli.verdict import verdict
from circnav_mav.extension import extensions, load
from circnav_mav.guidance.types import Direction
from circnav_mav.mission.load import MissionError, parse_mission
from circnav_mav.mission.mission import Mission
from circnav_mav.report.page import write_report
from circnav_mav.report.plots import plot_flight
from circnav_mav.runlog.run_folder import Run, RunError, open_run
from circnav_mav.runlog.summary import FlightFacts, summarise

READ_BACK = {field.name for field in fields(FlightFacts)} | {"flown_s", "alarms", "notes"}
"""Keys of summary.json that are shown unchanged. The figures of the circle are computed again from
the ticks."""


def report_run(folder: str, after_flight: bool) -> int:
    """Write report.html and flight.png into a run folder. Raises Refused.

    after_flight: wait for a line on standard input before drawing, and print only the files that
        cannot be made.
    """
    log = Path(folder) / LOG
    if after_flight:
        if sys.stdin.readline():
            _report_flight(folder)
        with suppress(OSError):
            if not log.stat().st_size:
                log.unlink()
        return Exit.DONE
    with refusing(folder, RunError, MissionError):
        run = open_run(Path(folder))
        if not len(run.ticks.time):
            raise Refused(f"{folder}: an empty run, nothing was recorded", Exit.NOTHING_RECEIVED)
        if len(run.ticks.time) == 1:
            raise Refused(
                f"{folder}: only one tick was recorded, a report needs two", Exit.NOTHING_RECEIVED
            )
        mission = _mission(run)
        warn(run.damage_text)
        with progress("drawing flight.png and report.html"):
            _picture(run, mission)
            # The page contains the picture, so draw the page last.
            _page(run, mission)
        log.unlink(missing_ok=True)
        say(f"{run.folder / 'report.html'}\n{run.folder / 'flight.png'}")
    return Exit.DONE


def _report_flight(folder: str) -> None:
    run: Run | None = None
    for name, make in (("flight.png", _picture), ("report.html", _page)):
        try:
            run = run or open_run(Path(folder))
            if len(run.ticks.time) > 1:
                make(run, _mission(run))
        except Exception as error:
            say(f"{Path(folder) / name}: could not be made: {error}")


def _mission(run: Run) -> Mission:
    return parse_mission(run.mission_text, str(run.folder / "mission.toml"))


def _picture(run: Run, mission: Mission) -> None:
    title = f"{run.name}: {mission.orbit.words()}, law {mission.law.name}"
    plot_flight(run.folder / "flight.png", run.ticks, run.truth, mission.orbit, title)


def _page(run: Run, mission: Mission) -> None:
    """Write report.html, with the sections that extensions add."""
    summary = _figures(run, mission) | {
        key: run.summary[key] for key in READ_BACK & run.summary.keys()
    }
    if run.damage_text is not None:
        summary["recording_problem"] = "; ".join(
            filter(None, (summary["recording_problem"], run.damage_text))
        )
    asked = replace(
        mission.orbit,
        radius=summary["desired_radius_m"],
        direction=Direction(summary["direction"]),
    )
    circles = asked.words()
    gate = mission.estimation.gate
    write_report(
        run,
        mission.orbit,
        circles,
        gate,
        verdict(summary, run.folder),
        _settings(mission),
        _added(run),
    )


def _added(run: Run) -> str:
    """Return the sections of extensions as HTML. A section that fails is left out, and a printed
    line names it."""
    sections = []
    for reference in (one.report_section for one in extensions() if one.report_section):
        try:
            sections.append(load(reference)(run))
        except Exception as error:
            say(f"{run.folder / 'report.html'}: {reference}: left out: {error}")
    return "".join(sections)


def _settings(mission: Mission) -> dict[str, str]:
    """Return all values of the mission by key, with defaults, without the [sim] table."""
    values = dict(_flat(mission.file.model_dump(exclude={"sim"}, exclude_none=True)))
    gain = "" if mission.law.name in mission.own_code else f", k = {mission.law.gain:.4g}"
    return values | {"law as flown": f"{mission.law.name}{gain}"}


def _flat(table: dict[str, Any], before: str = "") -> Iterator[tuple[str, str]]:
    """Yield (key, value) of a table and its subtables, values as in a mission file, strings without
    quotes."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield before + key, value if isinstance(value, str) else tomlkit.item(value).as_string()


def _figures(run: Run, mission: Mission) -> dict[str, Any]:
    """Return a summary computed from the ticks, the truth and the manifest, as if summary.json were
    missing.

    Only the time of engagement and the time flown are taken from summary.json, if it has them.
    """
    manifest = run.manifest
    counts = run.ticks.numbers
    engaged, flown = map(run.summary.get, ("engaged_s", "flown_s"))
    # These counts only increase, so the largest value is the newest one.
    accepted, rejected = (
        int(np.nanmax(counts[name], initial=0)) for name in ("accepted", "rejected")
    )
    return summarise(
        FlightFacts(
            mission=run.name,
            output_mode=run.output_mode,
            outcome=manifest.get("outcome") or "unfinished",
            reason=manifest.get("reason") or "the process ended before the flight",
            orbit=mission.orbit,
            samples_accepted=accepted,
            samples_rejected={"in all": rejected} if rejected else {},
            setpoints_sent=int(np.isfinite(run.ticks.numbers["yaw_rate_sent"]).sum()),
            firmware=None,
            version=str(manifest.get("versions", {}).get("circnav", __version__)),
            epoch_us=run.epoch_us,
            recording_problem=(
                "summary.json is missing or incomplete: figures from the recorded ticks"
            ),
            engaged_s=engaged,
            until_s=None if engaged is None or flown is None else engaged + flown,
        ),
        run.ticks,
        run.truth,
    )
