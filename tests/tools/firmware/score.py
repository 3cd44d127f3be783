"""Figures of a flight from the simulator's true track, and of its commands from the frames on the
link."""

from collections.abc import Callable, Sequence
from dataclasses import astuple, fields
from math import degrees, inf, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.tools.firmware.bench import Truth
from tests.tools.firmware.flight import Flight
from tests.tools.firmware.wire import Setpoint

KEPT = 0.10
SETTLED = 0.05
"""Bounds of the radius error, as shares of the radius. A circle is kept if the RMS error is below
KEPT. It has settled when the error stays below SETTLED."""
AT_LIMIT = 0.99
GOING_ROUND = 0.3

Array = NDArray[np.float64]
Target = Callable[[float], tuple[float, float]]
"""Callback(time): position of the target, north and east, m."""


def columns(track: Sequence[Truth], since: float, until: float = inf) -> dict[str, Array]:
    """Return the truth between two times as an array per field."""
    rows = np.array([astuple(one) for one in track if since <= one.time <= until])
    return dict(zip((one.name for one in fields(Truth)), rows.T, strict=bool(len(rows))))


def from_target(way: dict[str, Array], target: Target) -> Array:
    """Return the positions relative to the target, m: a row for north, a row for east."""
    places = np.array([target(time) for time in way["time"]])
    return np.array([way["north"], way["east"]]) - places.T


def score(
    flight: Flight,
    track: Sequence[Truth],
    setpoints: Sequence[Setpoint],
    target: Target,
    *,
    engaged: float,
    ended: float,
    turn_limit: float,
    home: float,
) -> dict[str, Any]:
    """Return the figures of the last two laps unless stated otherwise: m, s; turn rates in deg/s,
    shares from 0 to 1.

    rms, mean, sd: of the radius error. settled: time from the engagement until settled; None: never
    settled. closest: smallest range of the flight. led_away: largest range minus the range at the
    start. total_variation: total variation of the turn command, deg/s per second.

    engaged, ended: simulated times between which circnav steered, s. turn_limit: rad/s.
    """
    way = columns(track, engaged, ended)
    time = way["time"] - engaged
    north, east = from_target(way, target)
    away = np.hypot(north, east)
    late = time > time[-1] - flight.window
    error = away - flight.radius
    last = error[late]
    phase = np.unwrap(np.arctan2(east, north))
    laps = float(np.ptp(phase[late])) / (2 * pi)
    clockwise = "clockwise" if phase[-1] > phase[0] else "counterclockwise"
    rms = np.sqrt(np.mean(last**2))
    near = rms < KEPT * flight.radius and np.abs(last).max() < 2 * KEPT * flight.radius
    going_round = laps > GOING_ROUND
    course = np.unwrap(np.arctan2(way["v_east"], way["v_north"])[late])
    figures = {
        "flown": time[-1],
        "kept": bool(near and going_round and time[-1] > flight.window),
        "direction": clockwise if going_round else "none",
        "laps": laps,
        "rms": rms,
        "mean": last.mean(),
        "sd": last.std(),
        "p95": np.percentile(np.abs(last), 95),
        "settled": _settled(time, np.abs(error) > SETTLED * flight.radius),
        "range_start": away[0],
        "closest": away.min(),
        "led_away": away.max() - away[0],
        "roll": _spread(np.degrees(way["roll"][late]))[::2],
        "ground_speed": _spread(np.hypot(way["v_north"], way["v_east"])[late]),
        "airspeed": _spread(way["airspeed"][late]),
        "height": _spread(way["altitude"][late] - home)[::2],
        "course_rate_sd": np.std(
            np.degrees(np.diff(course)) / np.maximum(np.diff(time[late]), 1e-3)
        ),
    }
    sent = [one for one in setpoints if engaged <= one.time <= ended]
    figures |= commanded(sent, ended - flight.window, turn_limit)
    return {name: _rounded(value) for name, value in figures.items()}


def commanded(sent: Sequence[Setpoint], since: float, turn_limit: float) -> dict[str, Any]:
    """Return the figures of the setpoints, and of the turn command since a time; None: fewer than
    three commands."""
    gaps = np.diff([one.time for one in sent])
    figures: dict[str, Any] = {
        "turn_sd": None,
        "turn_at_limit": None,
        "total_variation": None,
        "setpoints": len(sent),
        "setpoint_gap": gaps.max() if len(gaps) else None,
        "not_finite": sum(not one.finite for one in sent),
    }
    late = [one for one in sent if one.turn is not None and one.time > since]
    if len(late) < 3:
        return figures
    commands = np.array([(one.time, one.turn) for one in late])
    turns = np.degrees(commands[:, 1])
    return figures | {
        "turn_sd": turns.std(),
        "turn_at_limit": np.mean(np.abs(turns) > AT_LIMIT * degrees(turn_limit)),
        "total_variation": np.abs(np.diff(turns)).sum() / np.ptp(commands[:, 0]),
    }


def _settled(time: Array, outside: NDArray[np.bool_]) -> float | None:
    """Return the time of the last error outside the band, s. None: this time is in the last third
    of the flight, so the circle has not settled."""
    last = float(time[outside][-1]) if outside.any() else 0.0
    return last if last < time[-1] * 2 / 3 else None


def _spread(values: Array) -> tuple[float, ...]:
    """Return minimum, mean and maximum of the finite values."""
    known = values[np.isfinite(values)]
    return (known.min(), known.mean(), known.max()) if len(known) else ()


def _rounded(value: Any) -> Any:
    """Return a value for JSON."""
    if isinstance(value, tuple):
        return [round(float(one), 2) for one in value]
    return round(float(value), 3) if isinstance(value, float) else value
