"""Finds values that are no measurements: positions before the fix, last values that a receiver or radio repeats."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from circnav_mav.extras.locate.place import Plane
from circnav_mav.extras.locate.range_log import Position, Range, RangeLog

NEAR_ZERO = 0.01
"""Latitude and longitude, degrees, within which both are those of a receiver without a fix: 1.1 km of open sea."""
FROZEN_FOR, FROZEN_COUNT = 3.0, 6
"""Time, s, and number of equal values from which they are a stretch that stands still."""
FROZEN_OVER = 4.0
"""Such a stretch is this much longer than the usual run of equal values."""
COARSE = 3.0
"""Usual step between different ranges, in units of the smallest one, up to which equal values are coarse resolution."""
RESENT = 0.5
"""Share of equal neighbors from which values are sent more often than they are measured."""
JUMP = 5.0
"""Way, m, that a position makes at once after it stood still, from which it had stood still wrongly."""


def screen(log: RangeLog) -> None:
    """Leave out values that are no measurements, and note them."""
    kept = [row for row in log.positions if max(abs(row[1]), abs(row[2])) > NEAR_ZERO]
    if len(kept) < len(log.positions):
        log.note(f"{len(log.positions) - len(kept)} positions near 0 N 0 E, before a fix, are left out")
    log.positions = _moving(log, kept)
    log.ranges = {tag: _measured(log, tag, rows) for tag, rows in log.ranges.items()}


def _moving(log: RangeLog, positions: Sequence[Position]) -> list[Position]:
    """Leave out positions that a receiver repeated while the vehicle flew on."""
    if len(positions) < 2:
        return list(positions)
    plane, kept = Plane(*positions[0][1:3]), list[Position]()
    rows = sorted(positions)
    runs = [list(run) for _, run in groupby(rows, key=lambda row: row[1:3])]
    for run, after in zip(runs, [*runs[1:], None], strict=True):
        first, last = run[0], run[-1]
        jump = 0.0
        if after is not None and last[0] - first[0] > FROZEN_FOR:
            here, there = (np.array(plane.to_metres(*row[1:3])) for row in (last, after[0]))
            jump = float(np.hypot(*(there - here)))
        if jump > JUMP:
            log.note(
                f"positions stand still from {first[0] - rows[0][0]:.1f} to {last[0] - rows[0][0]:.1f} s after the "
                f"first and then jump {jump:.0f} m: they are left out, the receiver repeated its last one"
            )
            kept.append(first)
        else:
            kept += run
    return kept


def _measured(log: RangeLog, tag: str, rows: Sequence[Range]) -> list[Range]:
    """Leave out ranges that a radio or driver repeated."""
    rows = sorted(rows)
    runs = [list(run) for _, run in groupby(rows, key=lambda row: row[1])]
    steps = np.abs(np.diff([run[0][1] for run in runs]))
    # Coarse ranges, such as whole meters, stay equal for a while and then change by one unit of resolution. They are
    # measurements. A repeated range is followed by one that has changed by many units.
    if len(steps) < 3 or np.median(steps) <= COARSE * steps.min():
        return rows
    usual = float(np.median([len(run) for run in runs]))
    kept, frozen = list[list[Range]](), list[list[Range]]()
    for run in runs:
        long = run[-1][0] - run[0][0] > FROZEN_FOR and len(run) >= max(FROZEN_COUNT, FROZEN_OVER * usual)
        frozen += [run] if long else []
        kept.append(run[:1] if long else run)
    if frozen:
        longest = max(frozen, key=lambda run: run[-1][0] - run[0][0])
        zero, begin, end = rows[0][0], longest[0][0], longest[-1][0]
        log.note(
            f"{tag}: {sum(map(len, frozen))} ranges stand still, {len(frozen)} times; the longest at "
            f"{longest[0][1]:.2f} m from {begin - zero:.1f} to {end - zero:.1f} s after the first range. They are left "
            "out: the radio was silent there, or its driver repeats the last value"
        )
    equal = sum(len(run) - 1 for run in kept)
    if equal > RESENT * sum(map(len, kept)):
        log.note(f"{tag}: each range is sent {usual:.0f} times; its first counts")
        kept = [run[:1] for run in kept]
    return [row for run in kept for row in run]
