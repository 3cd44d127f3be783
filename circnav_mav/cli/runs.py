"""`circnav runs clean`: deletes old run folders, and nothing else."""

import re
import shutil
import sys
from pathlib import Path
from typing import NamedTuple

import click

from circnav_mav.cli.exits import Exit, Refused, refusing, say
from circnav_mav.extension import extensions
from circnav_mav.pilot.loop_step import OLD_STEPS, STEPS
from circnav_mav.runtime.clock import unix_time
from circnav_mav.runtime.lock import is_held

HOURS = {"h": 1, "d": 24, "w": 168}
NEEDED = frozenset({"flight.tlog", "mission.toml", "ticks.csv"})
"""Files that each run folder holds from its start, besides the file of steps."""
MADE = NEEDED | {STEPS, OLD_STEPS, "manifest.json", "summary.json", "error.txt", "flight.png", "estimates.png",
                 "report.html", "replay.png"}  # fmt: skip
"""All files that the core writes into a run folder."""


class RunFolder(NamedTuple):
    """Run folder. written: time of the last write to flight.tlog, s since 1970. size: bytes. kept: reason not to delete
    it at any age, else empty."""

    folder: Path
    written: float
    size: int
    kept: str


def clean_runs(folder: str, older_than: str, keep: int, yes: bool) -> int:
    """List old runs, and delete them if confirmed. Raises Refused."""
    age = _seconds(older_than)
    with refusing(folder):
        found = sorted(find_runs(Path(folder)), key=lambda run: -run.written)
        old = [run for run in found[keep:] if unix_time() - run.written > age]
        doomed = [run for run in old if not run.kept]
        for run in old:
            say(f"{run.size / 1e6:8.1f} MB  {run.folder}{run.kept and f'   kept: {run.kept}'}")
        size = sum(run.size for run in doomed) / 1e6
        which = f"older than {older_than}, except the newest {keep}"
        say(f"{len(doomed)} of {len(found)} runs: {which}: {size:.1f} MB")
        if doomed and not yes and not sys.stdin.isatty():
            say("Nothing is deleted without --yes.")
        elif doomed and (yes or click.confirm("Delete them?")):
            for run in doomed:
                shutil.rmtree(run.folder)
            say("deleted")
    return Exit.DONE


def find_runs(folder: Path) -> list[RunFolder]:
    """Return the run folders directly in a folder, ignoring links. Raises OSError."""
    found, made = [], MADE.union(*(extension.files for extension in extensions()))
    for place in folder.iterdir():
        if place.is_symlink() or not place.is_dir():
            continue
        files = {path.name: path for path in place.iterdir()}
        if set(files) >= NEEDED and {STEPS, OLD_STEPS} & set(files):
            size = sum(path.lstat().st_size for path in files.values())
            foreign = ", ".join(sorted(set(files) - made))
            flies = "its flight is being recorded" if is_held(files["flight.tlog"]) else ""
            kept = flies or (foreign and f"{foreign} is not a file of circnav")
            found.append(RunFolder(place, files["flight.tlog"].stat().st_mtime, size, kept))
    return found


def _seconds(text: str) -> float:
    match = re.fullmatch(r"(\d+)([hdw])", text)
    if match is None:
        raise Refused(f"--older-than {text}: write hours, days or weeks: 12h, 30d, 4w")
    return int(match[1]) * HOURS[match[2]] * 3600.0
