"""Pictures of a campaign: start positions with the flights that kept their circle, distributions,
and the radius error against the varied values."""

import json
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from math import isfinite, prod
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from circnav_mav.extras.campaign.figures import figures, known
from circnav_mav.extras.campaign.plan import START
from circnav_mav.report.plots import PAGE, PAPER, literal, save
from circnav_mav.runlog.many_flights import median_interval, quantile

Rows = Sequence[dict[str, str]]
LOST = "#c8501e"
LINE = "#1f5fa8"
BINS = 12
"""Number of groups of flights along an axis. Chosen as a compromise: a smooth curve needs many
groups, and the median of a group needs many flights."""


def plot_campaign(
    folder: Path,
    rows: Rows,
    keys: Sequence[str],
    swept: Sequence[str],
    title: str,
    form: str = "png",
) -> tuple[list[Path], list[str]]:
    """Draw the pictures. Return their files, and a line for each picture that could not be drawn or
    written."""
    done: list[Path] = []
    problems: list[str] = []
    with mpl.rc_context(PAPER):
        for name, draw in _pictures(rows, keys, swept, literal(title)):
            path = folder / f"{name}.{form}"
            try:
                save(draw(), path, dpi=200)
                done.append(path)
            except Exception as error:  # a failed picture must not lose the results of the flights
                reason = (
                    getattr(error, "strerror", None)
                    or " ".join(str(error).split())
                    or type(error).__name__
                )
                problems.append(f"{path}: could not be drawn: {reason}")
    return done, problems


def _pictures(
    rows: Rows, keys: Sequence[str], swept: Sequence[str], title: str
) -> Iterator[tuple[str, Callable[[], Figure]]]:
    """Yield file names without suffix, and their drawing functions."""
    flown = [row for row in rows if row["rms_m"]]
    points = prod(len({row[key] for row in rows}) for key in swept)
    if (
        len(
            {
                row["start_range_m"] + row["start_bearing_deg"] + row["start_heading_deg"]
                for row in rows
            }
        )
        > 7
    ):
        yield (
            "starts",
            partial(_starts, [row for row in rows if row["start_range_m"]], title, points),
        )
    if len(flown) > 1:
        yield "distributions", partial(_distributions, rows, title, points)
        for key in keys:
            if key not in START and len({row[key] for row in rows}) > 1:
                yield (
                    f"error-{re.sub(r'[^A-Za-z0-9]+', '-', key)}",
                    partial(_against, rows, key, swept, title, points),
                )


