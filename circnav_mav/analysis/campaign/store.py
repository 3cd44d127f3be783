"""The folder of a campaign: the table, streamed row by row, and what it was flown with, so that it can be resumed."""

import csv
import io
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from circnav_mav.analysis.campaign.figures import FIGURES, NUMBERS, columns
from circnav_mav.analysis.campaign.plan import Campaign

TABLE = "runs.csv"


class StoreError(Exception):
    """A folder that cannot be used or a disk that cannot be written, in one line."""


class Store:
    """The table of a campaign. What was written stays readable and can be resumed, whatever happens afterwards."""

    def __init__(self, folder: Path, campaign: Campaign, *, resume: bool = False) -> None:
        """Make the folder, or open that of an earlier run of the same campaign. Raises StoreError."""
        self.folder, self.done = folder, set[int]()
        self._columns, self._runs = columns(campaign), campaign.runs
        self._path = folder / TABLE
        sources = {"campaign.toml": campaign.text, "mission.toml": campaign.mission_text}
        try:
            if self._begun():
                self._reopen(sources, resume)
            else:
                folder.mkdir(parents=True, exist_ok=True)
                for name, text in sources.items():
                    (folder / name).write_text(text, encoding="utf-8")
                self._path.write_bytes(_line(self._columns))
            self._file = self._path.open("ab", buffering=0)
        except OSError as error:
            raise _cannot(self._path, error) from None

    def add(self, rows: Iterable[dict[str, Any]]) -> None:
        """Append the rows that are not there yet, each of them at once. Raises StoreError."""
        for row in rows:
            if row["run"] in self.done:
                continue
            line = _line([_cell(name, row.get(name)) for name in self._columns])
            try:
                if self._file.write(line) != len(line):
                    raise OSError(28, "No space left on device")
            except OSError as error:
                raise _cannot(self._path, error) from None
            self.done.add(row["run"])

    def close(self) -> None:
        """No more rows."""
        self._file.close()

    def sort(self) -> None:
        """Put the rows in the order of their runs: equal campaigns give equal files. Raises StoreError."""
        header, *lines = self._path.read_bytes().splitlines(keepends=True) or [b""]
        fresh = self._path.with_suffix(".sorted")
        try:
            fresh.write_bytes(header + b"".join(sorted(lines, key=_number)))
            os.replace(fresh, self._path)
        except OSError as error:
            fresh.unlink(missing_ok=True)
            raise _cannot(fresh, error) from None

    def read(self) -> list[dict[str, str]]:
        """The rows as text. Raises StoreError."""
        try:
            with self._path.open(newline="", encoding="utf-8") as file:
                return list(csv.DictReader(file))
        except OSError as error:
            raise _cannot(self._path, error) from None

    def _begun(self) -> bool:
        """Whether a row was written there; a header alone is of a campaign that nobody flew."""
        return self._path.exists() and self._path.read_bytes().count(b"\n") > 1

    def _reopen(self, sources: dict[str, str], resume: bool) -> None:
        """Take up where it stopped; a last line that was torn is dropped. Raises StoreError, OSError."""
        if not resume:
            raise StoreError(f"{self.folder}: holds a campaign already: --resume it, or name another --out")
        for name, text in sources.items():
            if (self.folder / name).read_bytes() != text.encode():
                raise StoreError(f"{self.folder}: cannot resume: {name} has changed since; name another --out")
        data = self._path.read_bytes()
        whole = data[: data.rfind(b"\n") + 1]
        header, *lines = whole.splitlines(keepends=True) or [_line(self._columns)]
        if header != _line(self._columns):
            raise StoreError(f"{self._path}: cannot resume: its columns are of another version; name another --out")
        if whole != data or not whole:
            self._path.write_bytes(header + b"".join(lines))
        for number, line in enumerate(lines, 2):
            run = self._whole(line)
            if run is None or run in self.done:
                raise StoreError(f"{self._path}: line {number} is damaged: delete it, and its run is flown again")
            self.done.add(run)

    def _whole(self, line: bytes) -> int | None:
        """The number of the run that a line tells of; None for a line that nobody wrote like this."""
        try:
            ((run, *cells),) = csv.reader([line.decode()], strict=True)
            for name, cell in zip(self._columns[1:], cells, strict=True):
                if name in NUMBERS and cell:
                    float(cell)
            return int(run) if run.isdecimal() and int(run) < self._runs else None
        except (ValueError, csv.Error):
            return None


def _cannot(path: Path, error: OSError) -> StoreError:
    return StoreError(f"{path}: cannot be written: {error.strerror or error}; what is there can be resumed")


def _number(line: Any) -> int:
    return int(line.split(b",", 1)[0])


def _line(cells: Iterable[str]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue().encode()


def _cell(name: str, value: Any) -> str:
    """Figures with six digits; what was varied so that it can be flown again exactly."""
    if value is None or isinstance(value, str):
        return " ".join(value.splitlines()) if value else ""
    if isinstance(value, float) and name in FIGURES:
        return f"{value:.6g}"
    return json.dumps(value)
