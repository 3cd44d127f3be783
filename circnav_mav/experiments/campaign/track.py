"""What a flight of a campaign leaves behind, whichever engine flew it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Track:
    """The true path while the vehicle was ours, relative to the target, and how it ended.

    start: east, north (m) of the target and heading (rad, clockwise from north) at time zero. engaged: s since then,
    None if it never was. time: s since the engagement. outcome: "completed", or why not. turn_time, turn, turn_cut: of
    every command its time (s since the engagement), turn rate (rad/s), and whether the limit cut it.
    """

    engine: str
    start: tuple[float, float, float]
    engaged: float | None
    time: Column
    east: Column
    north: Column
    outcome: str
    turn_time: Column
    turn: Column
    turn_cut: NDArray[np.bool_]
