"""Folder of a campaign: its table, written row by row, and its input files, so that the campaign
can be resumed."""

import csv
import errno
import io
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from circnav_mav.extras.campaign.figures import FIGURES, NUMBERS, SUMMARY, columns
from circnav_mav.extras.campaign.plan import Campaign, CampaignError
from circnav_mav.foreign import read_bytes, read_lines
from circnav_mav.runlog.atomic_write import atomic_write
from circnav_mav.runtime.lock import lock

TABLE = "runs.csv"
MAX_TABLE = 10**10
"""Largest size of the table, bytes: ten million flights need less."""
SOURCE = "campaign.toml"
"""Copy of the campaign file. The process that flies the campaign holds a lock on it."""


class Store:
    """The table of a campaign. After any interruption, the table is readable and the campaign can
    be resumed.

    One process at a time uses the folder. Files of other campaigns are not overwritten.
    """

    def __init__(self, folder: Path, campaign: Campaign, *, resume: bool = False) -> None:
        """Create the folder, or open the folder of the same campaign to resume it. Raises
        CampaignError."""
        self.folder = folder
        self.done = set[int]()
        self._columns = columns(campaign)
        self._runs = campaign.runs
        self._path = folder / TABLE
        sources = {SOURCE: campaign.text, "mission.toml": campaign.mission_text}
        with ExitStack() as held:
            try:
                if folder.exists() and not (folder / SOURCE).is_file():
                    if resume and self._begun():
                        raise CampaignError(
                            f"{folder}: cannot resume: {SOURCE} is missing; name another --out"
                        )
                    self._refuse_foreign(sources)
                folder.mkdir(parents=True, exist_ok=True)
                held.enter_context(_lock(folder))
                if self._begun():
                    self._reopen(sources, resume)
                else:
                    self._refuse_foreign(sources)
                    for name, text in sources.items():
                        (folder / name).write_text(text, encoding="utf-8")
                    self._path.write_bytes(_line(self._columns))
                self._file = held.enter_context(self._path.open("ab", buffering=0))
            except OSError as error:
                raise CampaignError(
                    f"{error.filename or folder}: cannot be used: {error.strerror or error}"
                ) from None
            self._held = held.pop_all()

    def add(self, rows: Iterable[dict[str, Any]]) -> None:
        """Append new rows, each in one write. Raises CampaignError."""
        for row in rows:
            if row["run"] in self.done:
                continue
            line = _line([_cell(name, row.get(name)) for name in self._columns])
            with _refusing(self._path, "written", "; the rows written so far can be resumed"):
                if self._file.write(line) != len(line):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            self.done.add(row["run"])

    def close(self) -> None:
        """Close the table and release the folder."""
        self._held.close()

    def sort(self) -> None:
        """Sort the rows by run. Call after the last row: equal campaigns give equal files. Raises
        CampaignError."""
        with _refusing(self._path):
            header, *lines = read_bytes(self._path, MAX_TABLE).splitlines(keepends=True) or [b""]
            lines.sort(key=lambda line: int(line.partition(b",")[0]))
            with atomic_write(self._path) as fresh:
                fresh.write_bytes(header + b"".join(lines))

    def read(self) -> list[dict[str, str]]:
        """Return the rows as text. Raises CampaignError."""
        with _refusing(self._path):
            return list(csv.DictReader(read_lines(self._path)))

    def _begun(self) -> bool:
        """True if the table has a row. A header alone is left by a campaign that was not flown."""
        return self._path.exists() and read_bytes(self._path, MAX_TABLE).count(b"\n") > 1

    def _refuse_foreign(self, sources: dict[str, str]) -> None:
        """Refuse a folder with files that would be overwritten, except incomplete files of this
        very campaign.

        Raises CampaignError, OSError.
        """
        whole = {name: text.encode() for name, text in sources.items()} | {
            TABLE: _line(self._columns)
        }
        if all(_bytes(self.folder / name) == text for name, text in whole.items()):
            return
        for path in sorted(self.folder.iterdir()):
            of_ours = path.name in whole and whole[path.name].startswith(
                read_bytes(path, MAX_TABLE)
            )
            if not of_ours and (path.name in {*whole, SUMMARY} or path.suffix == ".png"):
                raise CampaignError(
                    f"{self.folder}: holds {path.name}, which is not a file of this campaign: name"
                    " another --out"
                )

    def _reopen(self, sources: dict[str, str], resume: bool) -> None:
        """Continue an interrupted table. An incomplete last line is dropped. Raises CampaignError,
        OSError."""
        if not resume:
            raise CampaignError(
                f"{self.folder}: holds a campaign already: --resume it, or name another --out"
            )
        for name, text in sources.items():
            there = _bytes(self.folder / name)
            if there != text.encode():
                what = "has changed since" if there else "is missing"
                raise CampaignError(
                    f"{self.folder}: cannot resume: {name} {what}; name another --out"
                )
        data = read_bytes(self._path, MAX_TABLE)
        whole = data[: data.rfind(b"\n") + 1]
        header, *lines = whole.splitlines(keepends=True)
        if header != _line(self._columns):
            raise CampaignError(
                f"{self._path}: cannot resume: its columns are those of another version; name"
                " another --out"
            )
        if whole != data:
            self._path.write_bytes(whole)
        for number, line in enumerate(lines, 2):
            run = self._whole(line)
            if run is None or run in self.done:
                raise CampaignError(
                    f"{self._path}: line {number} is damaged: delete it, and its run is flown again"
                )
            self.done.add(run)
        beyond = [run for run in self.done if run >= self._runs]
        if beyond:
            raise CampaignError(
                f"{self._path}: already holds run {min(beyond)}: give --runs of at least"
                f" {max(beyond) + 1}"
            )

    def _whole(self, line: bytes) -> int | None:
        """Return the run number of a line, or None if the line is damaged."""
        try:
            ((run, *cells),) = csv.reader([line.decode()], strict=True)
            for name, cell in zip(self._columns[1:], cells, strict=True):
                if name in NUMBERS and cell:
                    float(cell)
            return int(run) if run.isdecimal() else None
        except (ValueError, csv.Error):
            return None


def _bytes(path: Path) -> bytes:
    """Return the contents of a file; empty if it does not exist."""
    return read_bytes(path, MAX_TABLE) if path.is_file() else b""


@contextmanager
def _lock(folder: Path) -> Iterator[None]:
    """Lock the folder against other processes. Raises CampaignError, OSError."""
    with (folder / SOURCE).open("ab") as file:
        if not lock(file):
            raise CampaignError(
                f"{folder}: another process is flying a campaign there: wait, or name another --out"
            )
        yield


@contextmanager
def _refusing(path: Path, what: str = "read or written", remedy: str = "") -> Iterator[None]:
    """Turn an error of the file system into one line. Raises CampaignError."""
    try:
        yield
    except OSError as error:
        raise CampaignError(
            f"{path}: cannot be {what}: {error.strerror or error}{remedy}"
        ) from None


def _line(cells: Iterable[str]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue().encode()


def _cell(name: str, value: Any) -> str:
    """Return a cell: figures with six digits, lengths to 0.01 mm, varied values exactly."""
    if value is None or isinstance(value, str):
        return " ".join(value.splitlines()) if value else ""
    if isinstance(value, float) and name in FIGURES:
        # 5: decimals of a length in m. 4: decimals of the figures of the turn command. Later digits
        # depend on the order in which numpy adds.
        decimals = 5 if name.endswith("_m") else 4 if name.startswith("turn_") else None
        return f"{value if decimals is None else round(value, decimals) + 0.0:.6g}"
    return json.dumps(value)
