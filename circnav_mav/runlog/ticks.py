"""Reading of ticks.csv as columns, and of the simulator's truth from flight.tlog."""

import csv
from array import array
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path
from sys import intern
from typing import get_type_hints

import numpy as np
from numpy.typing import NDArray

from circnav_mav.foreign import read_lines
from circnav_mav.guidance.types import Direction, Orbit
from circnav_mav.mav.truth import read_truth_frame
from circnav_mav.pilot import TickRecord
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.pilot.record import COLUMNS
from circnav_mav.runlog.tlog import read_tlog

Column = NDArray[np.float64]

NAMES = frozenset(COLUMNS)
WORDS = frozenset(name for name, kind in get_type_hints(TickRecord).items() if kind in (str, Phase))
"""Columns of ticks.csv that hold text."""
CHOICES = {
    "phase": [phase.value for phase in Phase],
    "direction": ["", *(direction.value for direction in Direction)],
}
"""Words that a column of ticks.csv may hold, of columns that do not hold free text."""
MOST = 1e30
"""Largest absolute value of a number in ticks.csv. A larger number is read as NaN."""


@dataclass(frozen=True, slots=True)
class Ticks:
    """Columns of ticks.csv: numbers as arrays over ticks (NaN for an empty cell), texts as
    lists."""

    numbers: dict[str, Column]
    words: dict[str, list[str]]

    @property
    def time(self) -> Column:
        """Run time of each tick, s."""
        return self.numbers["time"]

    @property
    def end(self) -> float:
        """Run time of the last tick, s, or 0 without ticks."""
        return float(self.time[-1]) if len(self.time) else 0.0

    def desired(self, otherwise: float) -> Column:
        """Return the desired radius of each tick, m. otherwise: radius for ticks that have none,
        m."""
        return np.where(np.isnan(self.numbers["desired"]), otherwise, self.numbers["desired"])

    def steady_turn(self, orbit: Orbit) -> Column:
        """Return the turn rate of the desired circle at each tick, rad/s. orbit: radius and
        direction for ticks that have none."""
        words = self.words["direction"]
        signs = np.array([Direction(one or orbit.direction.value).turn_sign for one in words])
        return np.asarray(signs * orbit.speed / self.desired(orbit.radius))

    def radii(self, otherwise: float) -> list[float]:
        """Return the radii of the flown circles, in order, m. otherwise: radius of ticks that have
        none, and of a run without ticks, m."""
        desired = self.desired(otherwise)
        return [float(r) for r in desired[np.diff(desired, prepend=nan) != 0]] or [otherwise]

    @property
    def engaged_at(self) -> float | None:
        """Run time of the first engaged tick, s."""
        return next(
            (
                float(t)
                for t, phase in zip(self.time, self.words["phase"], strict=True)
                if phase == "engaged"
            ),
            None,
        )


NO_TICKS = Ticks({name: np.array([]) for name in NAMES - WORDS}, {name: [] for name in WORDS})
"""Ticks of a run in which none could be written."""


@dataclass(frozen=True, slots=True)
class Truth:
    """Truth of the simulator, arrays over samples: run time at reception (s), north and east
    position of vehicle and target from the origin (m), turn rate (rad/s, clockwise), and time of
    the simulator (s)."""

    time: Column
    north: Column
    east: Column
    target_north: Column
    target_east: Column
    turn_rate: Column
    sim_time: Column

    @property
    def radius(self) -> Column:
        """Horizontal distance to the target, m."""
        return np.hypot(self.north - self.target_north, self.east - self.target_east)


def read_ticks(folder: Path) -> Ticks:
    """Return the ticks of a run folder. A truncated last line is skipped. Missing columns and
    impossible numbers are NaN.

    Raises OSError, csv.Error, and ValueError that names the line if a cell is not a number or time
    decreases.
    """
    with closing(read_lines(folder / "ticks.csv")) as lines:
        numbers, words = _columns(csv.reader(lines))
    times = numbers["time"]
    count = len(times)
    if count > 1 and times[0] == times[-1]:
        raise ValueError("line 3: time: does not increase to the end")
    missing = NAMES - numbers.keys() - words.keys()
    words |= {name: [""] * count for name in missing & WORDS}
    numbers |= {name: array("d", [nan]) * count for name in missing - WORDS}
    return Ticks(
        {name: _plausible(np.array(cells)) for name, cells in numbers.items()},
        words,
    )


def _columns(rows: Iterator[list[str]]) -> tuple[dict[str, "array[float]"], dict[str, list[str]]]:
    """Return the columns of numbers and of text. Raises ValueError, csv.Error."""
    header = next(rows, [])
    words: dict[str, list[str]] = {name: [] for name in header if name in WORDS}
    numbers = {name: array("d") for name in header if name not in WORDS}
    if "time" not in numbers or len(words) + len(numbers) < len(header):
        raise ValueError("has no header")
    # Convert line by line: the text of a long flight needs ten times the memory of its numbers.
    for line, row in enumerate(rows, 2):
        if len(row) != len(header):
            continue
        try:
            for name, cell in zip(header, row, strict=True):
                if name in words:
                    words[name].append(_word(name, cell))
                else:
                    numbers[name].append(_number(name, cell))
            _check_time(numbers["time"])
        except ValueError as error:
            raise ValueError(f"line {line}: {error}") from None
    return numbers, words


def _word(name: str, cell: str) -> str:
    """Return the text of a cell. Raises ValueError if the column may not hold it."""
    if name in CHOICES and cell not in CHOICES[name]:
        choices = ", ".join(filter(None, CHOICES[name]))
        raise ValueError(f"{name}: {cell[:40]!r} is none of {choices}")
    return intern(cell)


def _number(name: str, cell: str) -> float:
    """Return the number in a cell, NaN if it is empty. Raises ValueError."""
    try:
        return float(cell) if cell else nan
    except ValueError:
        raise ValueError(f"{name}: {cell[:40]!r} is not a number") from None


def _plausible(column: Column) -> Column:
    """Return a column with NaN instead of impossible numbers."""
    return np.where(np.abs(column) < MOST, column, nan)


def _check_time(times: Sequence[float]) -> None:
    """Raise ValueError if the newest time is impossible, or before the time of the line above."""
    # Upper bound of a run time, s. A larger time means a damaged file.
    if not 0 <= times[-1] < 1e9:
        raise ValueError(f"time: must be seconds of the run, not {times[-1]:g}")
    if times[-1] < times[-2:][0]:
        raise ValueError(f"time: {times[-1]:.6f} comes after {times[-2]:.6f}")


def read_truth(folder: Path, epoch_us: int, system: int | None = None) -> Truth | None:
    """Return the simulator's truth of a run, or None. Frames with non-finite numbers are skipped,
    because any sender may have made them.

    epoch_us: Unix time of run time zero, us. system: MAVLink system id of the vehicle, None for the
    first sender of truth.
    """
    rows = array("d")
    for stamp, frame in read_tlog(folder / "flight.tlog"):
        numbers = read_truth_frame(frame)
        if numbers is None or not all(map(isfinite, numbers)):
            continue
        # Byte 5 of a MAVLink 2 frame is the system id. Truth is sent only in MAVLink 2.
        system = frame[5] if system is None else system
        if frame[5] == system:
            rows.extend(((stamp - epoch_us) / 1e6, *numbers))
    if not rows:
        return None
    table = np.array(rows).reshape(-1, 17)
    return Truth(
        table[:, 0], table[:, 1], table[:, 2], table[:, 10], table[:, 11], table[:, 8], table[:, 16]
    )
