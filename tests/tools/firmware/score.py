"""Figures of a flight from the simulator's true track, and of its commands from the frames on the
link."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from math import degrees, pi
from typing import Any

import numpy as np

from tests.tools.firmware.bench import Truth
from tests.tools.firmware.flight import Flight
from tests.tools.firmware.wire import Setpoint

KEPT = 0.10
SETTLED = 0.05
"""Bounds of the radius error, as shares of the radius. A circle is kept if the RMS error is below
KEPT. It has settled when the error stays below SETTLED."""
AT_LIMIT = 0.99
GOING_ROUND = 0.3


@dataclass(frozen=True)
class Score:
    """Figures of the last two laps unless stated otherwise: m, s; turn rates in deg/s, shares from
    0 to 1.

    rms, mean, sd: of the radius error. settled: time from the engagement until settled; None: never
    settled. closest: smallest range of the flight. led_away: largest range minus the range at the
    start. total_variation: total variation of the turn command, deg/s per second.
    """

    flown: float
    kept: bool
    direction: str
    laps: float
    rms: float
    mean: float
    sd: float
    p95: float
    settled: float | None
    range_start: float
    closest: float
    led_away: float
    roll: tuple[float, float]
    ground_speed: tuple[float, ...]
    airspeed: tuple[float, ...]
    height: tuple[float, float]
    turn_sd: float | None
    turn_at_limit: float | None
    total_variation: float | None
    course_rate_sd: float
    setpoints: int
    setpoint_gap: float | None
    not_finite: int

    def plain(self) -> dict[str, Any]:
        """Return the rounded figures for JSON."""
        return {key: _rounded(value) for key, value in asdict(self).items()}


def score(
    flight: Flight,
    track: Sequence[Truth],
    setpoints: Sequence[Setpoint],
    target: Callable[[float], tuple[float, float]],
    *,
    engaged: float,
    ended: float,
    turn_limit: float,
    home: float,
) -> Score:
    """Return the figures of a flight. engaged, ended: simulated times between which circnav
    steered, s. turn_limit: rad/s."""
    flown = [one for one in track if engaged <= one.time <= ended]
    time = np.array([one.time for one in flown]) - engaged
    places = np.array([target(one.time) for one in flown])
    north = np.array([one.north for one in flown]) - places[:, 0]
    east = np.array([one.east for one in flown]) - places[:, 1]
    away = np.hypot(north, east)
    error = away - flight.radius
    window = time > time[-1] - flight.window
    laps = float(np.ptp(phase := np.unwrap(np.arctan2(east, north))[window])) / (2 * pi)
    clockwise = phase[-1] > phase[0]
    rms = float(np.sqrt(np.mean(error[window] ** 2)))
    speeds = np.array([(one.v_north, one.v_east) for one in flown])[window]
    course = np.unwrap(np.arctan2(speeds[:, 1], speeds[:, 0]))
    course_rate = np.degrees(np.diff(course) / np.maximum(np.diff(time[window]), 1e-3))
    roll = np.degrees([one.roll for one in flown])[window]
    altitude = np.array([one.altitude for one in flown])[window] - home
    air = np.array([one.airspeed for one in flown])[window]
    sent = [one for one in setpoints if engaged <= one.time <= ended]
    late = [one for one in sent if one.turn is not None and one.time > ended - flight.window]
    turns = np.degrees([one.turn or 0.0 for one in late])
    gaps = np.diff([one.time for one in sent])
    commanded = len(late) > 2
    return Score(
        flown=float(time[-1]),
        kept=bool(
            rms < KEPT * flight.radius
            and laps > GOING_ROUND
            and time[-1] > flight.window
            and np.abs(error[window]).max() < 2 * KEPT * flight.radius
        ),
        direction=("clockwise" if clockwise else "counterclockwise")
        if laps > GOING_ROUND
        else "none",
        laps=laps,
        rms=rms,
        mean=float(error[window].mean()),
        sd=float(error[window].std()),
        p95=float(np.percentile(np.abs(error[window]), 95)),
        settled=_settled(time, np.abs(error) > SETTLED * flight.radius),
        range_start=float(away[0]),
        closest=float(away.min()),
        led_away=float(away.max() - away[0]),
        roll=(float(roll.min()), float(roll.max())),
        ground_speed=_spread(np.hypot(speeds[:, 0], speeds[:, 1])),
        airspeed=_spread(air),
        height=(float(altitude.min()), float(altitude.max())),
        turn_sd=float(turns.std()) if commanded else None,
        turn_at_limit=float(np.mean(np.abs(turns) > AT_LIMIT * degrees(turn_limit)))
        if commanded
        else None,
        total_variation=float(np.abs(np.diff(turns)).sum() / (late[-1].time - late[0].time))
        if commanded
        else None,
        course_rate_sd=float(course_rate.std()),
        setpoints=len(sent),
        setpoint_gap=float(gaps.max()) if len(gaps) else None,
        not_finite=sum(not one.finite for one in sent),
    )


def _settled(time: np.ndarray, outside: np.ndarray) -> float | None:
    """Return the time of the last error outside the band, s. None: this time is in the last third
    of the flight, so the circle has not settled."""
    last = float(time[outside][-1]) if outside.any() else 0.0
    return last if last < time[-1] * 2 / 3 else None


def _spread(values: np.ndarray) -> tuple[float, ...]:
    """Return minimum, mean and maximum of the finite values."""
    known = values[np.isfinite(values)]
    return (float(known.min()), float(known.mean()), float(known.max())) if len(known) else ()


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 3)
    return [round(one, 2) for one in value] if isinstance(value, tuple) else value
