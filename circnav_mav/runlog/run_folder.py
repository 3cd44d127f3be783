"""Reading of a run folder, even if the process that wrote it was killed."""

import csv
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from circnav_mav.foreign import printable, read_json, read_text
from circnav_mav.runlog.ticks import Ticks, Truth, read_ticks, read_truth
from circnav_mav.runlog.tlog import Damage, find_damage


class RunError(Exception):
    """A run that cannot be opened. The message is one line."""


@dataclass(frozen=True)
class Run:
    """Run folder.

    mission_text: contents of mission.toml.
    manifest: contents of manifest.json, empty if missing.
    summary: contents of summary.json, empty if damaged, or missing because the process was killed.
    epoch_us: Unix time of run time zero, us.
    """

    folder: Path
    mission_text: str
    manifest: dict[str, Any]
    summary: dict[str, Any]
    epoch_us: int

    @property
    def output_mode(self) -> str:
        """Output mode of the pilot, "fly" by default."""
        return str(self.manifest.get("output_mode") or "fly")

    @property
    def name(self) -> str:
        """Name of the mission."""
        return printable(
            self.manifest.get("mission") or self.summary.get("mission") or self.folder.name
        )

    @cached_property
    def ticks(self) -> Ticks:
        """All recorded ticks. Raises RunError."""
        with _refusing(self.folder / "ticks.csv"):
            return read_ticks(self.folder)

    @cached_property
    def truth(self) -> Truth | None:
        """Truth of the simulator, or None. Raises RunError."""
        with _refusing(self.folder / "flight.tlog"):
            return read_truth(
                self.folder, self.epoch_us, (self.manifest.get("autopilot") or {}).get("system")
            )

    @cached_property
    def damage(self) -> Damage | None:
        """Damage of flight.tlog, or None. Raises RunError."""
        with _refusing(self.folder / "flight.tlog"):
            return find_damage(self.folder / "flight.tlog")

    @property
    def damage_text(self) -> str | None:
        """Damage of flight.tlog as text, with the run time at which the damage begins, or None.
        Raises RunError."""
        found = self.damage
        if found is None:
            return None
        until, newest = (
            max(stamp - self.epoch_us, 0) / 1e6 for stamp in (found.until, found.newest)
        )
        end = max(newest, self.ticks.end)
        first = "" if found.cut else "from "
        return f"flight.tlog: {found} ({first}{until:.1f} s of {end:.1f} s)"


def is_run(folder: Path) -> bool:
    """True if a folder holds the files of a run."""
    return (folder / "flight.tlog").is_file() and (folder / "mission.toml").is_file()


def open_run(folder: Path) -> Run:
    """Open a run folder. Raises RunError."""
    if not folder.exists():
        raise RunError(f"{folder}: no such run folder")
    if not is_run(folder):
        raise RunError(f"{folder}: is not a run folder: flight.tlog or mission.toml is missing")
    manifest = _table(folder / "manifest.json")
    summary = dict[str, Any]()
    # The figures of summary.json can be computed again.
    with suppress(RunError):
        summary = _table(folder / "summary.json")
    epoch = manifest.get("epoch_us") or summary.get("epoch_us")
    # Start of 2100, microseconds since 1970. A later start time means a damaged manifest.
    if type(epoch) is not int or not 0 < epoch < 4_102_444_800_000_000:
        raise RunError(
            f"{folder}: neither manifest.json nor summary.json has the start time of the run"
            " (epoch_us)"
        )
    with _refusing(folder / "mission.toml"):
        text = read_text(folder / "mission.toml")
    return Run(folder, text, manifest, summary, epoch)


def _table(path: Path) -> dict[str, Any]:
    """Return the table of a JSON file. Empty if the file does not exist or does not contain a
    table. Raises RunError."""
    with _refusing(path):
        table = read_json(path) if path.exists() else {}
        return table if isinstance(table, dict) else {}


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    """Convert errors of reading a file to RunError, with a one-line message."""
    try:
        yield
    except UnicodeDecodeError:
        raise RunError(f"{path}: is not a text file in UTF-8: save it as one") from None
    except (OSError, ValueError, csv.Error) as error:
        raise RunError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
