"""How quiet the turn command was. The radius hides an oscillating guidance loop; the command shows it.

One definition for the verdict, campaigns and the benchmark; each takes the window by which it judges the radius.
"""

from dataclasses import dataclass
from math import degrees, pi
from typing import Any

import numpy as np

from circnav_mav.guidance.step import AT_LIMIT
from circnav_mav.guidance.types import Orbit
from circnav_mav.runlog.metrics import Column, last_part

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
    return swing >= BANGS * limit or (swing >= LEAST_SWING * limit and _repeats(fast, width) >= REPEATS)


def _without_mean(values: Column, width: int) -> Column:
    """Less their moving mean, where a whole window is known."""
    means = np.convolve(values, np.ones(width) / width, "valid")
    first = (width - 1) // 2
    return values[first : first + len(means)] - means


def _repeats(values: Column, most: int) -> float:
    """The highest autocorrelation at lags up to `most` samples, past the first lag at which it is negative."""
    n = len(values)
    correlation = np.fft.irfft(np.abs(np.fft.rfft(values, 2 * n)) ** 2)[:most] / (n - np.arange(most))
    negative = np.flatnonzero(correlation < 0)
    return float(correlation[negative[0] :].max() / correlation[0]) if len(negative) else 0.0
