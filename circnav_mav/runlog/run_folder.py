"""A run folder opened: what it says of itself, whatever became of the process that wrote it."""

import csv
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError, create_model

from circnav_mav.foreign import printable, read_json, read_text
from circnav_mav.mission.problems import in_words
from circnav_mav.runlog.summary import FlightFacts
from circnav_mav.runlog.ticks import Ticks, Truth, read_ticks, read_truth
from circnav_mav.runlog.tlog import Damage, find_damage

YEAR_2100_US = 4_102_444_800_000_000
"""Start of 2100, microseconds since 1970: later is a damaged manifest."""


class _Autopilot(BaseModel, strict=True):
    """The autopilot in manifest.json, as far as it is read back."""

    system: int | None = None


class _Manifest(BaseModel, strict=True):
    """The values of manifest.json that are read back. A file edited by hand may hold any type."""

    mission: str | None = None
    voice: str | None = None
    outcome: str | None = None
    reason: str | None = None
    seeds: dict[str, Any] | None = None
    versions: dict[str, Any] | None = None
    autopilot: _Autopilot | None = None


class _Alarm(BaseModel, strict=True):
    """An alarm in summary.json."""

    time_s: float
    text: str


_read_back: dict[str, Any] = {field.name: (field.type, None) for field in fields(FlightFacts) if field.name != "orbit"}
_read_back |= {"flown_s": (float, 0.0), "alarms": (list[_Alarm], []), "notes": (list[str], [])}
_Summary = create_model("_Summary", __cls_kwargs__={"strict": True}, **_read_back)
"""The values of summary.json that are read back, by their types in a flight."""


class RunError(Exception):
    """A run that cannot be opened, in one line."""


@dataclass(frozen=True)
class Run:
    """A run folder. manifest, summary: empty if the process ended before it wrote them, or if they are damaged."""

    folder: Path
    mission_text: str
    manifest: dict[str, Any]
    summary: dict[str, Any]
    epoch_us: int

    @property
    def voice(self) -> str:
        """What the pilot was allowed to say."""
        return str(self.manifest.get("voice", "fly"))

    @property
    def name(self) -> str:
        """The mission's name."""
        return printable(self.manifest.get("mission") or self.summary.get("mission") or self.folder.name)

    @cached_property
    def ticks(self) -> Ticks:
        """Every step that acted. Raises RunError."""
        with _refusing(self.folder / "ticks.csv"):
            return read_ticks(self.folder)

    @cached_property
    def truth(self) -> Truth | None:
        """The simulator's truth, None when there was none. Raises RunError."""
        with _refusing(self.folder / "flight.tlog"):
            return read_truth(self.folder, self.epoch_us, (self.manifest.get("autopilot") or {}).get("system"))

    @cached_property
    def damage(self) -> Damage | None:
        """What of flight.tlog cannot be read. Raises RunError."""
        with _refusing(self.folder / "flight.tlog"):
            return find_damage(self.folder / "flight.tlog")

    @property
    def damage_text(self) -> str | None:
        """The same in words, and where that is in the flight; None if all of it can be read. Raises RunError."""
        found = self.damage
        if found is None:
            return None
        until, newest = (max(stamp - self.epoch_us, 0) / 1e6 for stamp in (found.until, found.newest))
        end = max(newest, float(self.ticks.time[-1]) if len(self.ticks.time) else 0.0)
        first = "" if found.cut else "from "
        return f"flight.tlog: {found} ({first}{until:.1f} s of {end:.1f} s)"


def open_run(folder: Path) -> Run:
    """Open a run folder. Raises RunError."""
    if not folder.exists():
        raise RunError(f"{folder}: no such run folder")
    if not folder.is_dir() or not (folder / "flight.tlog").is_file() or not (folder / "mission.toml").is_file():
        raise RunError(f"{folder}: is not a run folder: flight.tlog or mission.toml is missing")
    manifest, summary = _table(folder / "manifest.json"), dict[str, Any]()
    with suppress(RunError):  # its figures can be made anew
        summary = _table(folder / "summary.json")
    _check_types(folder / "manifest.json", manifest, _Manifest)
    _check_types(folder / "summary.json", summary, _Summary)
    epoch = manifest.get("epoch_us") or summary.get("epoch_us")
    if type(epoch) is not int or not 0 < epoch < YEAR_2100_US:
        raise RunError(f"{folder}: neither manifest.json nor summary.json tells when the run began (epoch_us)")
    with _refusing(folder / "mission.toml"):
        text = read_text(folder / "mission.toml")
    return Run(folder, text, manifest, summary, epoch)


def _table(path: Path) -> dict[str, Any]:
    """Values of a JSON file by their keys; none if there is no such file or no table in it. Raises RunError."""
    with _refusing(path):
        table = read_json(path) if path.exists() else {}
        return table if isinstance(table, dict) else {}


def _check_types(path: Path, table: dict[str, Any], schema: type[BaseModel]) -> None:
    """Check the values that are read back. Raises RunError that names file and key."""
    try:
        schema.model_validate(table)
    except ValidationError as error:
        raise RunError(f"{path}: {in_words(error, schema)}: correct it, or delete the file") from None


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    """What is wrong with a file, in one line. Raises RunError."""
    try:
        yield
    except RecursionError:
        raise RunError(f"{path}: is nested too deeply") from None
    except UnicodeDecodeError:
        raise RunError(f"{path}: is not a text file in UTF-8: save it as one") from None
    except (OSError, ValueError, csv.Error) as error:
        raise RunError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
