"""`circnav locate`: where the targets of a log are."""

from dataclasses import replace
from pathlib import Path

import click

from circnav_mav.cli.exits import Exit, Refused, refusing
from circnav_mav.extras.locate.estimator import Knowledge, NotYet, locate_as_it_shows
from circnav_mav.extras.locate.export import geojson, kml
from circnav_mav.extras.locate.map_picture import plot_map
from circnav_mav.extras.locate.place import NO_SCALE, NOT_OBSERVABLE, Place, Plane
from circnav_mav.extras.locate.range_log import EmptyLogError, RangeLog, read_log
from circnav_mav.mission.load import MissionError, load_mission
from circnav_mav.mission.mission import Mission
from circnav_mav.runlog.atomic_write import write_text
from circnav_mav.runlog.run_folder import RunError, printable

MIXED, POOR = 0.25, 0.05
"""Share of outliers that are more than outliers; noise over range that no radio has."""
CLOCKS = 0.5
"""Standard deviation, s, of the offset between the clocks of positions and ranges: nobody has set them together."""


def locate_log(
    path: str, *, out: str | None, tags: tuple[str, ...], sigma: float | None, gps_sigma: float, bias: float,
    altitude: float | None,
) -> int:  # fmt: skip
    """Locate every tag of a log, and write the map: the command line of `locate`. Raises Refused."""
    source = Path(path)
    with refusing(source):
        flown = _mission(source)
        try:
            log = read_log(source) if flown is None else read_log(source, flown.file.ranging.name)
        except RunError as error:
            empty = isinstance(error, EmptyLogError)
            raise Refused(str(error), Exit.NOTHING_HEARD if empty else Exit.USAGE) from None
        if flown is not None:
            sigma = flown.file.ranging.sigma_m if sigma is None else sigma
            altitude = flown.height.target_altitude if altitude is None else altitude
        plane, unknown = log.plane(), [tag for tag in tags if tag not in log.ranges]
        if unknown:
            raise Refused(f"--tag {unknown[0]}: not in {source}, which has: {', '.join(map(repr, log.ranges))}")
        ground = float(log.track(plane).up.min())
        known = Knowledge(
            up=ground if altitude is None else altitude, up_sigma=50.0 if altitude is None else 1.0,
            gps_sigma=gps_sigma, bias_sigma=bias, delay_sigma=CLOCKS,
        )  # fmt: skip
        found = ((tag, _one(log, plane, tag, sigma, known)) for tag in tags or log.ranges)
        places = {tag: place for tag, place in found if place is not None}
        if not places:
            raise Refused(f"{source}: no target was located", Exit.NOTHING_HEARD)
        _write(out, source, places, log)
    return Exit.DONE


def _mission(source: Path) -> Mission | None:
    """The mission of a run folder, whose ranges and target are as it says. Raises Refused."""
    file = source / "mission.toml"
    if not file.exists():
        return None
    with refusing(file, MissionError):
        return load_mission(file)


def _one(log: RangeLog, plane: Plane, tag: str, sigma: float | None, known: Knowledge) -> Place | None:
    """A tag, with what is known of it printed."""
    ranges, said = log.of(tag, sigma)
    track, known = log.track(plane), replace(known, sigma_known=said)
    place = locate_as_it_shows(plane, track, ranges, known)
    click.echo(f"{tag}: {len(ranges.r)} ranges")
    if isinstance(place, NotYet):
        click.echo(f"  WARNING    not located: {place.why}")
        return None
    _say(place, known)
    return place


def _say(place: Place, known: Knowledge) -> None:
    ellipse = place.ellipse
    click.echo(f"  place      {place.words()}")
    click.echo(
        f"  95 %       {ellipse.major:.1f} x {ellipse.minor:.1f} m, long axis {ellipse.azimuth:.0f} deg; the "
        f"positions' own error counts with {known.gps_sigma:g} m"
    )
    if not place.up_known:
        click.echo(f"  height     {NOT_OBSERVABLE}")
    error, sigma = place.range_error(place.range_scale)
    at = f"{error:+.2f} +-{sigma:.2f} m too long at {place.range_scale:.0f} m"
    bias = f"bias {place.bias:+.2f} +-{place.bias_sigma:.2f} m"
    scale = f"scale {1 + place.scale:.4f} +-{place.scale_sigma:.4f}" if place.scale_known else NO_SCALE
    click.echo(f"  ranges     noise {place.noise:.2f} m; {at}")
    click.echo(f"  radio      {bias}, {scale}")
    late = f"positions are stamped {place.delay:+.2f} +-{place.delay_sigma:.2f} s later than ranges"
    known_clocks = place.delay_sigma < known.delay_sigma
    click.echo(f"  clocks     {late if known_clocks else 'offset not observable: the distance hardly changes'}")
    total = place.used + place.outliers
    if abs(place.up - known.up) > 3 * known.up_sigma:
        click.echo(f"  WARNING    the ranges fit a target at {place.up:.0f} m only: are they slant ranges in metres?")
    if place.outliers:
        click.echo(f"  outliers   {place.outliers} of {total} left out")
    if place.outliers > MIXED * total or place.noise > POOR * place.range_scale:
        click.echo("  WARNING    the ranges fit no single place well: two tags mixed? Give the CSV a column tag")


def _write(out: str | None, source: Path, places: dict[str, Place], log: RangeLog) -> None:
    """GeoJSON, KML and the picture."""
    folder = Path(out) if out else source if source.is_dir() else source.parent
    name = "locate" if source.is_dir() else f"{source.stem}.locate"
    folder.mkdir(parents=True, exist_ok=True)
    track = [(latitude, longitude) for _, latitude, longitude, _ in sorted(log.positions)]
    table = geojson(places, track[:: max(1, len(track) // 5000)])
    write_text(folder / f"{name}.geojson", table)
    write_text(folder / f"{name}.kml", kml(places))
    plot_map(folder / f"{name}.png", table, printable(str(source)))
    click.echo(f"  written    {folder / name}.geojson, .kml, .png")
