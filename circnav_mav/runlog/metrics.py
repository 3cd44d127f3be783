"""Figures of a flown circle: settling, radius error, sense of rotation, and smoothness of the turn
command. SI units, arrays over samples. The verdict, campaigns and the benchmark share these
definitions."""

from dataclasses import dataclass
from math import degrees, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.step import AT_LIMIT
from circnav_mav.guidance.types import Direction, Orbit

Column = NDArray[np.float64]

TOLERANCE = 0.05
"""Half width of the band round the desired radius, as a fraction of the desired radius. A radius in
the band is settled."""
MOSTLY = 0.95
"""Least share of the rest of the flight in the band, from the settling time on."""
LAST = 1 / 3
"""Final fraction of the flight, over which radius error, sense of rotation and turn command are
judged."""


def settled(time: Column, radius: Column, desired: float) -> float | None:
    """Return the settling time, s: from the first sample to the first one in the band from which
    the radius is in the band for 95 % of the rest of the flight. The band is `desired` ± TOLERANCE
    * `desired`. None if this time is in the final part of the flight."""
    inside = np.abs(radius - desired) <= TOLERANCE * desired
    # A flight that leaves the band on every lap also returns to it, but it has not settled. A
    # single estimate outside the band does not begin the settling again.
    share = np.cumsum(inside[::-1])[::-1] / np.arange(len(inside), 0, -1)
    early = time <= time[-1] - LAST * (time[-1] - time[0]) if len(time) else inside
    found = np.flatnonzero(inside & (share >= MOSTLY) & early)
    return float(time[found[0]] - time[0]) if len(found) else None


def last_part(time: Column, values: Column) -> Column:
    """Return the values of the final part of the flight (fraction LAST)."""
    return values[time >= time[-1] - LAST * (time[-1] - time[0])] if len(time) else values


def mean(values: Column) -> float | None:
    """Return the mean, or None for an empty array."""
    return float(np.mean(values)) if len(values) else None


def rms_error(values: Column, desired: float) -> float | None:
    """Return the root mean square of (values - desired), or None for an empty array."""
    return float(np.sqrt(np.mean((values - desired) ** 2))) if len(values) else None


def swept_angle(north: Column, east: Column) -> float:
    """Return the angle that a track sweeps around the origin, rad, counter-clockwise positive seen
    from above."""
    angles = np.unwrap(np.arctan2(north, east))
    return float(angles[-1] - angles[0]) if len(angles) else 0.0


def direction_of(swept: float) -> Direction | None:
    """Return the sense of rotation of a swept angle, rad. None below a quarter turn."""
    if abs(swept) < np.pi / 2:
        return None
    return Direction.COUNTERCLOCKWISE if swept > 0 else Direction.CLOCKWISE


SLOW = 0.25
"""Window of the moving mean of the turn command, as a fraction of a lap. Wind and a moving target
require turn rates that vary once or twice a lap. Subtracting the mean removes most of this
variation, and keeps oscillations with periods up to about 10 s."""


@dataclass(frozen=True, slots=True)
class TurnFigures:
    """Figures of the turn command.

    turn_std_deg_s: standard deviation of the command, deg/s.
    turn_at_limit: fraction of samples at the vehicle's turn-rate limit.
    turn_variation_rad_s2: sum of all absolute changes of the command, divided by the time, rad/s^2.
    turn_limit_cycle: True if the command shows a limit cycle (see `cycles`).
    """

    turn_std_deg_s: float
    turn_at_limit: float
    turn_variation_rad_s2: float
    turn_limit_cycle: bool


NAMES = tuple(TurnFigures.__dataclass_fields__)
"""Keys in summary.json, and columns of a campaign and of the benchmark."""


def turn_figures(
    time: Column, command: Column, orbit: Orbit, at_limit: Any = None
) -> TurnFigures | None:
    """Return the figures of commanded turn rates (rad/s, NaN where none) at times (s). None without
    a command.

    at_limit: nonzero where the limit cut the command. Default: nonzero where the command is at the
        limit. A vehicle that turns faster than commanded needs the argument, because its commands
        stay below the limit.
    """
    known = np.isfinite(command)
    if not known.any():
        return None
    limit = orbit.max_turn_rate
    cut = np.abs(command) >= AT_LIMIT * limit if at_limit is None else np.asarray(at_limit) > 0
    time = time[known]
    command = np.asarray(command[known], float)
    cut = cut[known]
    span = float(time[-1] - time[0])
    return TurnFigures(
        turn_std_deg_s=degrees(np.std(command)),
        turn_at_limit=float(np.mean(cut)),
        turn_variation_rad_s2=float(np.abs(np.diff(command)).sum() / span) if span > 0 else 0.0,
        turn_limit_cycle=cycles(
            time, command, limit=limit, lap=2 * pi * orbit.radius / orbit.speed
        ),
    )


def late_figures(time: Column, command: Column, cut: Any, orbit: Orbit) -> TurnFigures | None:
    """Return `turn_figures` of the final part of a flight (fraction LAST)."""
    late = slice(len(time) - len(last_part(time, time)), None)
    return turn_figures(time[late], command[late], orbit, at_limit=cut[late])


def cycles(time: Column, command: Column, *, limit: float, lap: float) -> bool:
    """True if the turn command (rad/s) shows a limit cycle. The fast part of the command, without
    the moving mean over a quarter of a lap, is then large and periodic, or alternates between the
    limits. False for samples of less than half a lap, which are too short to judge.

    limit: turn-rate limit, rad/s.
    lap: duration of a lap, s.
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
    # Both branches judge the fast part: the turn command minus its moving mean.
    # 0.1: least RMS of a limit cycle, as a fraction of the turn-rate limit.
    # 0.35: least autocorrelation at one period of a periodic fast part. Benchmark plant: noise and
    # gusts reach 0.2, a loop with 0.25 s dead time 0.7 to 0.9, a loop with 0.5 s in wind 0.5.
    # 0.6: least RMS, as a fraction of the limit, of a command that alternates between both limits
    # (sine 0.71, square wave 1). Gusts make such a loop irregular (autocorrelation 0.1 to 0.3), but
    # its RMS stays at 0.67. A stable loop in gusts has 0.44.
    return swing >= 0.6 * limit or (
        swing >= 0.1 * limit and _autocorrelation_peak(fast, width) >= 0.35
    )


def _without_mean(values: Column, width: int) -> Column:
    """Return the values minus their moving mean, where the window is complete."""
    means = np.convolve(values, np.ones(width) / width, "valid")
    first = (width - 1) // 2
    return values[first : first + len(means)] - means


def _autocorrelation_peak(values: Column, most: int) -> float:
    """Return the highest autocorrelation after its first negative lag, at lags below `most`
    samples."""
    n = len(values)
    correlation = np.fft.irfft(np.abs(np.fft.rfft(values, 2 * n)) ** 2)[:most] / (
        n - np.arange(most)
    )
    negative = np.flatnonzero(correlation < 0)
    return float(correlation[negative[0] :].max() / correlation[0]) if len(negative) else 0.0
