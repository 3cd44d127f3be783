"""Which of a run's samples become lines and dots: a line claims that what lies between two samples is known."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from circnav_mav.runlog.ticks import Column, Ticks, Truth

GAP = 5.0
"""Usual steps between two samples beyond which nothing is known of what lies between."""


def broken(time: Column, *columns: Column) -> tuple[Column, ...]:
    """Time and columns over it, with NaN put into the columns where the samples pause, so that lines break there."""
    steps = np.diff(time)
    rising = steps[steps > 0]
    pauses = np.flatnonzero(steps > GAP * np.median(rising)) + 1 if len(rising) else np.array([], int)
    if not len(pauses):
        return time, *columns
    middles = (time[pauses - 1] + time[pauses]) / 2
    return np.insert(time, pauses, middles), *(np.insert(column, pauses, np.nan) for column in columns)


def fresh(ticks: Ticks) -> NDArray[np.bool_]:
    """The ticks that answered a new range, also one that was refused for its innovation; the others repeat the last."""
    nis = ticks.numbers["nis"]
    # A rejected range leaves the count of accepted ones as it is; its innovation is what changes.
    judged = np.isfinite(nis) & (np.diff(nis, prepend=np.nan) != 0)
    answered: NDArray[np.bool_] = judged | (np.diff(ticks.numbers["accepted"], prepend=0.0) > 0)
    return answered


class Track(NamedTuple):
    """Where a vehicle flew: m east and north of the target, NaN where nobody knows. true: by the simulator, else as
    estimated."""

    time: Column
    east: Column
    north: Column
    true: bool

    @property
    def known(self) -> NDArray[np.intp]:
        """The points that are known."""
        return np.flatnonzero(np.isfinite(self.east) & np.isfinite(self.north))


def known_track(ticks: Ticks, truth: Truth | None) -> Track | None:
    """The truth where there is one, else what was believed; None where there is neither: range alone does not tell."""
    true = truth is not None and len(truth.time) > 1
    if truth is not None and true:
        places = truth.time, truth.east - truth.target_east, truth.north - truth.target_north
    else:
        places = ticks.time, ticks.numbers["x"], ticks.numbers["y"]
    time, east, north = broken(*places)
    track = Track(time, east, north, true)
    return track if len(track.known) > 1 else None
