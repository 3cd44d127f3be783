"""`circnav ranging calibrate`: range error of a radio from a log with positions, and mission keys
to correct it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from circnav_mav.cli.exits import Exit, Refused, refusing, say
from circnav_mav.cli.progress import progress
from circnav_mav.extras.locate.command import mission_of, name_of, output, read, target_height
from circnav_mav.extras.locate.estimator import (
    CALIBRATED,
    UNCALIBRATED,
    Knowledge,
    NotLocated,
    Ranges,
    Track,
    locate,
    spread,
)
from circnav_mav.extras.locate.logs.interface import ReadOptions
from circnav_mav.extras.locate.place import Array, Place, Plane
from circnav_mav.extras.locate.range_log import RangeLog, corrected
from circnav_mav.extras.locate.units import is_plausible
from circnav_mav.mav.ranging.calibration import Calibration, rising
from circnav_mav.mission.load import MissionError, load_mission, read_text
from circnav_mav.runlog.atomic_write import write_text

BIAS = 10.0
"""Standard deviation of the bias of an uncalibrated radio, m."""
CLOCKS = 0.1
"""Standard deviation of the delay of ranges relative to positions, s. It is small because one
recorder stamps ranges and positions."""
BINS = 8
"""Number of bins of range in which the range error is averaged."""


@dataclass(frozen=True, slots=True)
class Bin:
    """Ranges of similar length.

    true: median true length, m.
    error: median of reported minus true length, m.
    spread: standard deviation of this error without outliers, m.
    count: number of ranges.
    """

    true: float
    error: float
    spread: float
    count: int


@dataclass(frozen=True, slots=True)
class CalibrationFit:
    """Error of a radio.

    place: place of the beacon.
    calibration: correction of the error.
    true: length of each range, m.
    error: reported minus true length of each range, m.
    scale_sigma: standard deviation of the scale when estimated together with the bias.
    """

    place: Place
    calibration: Calibration
    true: Array
    error: Array
    scale_sigma: float


def calibrate_radio(
    path: str,
    *,
    tag: str | None,
    vehicle: int | None,
    range_name: str | None,
    sigma: float | None,
    gps_sigma: float,
    altitude: float | None,
    mission: str | None,
    out: str | None,
) -> int:
    """Print and plot the range error over the true range, and write the keys of [ranging]. Raises
    Refused."""
    source = Path(path)
    with refusing(source):
        flown = mission_of(source)
        options = ReadOptions(name_of(range_name, flown), vehicle=vehicle)
        log, tag = _radio(read(source, options), tag, source)
        plane = log.plane()
        track = log.track(plane)
        (ranges, sigma_known) = log.of(tag, sigma)
        if mission is not None:
            with refusing(mission, MissionError):
                # The flight corrects its ranges with the height of this mission.
                flown = load_mission(Path(mission))
        # 0.1: standard deviation of the mission's height, m. It is small because the flight
        # corrects its ranges with the same height. An error of the height changes the calibration,
        # but the flown circle still has the true radius.
        known = Knowledge(
            *target_height(track.up, altitude, flown, 0.1),
            gps_sigma=gps_sigma,
            bias_sigma=BIAS,
            scale_sigma=UNCALIBRATED,
            delay_sigma=CLOCKS,
            sigma_known=sigma_known,
        )
        found = measure(plane, track, ranges, known)
        if isinstance(found, NotLocated):
            raise Refused(
                f"{source}: {tag}: the beacon was not located: {found.why}", Exit.NOTHING_RECEIVED
            )
        for note in log.notes:
            say(f"note: {note}")
        _say(tag, found)
        lines = [f"{key} = {value}" for key, value in keys_of(found.calibration).items()]
        results = output(out, source, "calibration")
        write_text(Path(f"{results}.toml"), "[ranging]\n" + "".join(f"{line}\n" for line in lines))
        with progress(f"drawing {results}.png"):
            _plot(Path(f"{results}.png"), found, tag)
        say("\n".join(["[ranging]", *lines]))
        say(f"  written    {results}.toml, .png")
        if mission is not None and not found.place.up_known:
            raise Refused(
                f"{mission}: is not changed: the height of the beacon is unknown, give --altitude",
                Exit.NOTHING_RECEIVED,
            )
        if mission is not None:
            write_into(Path(mission), found.calibration)
            say(f"  written    into {mission}: the next flight uses it")
    return Exit.DONE


def measure(
    plane: Plane, track: Track, ranges: Ranges, known: Knowledge
) -> CalibrationFit | NotLocated:
    """Return the error of a radio from positions and reported ranges."""
    place = free = locate(plane, track, ranges, known)
    if isinstance(free, NotLocated):
        return free
    # On a single radius, every scale fits with a suitable bias.
    if not free.scale_found:
        place = locate(plane, track, ranges, replace(known, scale_sigma=CALIBRATED))
        if isinstance(place, NotLocated):
            return place
    assert isinstance(place, Place)
    # Refuse an implausible height: a large offset of the radio can be fitted as a height, a scale
    # and a delay.
    if not is_plausible(place, known):
        return NotLocated(
            f"the ranges fit only a beacon at altitude {place.up:.0f} m: measure the radio's"
            " offset at a known distance first"
        )
    # A range is never measured after its timestamp. A negative delay has another cause: late
    # positions, or a radio that is not linear.
    # 0.05: smallest delay that is corrected, s. At 15 m/s, a smaller delay changes a range by less
    # than the GPS error.
    delay = round(-place.delay, 3) if -place.delay > max(3 * place.delay_sigma, 0.05) else 0.0
    scale, bias = (
        (1.0, place.range_error(place.range_scale)[0])
        if not place.scale_found
        else (1 + place.scale, place.bias)
    )
    linear = Calibration(round(scale, 5), round(bias, 2), delay)
    straight = CalibrationFit(place, linear, *_errors(place, track, ranges), free.scale_sigma)
    bins = _bins(straight.true, straight.error)
    off = [
        abs(one.error - (linear.reported(one.true) - one.true)) - 3 * one.spread / one.count**0.5
        for one in bins
    ]
    # 2.0: largest deviation of a bin from the straight line of scale and bias, in GPS sigmas. Above
    # it, a table of points replaces the line.
    if max(off, default=0.0) <= 2.0 * known.gps_sigma:
        return straight
    # The radio is not linear. The place fitted with a straight line is slightly off, and so is a
    # table made with this place. Each round improves place and table, because a circle gives the
    # place for any constant error. Do not estimate the delay again: on a straight approach it looks
    # like a bias of the far ranges, and estimating delay and bias together diverges.
    track = replace(track, time=track.time - place.delay)
    settled = replace(known, bias_sigma=1.0, scale_sigma=CALIBRATED, delay_sigma=0.001)
    curved = straight
    # 4: number of refinements of the table and of the place. Each refinement changes table and
    # place less than the one before.
    for _ in range(4):
        points = tuple((round(one.true, 1), round(one.true + one.error, 2)) for one in bins)
        if not rising(points):
            return straight
        calibration = Calibration(points=points, delay=delay)
        again = locate(plane, track, corrected(ranges, replace(calibration, delay=0.0)), settled)
        if isinstance(again, NotLocated):
            return straight
        curved = CalibrationFit(
            again, calibration, *_errors(again, track, ranges), free.scale_sigma
        )
        bins = _bins(curved.true, curved.error)
    return curved


def write_into(file: Path, calibration: Calibration) -> None:
    """Write a calibration into a mission file. Comments and other keys are kept. Raises Refused,
    OSError."""
    with refusing(file, MissionError):
        load_mission(file)
        document = tomlkit.parse(read_text(file))
    table: Any = document["ranging"]  # also works for an inline table and for dotted keys
    for key in ("scale", "bias_m", "delay_s", "points_m"):
        table.pop(key, None)
    for key, value in keys_of(calibration).items():
        table[key] = value
    write_text(file, tomlkit.dumps(document))


def keys_of(calibration: Calibration) -> dict[str, float | list[list[float]]]:
    """Return the keys of [ranging] for a calibration."""
    if calibration.points:
        keys: dict[str, float | list[list[float]]] = {
            "points_m": [list(point) for point in calibration.points]
        }
    else:
        keys = {"scale": calibration.scale, "bias_m": calibration.bias}
    return keys | ({"delay_s": calibration.delay} if calibration.delay else {})


def _radio(logs: Sequence[RangeLog], tag: str | None, source: Path) -> tuple[RangeLog, str]:
    """Return the radio to calibrate, with its log. Of several boots, return the
    longest. Raises Refused unless there is exactly one radio."""
    radios = [(log, name) for log in logs if len(log.positions) > 1 for name in log.ranges]
    chosen = [(log, name) for log, name in radios if tag in (None, name)]
    if len({name for _, name in chosen}) != 1:
        names = ", ".join(repr(name) for name in dict.fromkeys(name for _, name in radios))
        raise Refused(f"{source}: has several radios: give --tag, one of {names}")
    log, name = max(chosen, key=lambda radio: len(radio[0].ranges[radio[1]]))
    if len(chosen) > 1:
        log.note(f"{log.vehicle} is used: it has the most ranges")
    return log, name


def _errors(place: Place, track: Track, ranges: Ranges) -> tuple[Array, Array]:
    """Return the true length of each range, computed from positions, and the reported minus the
    true length, m."""
    inside = (ranges.time >= track.time[0]) & (ranges.time <= track.time[-1])
    time = ranges.time[inside] + place.delay
    way = [np.interp(time, track.time, part) for part in (track.east, track.north, track.up)]
    true = np.sqrt(
        (way[0] - place.east) ** 2 + (way[1] - place.north) ** 2 + (way[2] - place.up) ** 2
    )
    return true, ranges.r[inside] - true


def _bins(true: Array, error: Array) -> list[Bin]:
    """Return the range error in bins of equal width. The bins use medians, because the ranges
    include outliers."""
    width = max(float(np.ptp(true)), 1e-3) / BINS
    at = np.minimum(((true - true.min()) / width).astype(int), BINS - 1)
    found = []
    for one in range(BINS):
        these = at == one
        # 10: smallest number of ranges in a bin.
        if these.sum() >= 10:
            middle = float(np.median(error[these]))
            scatter = spread(error[these] - middle)
            found.append(Bin(float(np.median(true[these])), middle, scatter, int(these.sum())))
    return found


def _say(tag: str, found: CalibrationFit) -> None:
    place = found.place
    calibration = found.calibration
    say(f"{tag}: {place.used} ranges, noise {place.noise:.2f} m, beacon at {place.words()}")
    say("  true range     reported minus true     spread    ranges")
    for one in _bins(found.true, found.error):
        say(
            f"  {one.true:8.1f} m     {one.error:+10.2f} m        {one.spread:8.2f} m "
            f" {one.count:6d}"
        )
    error = place.range_error_words()
    if calibration.points:
        say("  radio      not linear: a table of points")
    elif place.scale_found:
        say(f"  radio      {place.scale_words}, bias {place.bias:+.2f} ±{place.bias_sigma:.2f} m")
    # 0.01: largest standard deviation of an observed scale: 1 m at 100 m.
    elif found.scale_sigma < 0.01:
        say(f"  radio      {error}; scale 1 ±{found.scale_sigma:.4f}")
    else:
        say(
            f"  radio      {error}. Valid at this range only: one circle cannot separate scale and"
            " bias; also fly the approach or a second radius"
        )
    if not place.up_known:
        say(
            "  WARNING    the height of the beacon is unknown, its effect looks like a bias: give"
            " --altitude"
        )


def _plot(path: Path, found: CalibrationFit, tag: str) -> None:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    from circnav_mav.report.plots import STYLE, literal, save

    true = found.true
    error = found.error
    calibration = found.calibration
    line = np.linspace(0, float(true.max()), 200)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8, 4.5), layout="constrained")
        axis = figure.subplots()
        axis.plot(true, error, ".", ms=2, alpha=0.4, label="ranges")
        axis.plot(
            line,
            [calibration.reported(one) - one for one in line],
            color="#d55e00",
            label="calibration",
        )
        low, high = np.percentile(error, [1, 99])
        axis.set(
            xlabel="true range, m", ylabel="reported minus true range, m", ylim=(low - 2, high + 2)
        )
        axis.set_title(literal(f"{tag}: {calibration.describe()}"))
        axis.legend(fontsize=8)
        save(figure, path)