def _worlds(rows: Rows, points: int) -> Any:
    """Return, for each flight, the index of its random draws. In one pass over the grid, all points
    have the same draws."""
    return np.array([int(row["run"]) // points for row in rows])


def _numbers(rows: Rows, key: str) -> Any:
    return np.array([float(row[key] or "nan") for row in rows])


def _starts(rows: Rows, title: str, points: int = 1) -> Figure:
    """Draw starting positions relative to the target and starting headings, colored by the share of
    flights that kept their circle."""
    figure = Figure(figsize=(PAGE, 3.5), layout="constrained")
    found = figures(rows, points)
    low, high = (100 * bound for bound in found["kept_interval"])
    figure.suptitle(
        f"{title}: starts of {len(rows)} flights, {100 * found['kept_share']:.0f} % kept (95 %"
        f" interval {low:.0f} to {high:.0f})"
    )
    place, turned = figure.subplots(1, 2)
    r, bearing, heading = (
        _numbers(rows, f"start_{name}") for name in ("range_m", "bearing_deg", "heading_deg")
    )
    kept = np.array([row["kept"] == "true" for row in rows], float)
    (away, towards), style = _shares(kept, r, np.radians(bearing))
    place.scatter(away * np.sin(towards), away * np.cos(towards), **style)
    place.plot(0, 0, "k+", ms=12, mew=2)
    place.set_aspect("equal", adjustable="datalim")
    place.set(xlabel="east of the target, m", ylabel="north of the target, m")
    (away, off), style = _shares(kept, r, np.round((heading - bearing) % 360 - 180, 3))
    drawn = turned.scatter(off, away, **style)
    off_line = "start heading off the line to the target, deg\n(0: towards, right positive)"
    turned.set(
        xlim=(-180, 180), xticks=range(-180, 181, 60), xlabel=off_line, ylabel="start range, m"
    )
    figure.colorbar(drawn, ax=turned, label="kept, %")
    return figure


def _shares(kept: Any, *coordinates: Any) -> tuple[Any, dict[str, Any]]:
    """Return the distinct points, and the style of their dots: size, and color by the share of
    flights that kept their circle (%)."""
    points, which = np.unique(np.stack(coordinates, axis=1), axis=0, return_inverse=True)
    share = 100 * np.bincount(which.ravel(), kept) / np.bincount(which.ravel())
    return points.T, {
        "c": share,
        "s": float(np.clip(8000 / len(share), 5, 40)),
        "cmap": "viridis",
        "vmin": 0,
        "vmax": 100,
        "edgecolors": "#555555",
        "linewidths": 0.3,
    }


def _distributions(rows: Rows, title: str, points: int = 1) -> Figure:
    """Draw the distributions of error, settling time and closest approach."""
    figure = Figure(figsize=(PAGE, 2.6), layout="constrained")
    found = figures(rows)
    rows = [row for row in rows if row["rms_m"]]
    worlds = len(np.unique(_worlds(rows, points)))
    others = (("not_engaged", "never engaged"), ("failed", "could not be flown"))
    unflown = "".join(f", {found[name]} more {what}" for name, what in others if found[name])
    figure.suptitle(f"{title}: {len(rows)} flights{unflown}")
    error, settling, nearest = figure.subplots(1, 3)
    rms = np.maximum(_numbers(rows, "rms_m"), 1e-6)
    settled = _numbers(rows, "settled_s")
    error.hist(
        rms, bins=np.geomspace(rms.min(), max(rms.max(), rms.min() * 1.1), 40).tolist(), color=LINE
    )
    error.set_xscale("log")
    _label_decades(error.xaxis, rms)
    _mark_median(error, _numbers(rows, "rms_m"), worlds, "m")
    never = int(np.isnan(settled).sum())
    if never < len(rows):
        settling.hist(settled[~np.isnan(settled)], bins=40, color=LINE)
        _mark_median(settling, np.where(np.isnan(settled), np.inf, settled), worlds, "s")
    settling.set_title(f"never: {never}", fontsize=9)
    nearest.hist(_numbers(rows, "closest_m"), bins=40, color=LINE)
    _mark_median(nearest, _numbers(rows, "closest_m"), worlds, "m")
    error.set_ylabel("flights")
    labels = (
        "RMS radius error of the last third, m",
        "time until within 5 % for good, s",
        "closest approach, m",
    )
    for axis, label in zip(figure.axes, labels, strict=True):
        axis.set_xlabel(label)
        axis.yaxis.set_major_locator(MaxNLocator(integer=True))
    return figure


def _mark_median(axes: Any, values: Any, worlds: int, unit: str) -> None:
    """Draw the median of the flights as a line, and its 95 % interval as a band."""
    middle = quantile(values, 0.5)
    if not isfinite(middle):
        return
    low, high = median_interval(np.sort(values), worlds)
    label = f"median {middle:.3g} {unit}"
    if low is not None and high is not None and isfinite(high):
        axes.axvspan(low, high, color=LOST, alpha=0.25, lw=0)
        label += f"\n95 %: {low:.3g} to {high:.3g}"
    axes.axvline(middle, color=LOST, lw=1, label=label)
    axes.legend(fontsize=7)


def _label_decades(axis: Any, values: Any) -> None:
    """Label a logarithmic axis so that labels do not overlap and a single decade has several."""
    ratio = values.max() / values.min()
    subs = (
        (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8)
        if ratio < 5
        else (1, 2, 3, 5)
        if ratio < 30
        else (1,)
    )
    axis.set_major_locator(LogLocator(subs=subs, numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _against(rows: Rows, key: str, swept: Sequence[str], title: str, points: int = 1) -> Figure:
    """Draw the error of the engaged flights, and the share of flights that kept their circle,
    against one value."""
    figure = Figure(figsize=(PAGE, 5.0), layout="constrained")
    figure.suptitle(f"{title}: error against {literal(key)}, {len(rows)} flights")
    error, share = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    by = _line_key(rows, key, swept)
    lines = np.array([row.get(by, "") for row in rows])
    labels = list(dict.fromkeys(lines))
    x, names, axis_label = _axis(rows, key, key in swept)
    for number, label in enumerate(labels):
        mine = np.flatnonzero(lines == label)
        spots, parts = _binned(x[mine], key in swept)
        if names:
            spots = spots + 0.06 * (number - (len(labels) - 1) / 2)
        found = [figures([rows[flight] for flight in mine[part]], points) for part in parts]
        style = {"color": f"C{number}" if len(labels) > 1 else LINE, "lw": 0 if names else 1.5}
        words = literal(label) or "median, 95 % interval"
        _draw_intervals(error, spots, found, "rms_median", "rms_interval", 1, label=words, **style)
        _draw_intervals(share, spots, found, "kept_share", "kept_interval", 100, **style)
    if names:
        share.set_xticks(range(len(names)), [literal(name) for name in names])
    error.set_yscale("log")
    _label_decades(error.yaxis, np.maximum(known(rows, "rms_m"), 1e-6))
    error.set_ylabel("RMS radius error, m\n(median, 95 % interval)")
    error.legend(title=literal(by) if len(labels) > 1 else None, fontsize=8)
    share.set(ylim=(-5, 105), ylabel="kept, %\n(95 % interval)", xlabel=axis_label)
    return figure


def _line_key(rows: Rows, key: str, swept: Sequence[str]) -> str:
    """Return the other swept key if there is exactly one, else an empty string. The picture has a
    line for each of its values."""
    # 8: largest number of values of a key for which a picture has a line for each value; chosen.
    others = [other for other in swept if other != key and len({row[other] for row in rows}) <= 8]
    return others[0] if len(others) == 1 else ""


def _axis(rows: Rows, key: str, exact: bool) -> tuple[Any, list[str], str]:
    """Return the position of each flight on the axis of a varied value, the names of the ticks if
    not all values are numbers, and the label."""
    values = [_json_or_text(row[key]) for row in rows]
    names: list[str] = []
    if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        names = list(dict.fromkeys(map(str, values)))
        values = [names.index(str(value)) for value in values]
    x = np.array(values, float)
    label = literal(key)
    drawn = len(np.unique(x))
    if not exact and drawn > BINS:
        label += f" ({drawn} drawn values, in {BINS} bins of equally many flights)"
    return x, names, label


def _draw_intervals(
    axes: Any, spots: Any, found: Any, name: str, interval: str, scale: float, **style: Any
) -> None:
    """Draw one of the figures of each bin, with its interval."""
    middle, low, high = scale * np.array([(one[name], *one[interval]) for one in found], float).T
    axes.errorbar(
        spots,
        middle,
        [middle - low, high - middle],
        capsize=2,
        elinewidth=0.7,
        marker="o",
        ms=4,
        **style,
    )


def _binned(x: Any, exact: bool) -> tuple[Any, list[Any]]:
    """Return positions on the axis and the flights at each position: every value of a grid, or bins
    with equal numbers of flights."""
    if exact or len(np.unique(x)) <= BINS:
        spots = np.unique(x)
        return spots, [x == spot for spot in spots]
    parts = [part for part in np.array_split(np.argsort(x, kind="stable"), BINS) if len(part)]
    return np.array([np.median(x[part]) for part in parts]), parts


def _json_or_text(cell: str) -> Any:
    """Return a varied value from its cell. Strings have no quotes in the table."""
    try:
        return json.loads(cell)
    except ValueError:
        return cell
