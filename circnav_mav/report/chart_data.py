"""Data of the charts of a run as JSON values: columns of samples, texts over time, alarms and the
track. The charts themselves are defined in report/charts.js, shared with the live page."""

import json
from itertools import pairwise
from math import isfinite, nan
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from circnav_mav.guidance.types import Orbit
from circnav_mav.runlog.events import ALARM, OURS, Event
from circnav_mav.runlog.metrics import TOLERANCE
from circnav_mav.runlog.ticks import Column, Ticks, Truth


def broken(time: Column, *columns: Column) -> tuple[Column, ...]:
    """Return time and columns with NaN inserted in gaps of the samples, so that lines are
    interrupted there."""
    steps = np.diff(time)
    rising = steps[steps > 0]
    # 5.0: smallest gap between two samples at which a line is interrupted, as a multiple of the
    # median step.
    pauses = (
        np.flatnonzero(steps > 5.0 * np.median(rising)) + 1 if len(rising) else np.array([], int)
    )
    if not len(pauses):
        return time, *columns
    middles = (time[pauses - 1] + time[pauses]) / 2
    return np.insert(time, pauses, middles), *(
        np.insert(column, pauses, np.nan) for column in columns
    )


def fresh(ticks: Ticks) -> NDArray[np.bool_]:
    """Return a mask of the ticks with a new range, even if the range was rejected by its
    innovation. Other ticks repeat the last range."""
    nis = ticks.numbers["nis"]
    # A rejected range does not change the count of accepted ones, but it changes the innovation.
    judged = np.isfinite(nis) & (np.diff(nis, prepend=np.nan) != 0)
    answered: NDArray[np.bool_] = judged | (np.diff(ticks.numbers["accepted"], prepend=0.0) > 0)
    return answered


class Track(NamedTuple):
    """Track of a vehicle. east, north: position relative to the target, m, NaN where unknown. true:
    True for the simulator's truth, False for the estimate."""

    time: Column
    east: Column
    north: Column
    true: bool

    @property
    def known(self) -> NDArray[np.intp]:
        """Indices of the points with a known position."""
        return np.flatnonzero(np.isfinite(self.east) & np.isfinite(self.north))


def known_track(ticks: Ticks, truth: Truth | None) -> Track | None:
    """Return the true track, else the estimated one. None if neither exists: ranges alone do not
    determine a track."""
    true = truth is not None and len(truth.time) > 1
    if truth is not None and true:
        places = truth.time, truth.east - truth.target_east, truth.north - truth.target_north
    else:
        places = ticks.time, ticks.numbers["x"], ticks.numbers["y"]
    time, east, north = broken(*places)
    track = Track(time, east, north, true)
    return track if len(track.known) > 1 else None


def steady_command(ticks: Ticks, orbit: Orbit) -> Column | None:
    """Return the turn-rate command at which the vehicle turns at the rate of the desired circle,
    rad/s: that rate divided by the turn gain. None if the turn gain at the end of the flight is
    about 1, so that command and turn rate are equal."""
    gain = ticks.numbers["turn_gain"]
    # Smallest deviation of the turn gain from 1 for which the command is drawn beside the turn
    # rate. Chosen: a smaller difference is not visible in the chart.
    if not np.any(np.abs(gain[-1:] - 1) > 0.02):
        return None
    return np.asarray(ticks.steady_turn(orbit) / gain)


STRETCHES = 1500
"""Number of stretches into which a long line is divided. Each stretch is drawn by its smallest and
its largest value."""


def chart_data(
    ticks: Ticks, truth: Truth | None, orbit: Orbit, names: dict[str, str], **flight: Any
) -> dict[str, Any]:
    """Return all data of the charts. names: displayed names of phases. flight: further values and
    words that charts.js uses."""
    span = (float(ticks.time[0]), float(ticks.time[-1]))
    phases = [names.get(phase, phase) for phase in ticks.words["phase"]]
    words = {"phase": phases, "vehicle mode": ticks.words["mode"], "law": ticks.words["law"]}
    track = known_track(ticks, truth)
    return {
        "flight": flight
        | {
            "radius": orbit.radius,
            "tolerance": TOLERANCE * orbit.radius,
            "limit": orbit.max_turn_rate,
            "steady": orbit.steady_turn_rate,
            "steadies": sorted({float(turn) for turn in ticks.steady_turn(orbit)}),
            "radii": ticks.radii(orbit.radius),
        },
        "span": span,
        "columns": {
            name: _plain(*column) for name, column in _columns(ticks, truth, orbit, span).items()
        },
        "bands": {
            name: stretches(ticks.time, spans) for name, spans in words.items() if set(spans) - {""}
        },
        "ways": [] if track is None else [_way(track)],
    }


def as_script(data: dict[str, Any]) -> str:
    """Return JSON that is safe inside a script element: it cannot end the element."""
    return json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def alarms(happened: list[Event]) -> list[tuple[float, str]]:
    """Return (time, text) of severe events, without the STATUSTEXT that circnav sent for a listed
    alarm."""
    severe = [event for event in happened if event.severe]
    begun = np.array([event.time for event in severe if event.kind == ALARM])
    # 2.5: longest time between an alarm and its STATUSTEXT, s. At most one text of a kind is sent
    # every 2 s.
    again = [
        event.kind == OURS and bool(np.any(np.abs(begun - event.time) < 2.5)) for event in severe
    ]
    return [
        (event.time, event.text)
        for event, is_repeat in zip(severe, again, strict=True)
        if not is_repeat
    ]


