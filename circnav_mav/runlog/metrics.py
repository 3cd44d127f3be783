"""How good a circle was: settling, radius error, sense of rotation, and how quiet the turn command was. SI units,
arrays over samples. One definition for the verdict, campaigns and the benchmark."""

from dataclasses import dataclass
from math import degrees, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.step import AT_LIMIT
from circnav_mav.guidance.types import Direction, Orbit

Column = NDArray[np.float64]

TOLERANCE = 0.05
"""Settled means within this fraction of the radius."""
LAST = 1 / 3
"""Fraction of the flight, at its end, over which the circle is judged."""


def settling_time(time: Column, radius: Column, desired: float, tolerance: float = TOLERANCE) -> float | None:
    """Seconds from the first sample to the last entry into the band, None if the flight ends outside it."""
    outside = np.flatnonzero(~(np.abs(radius - desired) <= tolerance * desired))
    if not len(radius) or (len(outside) and outside[-1] == len(radius) - 1):
        return None
    first_inside = outside[-1] + 1 if len(outside) else 0
    return float(time[first_inside] - time[0])


def settled(time: Column, radius: Column, desired: float) -> float | None:
    """The settling time, s, of a flight that was within the band all through the part by which its circle is judged;
    else None: one that swings out of the band on every lap has an entry that happens to be the last, and is not
    settled by it."""
    first = settling_time(time, radius, desired)
    return None if first is None or first > (1 - LAST) * (time[-1] - time[0]) else first


def last_part(time: Column, values: Column) -> Column:
    """The values of the part of the time by which the circle is judged."""
    return values[time >= time[-1] - LAST * (time[-1] - time[0])] if len(time) else values


def mean(values: Column) -> float | None:
    """Mean, None of nothing."""
    return float(np.mean(values)) if len(values) else None


def rms_error(values: Column, desired: float) -> float | None:
    """Root mean square of (values - desired), None of nothing."""
    return float(np.sqrt(np.mean((values - desired) ** 2))) if len(values) else None


def swept_angle(north: Column, east: Column) -> float:
    """Angle swept round the origin by a track, rad, counter-clockwise positive seen from above."""
    angles = np.unwrap(np.arctan2(north, east))
    return float(angles[-1] - angles[0]) if len(angles) else 0.0


def direction_of(swept: float) -> Direction | None:
    """Sense of rotation of a swept angle, None below a quarter turn."""
    if abs(swept) < np.pi / 2:
        return None
    return Direction.COUNTERCLOCKWISE if swept > 0 else Direction.CLOCKWISE


SLOW = 0.25
"""Share of a lap. Wind and a moving target ask for turn rates that change once or twice a lap; a moving mean over this
long takes most of that out, and leaves oscillations of up to some 10 s."""
LEAST_SWING = 0.1
"""Share of the turn-rate limit: RMS of the fast part below which the command is quiet, whatever its shape."""
REPEATS = 0.35
"""Autocorrelation of the fast part one period later from which on it repeats itself. Benchmark plant: noise and gusts
reach .2, a loop with .25 s of dead time .7 .. .9, one with .5 s in wind .5."""
BANGS = 0.6
"""Share of the limit: RMS of the fast part that only a command between both limits has (a sine .71, a square wave 1).
Gusts break the rhythm of such a loop (autocorrelation .1 .. .3), not its size: .67; a sound loop has .44 in them."""


@dataclass(frozen=True, slots=True)
class TurnFigures:
    """turn_std_deg_s: standard deviation of the command, deg/s. turn_at_limit: share of its samples at the vehicle's
    limit. turn_variation_rad_s2: its total variation, rad/s per second. turn_limit_cycle: see `cycles`."""

    turn_std_deg_s: float
    turn_at_limit: float
    turn_variation_rad_s2: float
    turn_limit_cycle: bool


NAMES = tuple(TurnFigures.__dataclass_fields__)
"""The keys of summary.json and the columns of a campaign and of the benchmark."""


def turn_figures(time: Column, command: Column, orbit: Orbit, at_limit: Any = None) -> TurnFigures | None:
    """The figures of commanded turn rates (rad/s) at times (s); NaN: nothing was commanded. None without a command.

    at_limit: whether the limit cut each of them; by default those at the limit. A vehicle that turns at more than it is
    told is told less than its limit.
    """
    known = np.isfinite(command)
    if not known.any():
        return None
    limit = orbit.max_turn_rate
    cut = np.abs(command) >= AT_LIMIT * limit if at_limit is None else np.asarray(at_limit) > 0
    time, command, cut = time[known], np.asarray(command[known], float), cut[known]
    span = float(time[-1] - time[0])
    return TurnFigures(
        turn_std_deg_s=degrees(np.std(command)),
        turn_at_limit=float(np.mean(cut)),
        turn_variation_rad_s2=float(np.abs(np.diff(command)).sum() / span) if span > 0 else 0.0,
        turn_limit_cycle=cycles(time, command, limit=limit, lap=2 * pi * orbit.radius / orbit.speed),
    )


def late_figures(time: Column, command: Column, cut: Any, orbit: Orbit) -> TurnFigures | None:
    """The same over the last part of a flight, by which its radius is judged too."""
    late = slice(len(time) - len(last_part(time, time)), None)
    return turn_figures(time[late], command[late], orbit, at_limit=cut[late])


def cycles(time: Column, command: Column, *, limit: float, lap: float) -> bool:
    """Whether the command is in a limit cycle, as far as it alone can tell: its fast part (without the moving mean over
    a quarter of a lap) is large and repeats itself, or swings from limit to limit.

    limit: rad/s. lap: s. False for less than half a lap: too little to tell.
    """
    if time[-1] - time[0] < 2 * SLOW * lap:
        return False
    step = max(float(np.median(np.diff(time))), lap / 2000)
    even = np.interp(np.arange(time[0], time[-1], step), time, command)
    width = min(round(SLOW * lap / step), len(even) // 2)
    if width < 3:
        return False
    fast = _without_mean(even, width)
    swing = float(np.sqrt(np.mean(fast**2)))
    return swing >= BANGS * limit or (swing >= LEAST_SWING * limit and _autocorrelation_peak(fast, width) >= REPEATS)


def _without_mean(values: Column, width: int) -> Column:
    """Less their moving mean, where a whole window is known."""
    means = np.convolve(values, np.ones(width) / width, "valid")
    first = (width - 1) // 2
    return values[first : first + len(means)] - means


def _autocorrelation_peak(values: Column, most: int) -> float:
    """The highest autocorrelation at lags up to `most` samples, past the first lag at which it is negative."""
    n = len(values)
    correlation = np.fft.irfft(np.abs(np.fft.rfft(values, 2 * n)) ** 2)[:most] / (n - np.arange(most))
    negative = np.flatnonzero(correlation < 0)
    return float(correlation[negative[0] :].max() / correlation[0]) if len(negative) else 0.0
