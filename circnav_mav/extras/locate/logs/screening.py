"""Screening of a log: removes values that are not measurements, such as positions before the fix,
and repeated values of a receiver or radio."""

from collections.abc import Callable, Sequence
from itertools import chain, groupby
from operator import itemgetter
from typing import TypeVar

import numpy as np

from circnav_mav.extras.locate.place import Plane
from circnav_mav.extras.locate.range_log import Position, Range, RangeLog

FROZEN_FOR = 3.0
"""Smallest duration of a frozen stretch, s. In a frozen stretch, a receiver or radio repeats a
value without measuring."""
FROZEN_COUNT = 6
"""Smallest number of equal values of a frozen stretch."""
Row = TypeVar("Row", Position, Range)


def screen(log: RangeLog) -> None:
    """Remove values that are not measurements, and add notes."""
    # 0.01: largest latitude and longitude of a receiver without a fix, degrees: 1.1 km around 0 N 0
    # E, in the sea.
    kept = [row for row in log.positions if max(abs(row[1]), abs(row[2])) > 0.01]
    if len(kept) < len(log.positions):
        log.note(
            f"{len(log.positions) - len(kept)} positions near 0 N 0 E, before a fix, are left out"
        )
    log.positions = _moving(log, kept)
    log.ranges = {tag: _measured(log, tag, rows) for tag, rows in log.ranges.items()}


def _moving(log: RangeLog, positions: Sequence[Position]) -> list[Position]:
    """Remove positions that a receiver repeated while the vehicle moved."""
    if len(positions) < 2:
        return list(positions)
    plane = Plane(*positions[0][1:3])
    kept = list[Position]()
    rows = sorted(positions)
    runs = _runs(rows, itemgetter(1, 2))
    for run, after in zip(runs, [*runs[1:], None], strict=True):
        first, last = run[0], run[-1]
        jump = 0.0
        if after is not None and _duration(run) > FROZEN_FOR:
            here, there = (np.array(plane.to_metres(*row[1:3])) for row in (last, after[0]))
            jump = float(np.hypot(*(there - here)))
        # 5.0: smallest jump of the position after a frozen stretch, m, that shows that the vehicle
        # has moved during the stretch.
        if jump > 5.0:
            log.note(
                f"positions do not change from {first[0] - rows[0][0]:.1f} to"
                f" {last[0] - rows[0][0]:.1f} s after the first and then jump {jump:.0f} m: left"
                " out, the receiver repeated its last one"
            )
            kept.append(first)
        else:
            kept += run
    return kept


def _measured(log: RangeLog, tag: str, rows: Sequence[Range]) -> list[Range]:
    """Remove ranges that a radio or driver repeated."""
    rows = sorted(rows)
    runs = _runs(rows, itemgetter(1))
    steps = np.abs(np.diff([run[0][1] for run in runs]))
    # Coarse ranges, such as whole meters, stay equal for a while and then change by one unit of
    # resolution. They are measurements. After a repeated range, the next one differs by many units.
    # 3.0: largest median step between different ranges, in units of the smallest step, of a radio
    # with coarse resolution.
    if len(steps) < 3 or np.median(steps) <= 3.0 * steps.min():
        return rows
    usual = float(np.median(list(map(len, runs))))
    # 4.0: smallest number of equal values of a frozen stretch, in units of the usual number of
    # equal values.
    least = max(FROZEN_COUNT, 4.0 * usual)
    kept = [run[:1] if len(run) >= least and _duration(run) > FROZEN_FOR else run for run in runs]
    frozen = [run for run, part in zip(runs, kept, strict=True) if part is not run]
    if frozen:
        longest = max(frozen, key=_duration)
        begin = longest[0][0] - rows[0][0]
        log.note(
            f"{tag}: {sum(map(len, frozen))} ranges in {len(frozen)} stretches of equal values, the"
            f" longest of {longest[0][1]:.2f} m from {begin:.1f} to"
            f" {begin + _duration(longest):.1f} s after the first range. They are left out: the"
            " radio was silent, or its driver repeated the last value"
        )
    count = sum(map(len, kept))
    # 0.5: share of repeated values above which the ranges are sent more often than measured.
    if count - len(kept) > 0.5 * count:
        log.note(f"{tag}: each range is sent {usual:.0f} times; the first one is used")
        kept = [run[:1] for run in runs]
    return list(chain.from_iterable(kept))


def _runs(rows: Sequence[Row], value: Callable[[Row], object]) -> list[list[Row]]:
    """Return the stretches of rows with equal values."""
    return [list(run) for _, run in groupby(rows, key=value)]


def _duration(run: Sequence[Row]) -> float:
    """Return the duration of a stretch, s."""
    return run[-1][0] - run[0][0]