def stretches(time: Column, words: list[str]) -> list[tuple[float, float, str]]:
    """Return runs of equal words as (from, to, word), times in s."""
    begins = [at for at, word in enumerate(words) if at == 0 or word != words[at - 1]]
    return [
        (float(time[begin]), float(time[end]), words[begin])
        for begin, end in pairwise([*begins, len(words) - 1])
    ]


def _columns(
    ticks: Ticks, truth: Truth | None, orbit: Orbit, span: tuple[float, float]
) -> dict[str, tuple[Column, Column]]:
    """Return time and values of each drawn column, by name."""
    numbers = ticks.numbers
    time = ticks.time
    new = fresh(ticks)
    found = {
        name: _line(time, numbers[name])
        for name in ("r", "r_dot", "turn_rate", "heading", "drift_x", "drift_y")
    }
    desired = ticks.desired(nan)
    changed = desired != np.append(nan, desired[:-1])
    found["desired"] = time[changed], desired[changed]
    if (command := steady_command(ticks, orbit)) is not None:
        found["steady_command"] = _line(time, command)
    found["measured"] = _dots(time[new], numbers["measured"][new])
    found["innovation"] = _dots(time[new], np.sqrt(numbers["nis"][new]))
    found |= {name: _rate(time, numbers[name], span) for name in ("accepted", "rejected")}
    if truth is None:
        received = time[new]
        measured = numbers["measured"][new]
        # Compute the rate from the range 1 s earlier.
        before = np.searchsorted(received, received - 1.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            rate = (measured - measured[before]) / (received - received[before])
        return found | {"differenced": _line(received, np.where(np.isfinite(rate), rate, np.nan))}
    rising = np.diff(truth.sim_time, prepend=-np.inf) > 0
    if rising.sum() > 1:
        rate = np.gradient(truth.radius[rising], truth.sim_time[rising])
        found["true_r_dot"] = _line(truth.time[rising], rate)
    return found | {
        "true_r": _line(truth.time, truth.radius),
        "true_turn": _line(truth.time, -truth.turn_rate),
    }


def _rate(time: Column, counted: Column, span: tuple[float, float]) -> tuple[Column, Column]:
    """Return the growth of a count per second in equal bins of time. A final NaN ends the last
    bin."""
    # 240: maximum number of bars of a chart. Each bar covers at least 1 s.
    bins = int(min(240, max(1, span[1] - span[0])))
    grown = np.clip(np.nan_to_num(np.diff(counted, prepend=0.0)), 0, None)
    heights, edges = np.histogram(time, bins=bins, range=span, weights=grown)
    return edges, np.append(heights * bins / (span[1] - span[0]), np.nan)


def peaks(values: Column, stretches: int = STRETCHES) -> NDArray[np.intp]:
    """Return the indices of the samples to draw: the smallest and the largest value of each
    stretch, so that every peak is kept, and one NaN of each stretch with a gap."""
    if len(values) <= 2 * stretches:
        return np.arange(len(values))
    keep: list[int] = []
    for begin, end in pairwise(np.linspace(0, len(values), stretches + 1).astype(int).tolist()):
        part = values[begin:end]
        known = np.flatnonzero(np.isfinite(part))
        if len(known):
            keep += [
                begin + int(known[part[known].argmin()]),
                begin + int(known[part[known].argmax()]),
            ]
        if len(known) < len(part):
            keep.append(begin + int(np.flatnonzero(~np.isfinite(part))[-1]))
    return np.unique(keep)


def _line(time: Column, values: Column) -> tuple[Column, Column]:
    """Return a line reduced to few points, interrupted in gaps."""
    time, values = broken(time, values)
    keep = peaks(values)
    return time[keep], values[keep]


def _dots(time: Column, values: Column) -> tuple[Column, Column]:
    """Return the samples of `peaks` and every n-th sample, so that the density of dots is
    preserved."""
    # 4000: maximum number of evenly spaced dots that are drawn in addition to the smallest and
    # largest value of each stretch.
    keep = np.union1d(peaks(values), np.arange(0, len(values), max(1, -(-len(values) // 4000))))
    return time[keep], values[keep]


def _plain(time: Column, values: Column) -> tuple[list[float], list[float | None]]:
    plain = [float(f"{value:.5g}") if isfinite(value) else None for value in values.tolist()]
    return [round(t, 3) for t in time.tolist()], plain


def _way(track: Track) -> dict[str, Any]:
    name, colour = ("true", "true") if track.true else ("estimated", "estimate")
    points = len(track.time)
    keep = np.unique(np.linspace(0, points - 1, min(points, 2 * STRETCHES)).astype(int))
    keep = np.union1d(
        keep, np.flatnonzero(~np.isfinite(track.east))
    )  # keep the points without a position, which interrupt the track
    times, easts = _plain(track.time[keep], track.east[keep])
    _, norths = _plain(track.time[keep], track.north[keep])
    return {"name": name, "colour": colour, "times": times, "east": easts, "north": norths}
