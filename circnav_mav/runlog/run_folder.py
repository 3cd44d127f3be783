"""A run folder opened: what it says of itself, whatever became of the process that wrote it."""

import csv
import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from circnav_mav.runlog.ticks import Ticks, Truth, read_ticks, read_truth
from circnav_mav.runlog.tlog import Damage, find_damage

MOST = 10**15
"""No number of a run is as large: counts, metres, and seconds are smaller."""
YEAR_2100_US = 4_102_444_800_000_000
Text = Annotated[str, Field(strict=True)]
Flag = Annotated[bool, Field(strict=True)]
Number = Annotated[float, Field(strict=True, gt=-MOST, lt=MOST)]
Count = Annotated[int, Field(strict=True, ge=0, lt=MOST)]
Moment = Annotated[int, Field(strict=True, gt=0, lt=YEAR_2100_US)]


class Alarm(BaseModel):
    """An alarm as it began."""

    time_s: Number
    text: Text


def _table(kinds: dict[Any, str]) -> dict[str, TypeAdapter[Any]]:
    return {key: TypeAdapter(kind) for kind, keys in kinds.items() for key in keys.split()}


# Of the figures of the circle only their time is read back: they are worked out of the ticks again.
SUMMARY = _table({
    Text: "mission voice outcome reason version",
    Text | None: "firmware recording_problem",
    Count: "samples_accepted setpoints_sent",
    dict[str, Count]: "samples_rejected frames_refused",
    Moment: "epoch_us",
    Number: "flown_s",
    Number | None: "engaged_s clock_speed",
    list[Alarm]: "alarms",
    list[Text]: "notes",
})  # fmt: skip
MANIFEST = _table({
    Text: "mission voice",
    Text | None: "outcome reason",
    Moment: "epoch_us",
    dict[Text, Any]: "seeds versions",
    dict[Text, Any] | None: "autopilot",
    Count | None: "exit",
})  # fmt: skip


def _known(table: Any, kinds: dict[str, TypeAdapter[Any]]) -> dict[str, Any]:
    """What a JSON file says that can be believed."""
    known = {}
    for key, kind in kinds.items():
        with suppress(ValidationError, KeyError, TypeError):  # TypeError: it holds no table at all
            kind.validate_python(table[key])
            known[key] = table[key]
    return known


class RunError(Exception):
    """A run that cannot be opened, in one line."""


@dataclass(frozen=True)
class Run:
    """A run folder. manifest, summary: the valid values of the files; empty if the run did not live to write them, or
    they are damaged. unread: what extras have added to the summary; each extra validates its own."""

    folder: Path
    mission_text: str
    manifest: dict[str, Any]
    summary: dict[str, Any]
    epoch_us: int
    unread: dict[str, Any] = field(default_factory=dict)

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
    manifest, written = _known(_json(folder / "manifest.json"), MANIFEST), None
    with suppress(RunError):  # a full disk may have left half of it; its figures can be made anew
        written = _json(folder / "summary.json")
    summary = _known(written, SUMMARY)
    unread = {key: value for key, value in written.items() if key not in SUMMARY} if isinstance(written, dict) else {}
    epoch = manifest.get("epoch_us") or summary.get("epoch_us")
    if epoch is None:
        raise RunError(f"{folder}: neither manifest.json nor summary.json tells when the run began (epoch_us)")
    with _refusing(folder / "mission.toml"):
        text = (folder / "mission.toml").read_text(encoding="utf-8")
    return Run(folder, text, manifest, summary, epoch, unread)


def printable(name: str) -> str:
    """A name as text: what of it UTF-8 cannot hold becomes a question mark."""
    return name.encode("utf-8", "replace").decode()


def _json(path: Path) -> Any:
    """What a JSON file holds; None if there is none. Raises RunError."""
    with _refusing(path):
        try:
            return json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    """What is wrong with a file, in one line. Raises RunError."""
    try:
        yield
    except RecursionError:
        raise RunError(f"{path}: is nested too deeply") from None
    except (OSError, ValueError, csv.Error) as error:
        raise RunError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
