"""`circnav locate`: places of the targets in a log."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from circnav_mav.cli.exits import Exit, Refused, refusing, say
from circnav_mav.cli.progress import progress
from circnav_mav.extras.locate.estimator import HEIGHT_UNKNOWN, Knowledge, NotLocated, locate
from circnav_mav.extras.locate.export import geojson, kml
from circnav_mav.extras.locate.logs.interface import METERS, ReadOptions, meters_in
from circnav_mav.extras.locate.logs.table import read_logs
from circnav_mav.extras.locate.parameters import ardupilot
from circnav_mav.extras.locate.place import NOT_OBSERVABLE, Array, Place
from circnav_mav.extras.locate.range_log import EmptyLogError, RangeLog, corrected, tracks
from circnav_mav.extras.locate.units import is_plausible, likely_unit
from circnav_mav.foreign import printable
from circnav_mav.mav.ranging.calibration import Calibration
from circnav_mav.mission.load import MissionError, load_mission
from circnav_mav.mission.mission import Mission
from circnav_mav.runlog.atomic_write import write_text
from circnav_mav.runlog.run_folder import RunError

MIXED = 0.25
"""Share of outliers above which the ranges probably mix two tags."""
POOR = 0.05
"""Noise divided by the median range, above which the ranges probably mix two tags."""


def locate_log(
    path: str,
    *,
    out: str | None,
    tags: tuple[str, ...],
    sigma: float | None,
    gps_sigma: float,
    bias: float,
    altitude: float | None,
    vehicle: int | None,
    range_name: str | None,
    units: str | None,
    params: str | None,
) -> int:
    """Locate every tag of a log and write the map. Parameters: options of `circnav locate`. Raises
    Refused."""
    source = Path(path)
    with refusing(source):
        flown = mission_of(source)
        options = _options(range_name, units, vehicle, flown)
        with progress(f"reading {source.name}"):
            logs = read(source, options)
        calibration = Calibration()
        if flown is not None:
            sigma = sigma or flown.file.ranging.sigma_m
            calibration = flown.file.ranging.calibration
        if calibration.is_set:
            say(
                "note: the log's ranges are corrected with the mission's calibration:"
                f" {calibration.describe()}"
            )
        jobs = _jobs(logs, tags, source)
        for note in dict.fromkeys(chain.from_iterable(log.notes for log in logs)):
            say(f"note: {note}")
        places = {}
        for name, (log, tag) in jobs.items():
            # 0.5: standard deviation of the offset between the clocks of positions and ranges, s:
            # these clocks are not synchronized.
            known = Knowledge(
                *target_height(log.track(log.plane()).up, altitude, flown, 1.0),
                gps_sigma=gps_sigma,
                bias_sigma=bias,
                delay_sigma=0.5,
            )
            place = _one(log, tag, sigma, known, calibration, search_unit=options.unit is None)
            if place is not None:
                places[name] = place
        if not places:
            raise Refused(f"{source}: no target was located", Exit.NOTHING_RECEIVED)
        _write(out, source, places, logs)
        if params is not None:
            say("\n".join(ardupilot(places)))
    return Exit.DONE


def read(source: Path, options: ReadOptions) -> list[RangeLog]:
    """Return the vehicles of the log. Raises Refused."""
    try:
        return read_logs(source, options)
    except RunError as error:
        empty = isinstance(error, EmptyLogError)
        raise Refused(str(error), Exit.NOTHING_RECEIVED if empty else Exit.USAGE) from None


def mission_of(source: Path) -> Mission | None:
    """Return the mission of a run folder, None if it has none. Raises Refused."""
    file = source / "mission.toml"
    if not file.exists():
        return None
    with refusing(file, MissionError):
        return load_mission(file)


def _options(
    range_name: str | None, units: str | None, vehicle: int | None, mission: Mission | None
) -> ReadOptions:
    """Return the options for reading the log. Raises Refused for an unknown unit."""
    unit = None
    if units is not None:
        unit = meters_in(units)
        if unit is None:
            raise Refused(
                f"--units {units}: is not a unit: {', '.join(METERS)}, or the length of the unit in"
                " meters"
            )
    return ReadOptions(name_of(range_name, mission), unit, vehicle)


def name_of(given: str | None, mission: Mission | None) -> str:
    """Return the name of the messages with the ranges: the given name, else the name in the
    mission, else the default."""
    return given or (ReadOptions().range_name if mission is None else mission.file.ranging.name)


def target_height(
    heights: Array, altitude: float | None, mission: Mission | None, sigma: float
) -> tuple[float, float]:
    """Return the altitude of the target and its standard deviation, m: the given altitude, else
    that of the mission, else the lowest altitude of the vehicle.

    heights: altitudes of the vehicle, m.
    sigma: standard deviation of a given altitude and of that of the mission, m.
    """
    if altitude is None and mission is not None:
        orbit = mission.file.orbit
        altitude = orbit.target_altitude_m
        if altitude is None and orbit.height_above_target_m is not None:
            altitude = float(np.median(heights)) - orbit.height_above_target_m
    if altitude is None:
        return float(heights.min()), HEIGHT_UNKNOWN
    return altitude, sigma


def output(out: str | None, source: Path, kind: str) -> Path:
    """Return the path of the results of a log, without suffix: in the folder `out` if given, else
    beside the log."""
    folder = Path(out) if out else source if source.is_dir() else source.parent
    folder.mkdir(parents=True, exist_ok=True)
    return folder / (kind if source.is_dir() else f"{source.stem}.{kind}")


def _jobs(
    logs: Sequence[RangeLog], tags: tuple[str, ...], source: Path
) -> dict[str, tuple[RangeLog, str]]:
    """Return the tags to locate, each with its log, by the name of its place. Raises Refused."""
    jobs = [(log, tag) for log in logs if len(log.positions) > 1 for tag in log.ranges]
    # The same tag may be in several boots, or a CSV's tag on several vehicles.
    count = Counter(tag for _, tag in jobs)
    for wanted in tags:
        if wanted not in count:
            found = ", ".join(repr(tag) for _, tag in jobs)
            raise Refused(f"--tag {wanted}: not in {source}, which has: {found}")
    return {
        f"{tag}, {log.vehicle}" if count[tag] > 1 else tag: (log, tag)
        for log, tag in jobs
        if not tags or tag in tags
    }


def _one(
    log: RangeLog,
    tag: str,
    sigma: float | None,
    known: Knowledge,
    calibration: Calibration,
    *,
    search_unit: bool,
) -> Place | None:
    """Locate a tag and print the result. Return None if it was not located."""
    plane = log.plane()
    ranges, sigma_known = log.of(tag, sigma)
    ranges = corrected(ranges, calibration)
    track = log.track(plane)
    known = replace(known, sigma_known=sigma_known)
    say(f"{tag}: {len(ranges.r)} ranges{f' of {log.vehicle}' if log.vehicle else ''}")
    with progress(f"locating {tag}"):
        place = locate(plane, track, ranges, known)
        found = place if isinstance(place, Place) else None
        likely = likely_unit(plane, track, ranges, known, found) if search_unit else None
    if isinstance(place, NotLocated):
        say(f"  WARNING    not located: {place.why}")
        away = float(np.abs(track.up - known.up).min())
        if len(ranges.r) and away > ranges.r.max():
            say(
                f"  WARNING    the target's altitude of {known.up:.0f} m is {away:.0f} m from the"
                " track, farther than all ranges: is it above sea level?"
            )
    else:
        _say(place, known)
    if likely is not None:
        say(
            f"  WARNING    the ranges are {1 / METERS[likely]:.3g} times as long as in m: probably"
            f" in {likely}, give --units {likely}"
        )
    return found


def _say(place: Place, known: Knowledge) -> None:
    ellipse = place.ellipse
    say(f"  place      {place.words()}")
    say(
        f"  95 %       ±{ellipse.major:.1f} x ±{ellipse.minor:.1f} m, long axis"
        f" {ellipse.azimuth:.0f} deg; includes {known.gps_sigma:g} m of position error"
    )
    if not place.up_known:
        say(f"  height     {NOT_OBSERVABLE}")
    bias = f"bias {place.bias:+.2f} ±{place.bias_sigma:.2f} m"
    say(f"  ranges     noise {place.noise:.2f} m; {place.range_error_words()}")
    say(f"  radio      {bias}, {place.scale_words}")
    late = (
        f"timestamps of positions are {place.delay:+.2f} ±{place.delay_sigma:.2f} s later than"
        " timestamps of ranges"
    )
    known_clocks = place.delay_sigma < known.delay_sigma
    say(
        "  clocks    "
        f" {late if known_clocks else 'offset not observable: the distance hardly changes'}"
    )
    total = place.used + place.outliers
    if not is_plausible(place, known):
        say(
            f"  WARNING    the ranges fit only a target at altitude {place.up:.0f} m: are they"
            " slant ranges in meters?"
        )
    # Warn about a large delay: it can make a wrong place fit, for example if the first positions
    # are a receiver's last fix.
    if abs(place.delay) > 10 * known.delay_sigma:
        say(
            f"  WARNING    the ranges fit only if the clocks differ by {place.delay:+.1f} s: do"
            " they, or do positions jump?"
        )
    if place.outliers:
        say(f"  outliers   {place.outliers} of {total} left out")
    if place.outliers > MIXED * total or place.noise > POOR * place.range_scale:
        say(
            "  WARNING    the ranges fit no single place well: two tags mixed? Add a column named"
            " tag to the CSV"
        )


def _write(
    out: str | None, source: Path, places: dict[str, Place], logs: Sequence[RangeLog]
) -> None:
    """Write GeoJSON, KML and the picture."""
    path = output(out, source, "locate")
    table = geojson(places, *tracks(logs))
    write_text(Path(f"{path}.geojson"), table)
    write_text(Path(f"{path}.kml"), kml(places))
    with progress(f"drawing {path}.png"):
        from circnav_mav.extras.locate.map_picture import plot_map

        plot_map(Path(f"{path}.png"), table, printable(str(source)))
    say(f"  written    {path}.geojson, .kml, .png")
