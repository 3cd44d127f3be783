"""Options and help of `circnav locate` and `circnav ranging calibrate`. The modules `command`,
`calibrate` run them."""

import click

from circnav_mav.cli.describe import Finite, Folder, command

ERROR = Finite(0.001, 1000)
"""Parameter type: standard deviation, m."""
VEHICLE = click.option(
    "--vehicle",
    type=click.IntRange(1, 255),
    metavar="ID",
    help="Read only the vehicle with this system id (of a tlog with several).",
)
RANGE_NAME = click.option(
    "--range-name",
    metavar="NAME",
    help="Source of the range: name of a NAMED_VALUE_FLOAT, debug key, or MESSAGE.FIELD.",
)
SIGMA = click.option(
    "--sigma",
    type=ERROR,
    metavar="M",
    help="Standard deviation of the ranges, if the log has none. [default: estimated]",
)
GPS_SIGMA = click.option(
    "--gps-sigma", type=ERROR, default=1.5, metavar="M", help="Standard deviation of the positions."
)
OUT = click.option(
    "--out", type=Folder(), metavar="DIR", help="Output folder. [default: beside the log]"
)


@command("circnav_mav.extras.locate.command:locate_log", short_help="Locate the targets of a log.")
@click.argument("path", type=click.Path(), metavar="RUN|LOG")
@click.option(
    "--tag",
    "tags",
    multiple=True,
    metavar="ID",
    help="Locate only the target with this tag. May be repeated. [default: all]",
)
@VEHICLE
@RANGE_NAME
@click.option(
    "--units",
    metavar="UNIT",
    help="Unit of the ranges: m, cm, ft, nmi ... [default: the log's, or m]",
)
@SIGMA
@GPS_SIGMA
@click.option(
    "--bias",
    type=ERROR,
    default=2.0,
    metavar="M",
    help="Assumed standard deviation, m, of the constant error (bias) of all ranges. Larger: the"
    " bias is estimated more from the log.",
)
@click.option(
    "--altitude",
    type=Finite(-1e6, 1e6),
    metavar="M",
    help="Altitude of the target, if known, above the same reference as the log's altitudes.",
)
@click.option(
    "--params",
    type=click.Choice(["ardupilot"]),
    help="Also print the places as parameters of this autopilot.",
)
@OUT
def locate() -> None:
    """Locate the targets of a log by its positions and ranges. Writes GeoJSON, KML and a picture.

    A log is a run folder, a tlog, an ArduPilot .BIN, a PX4 .ulg, or a CSV with the header time,
    latitude, longitude, range, and optionally altitude, sigma, tag. A suffix gives another unit:
    range_ft.
    Exit codes: 0 located, 2 bad usage, 3 no target located.

    \b
    Examples:
        circnav locate runs/20260101-120000-quickstart
        circnav locate flight.tlog --range-name UWB_DIST
        circnav locate collar.csv --units ft
    """


@command(
    "circnav_mav.extras.locate.calibrate:calibrate_radio",
    short_help="Measure the errors of a radio by a flight with GPS.",
)
@click.argument("path", type=click.Path(), metavar="RUN|LOG")
@click.option(
    "--tag", metavar="ID", help="Calibrate the radio with this id (of a log with several)."
)
@VEHICLE
@RANGE_NAME
@SIGMA
@GPS_SIGMA
@click.option(
    "--altitude",
    type=Finite(-1e6, 1e6),
    metavar="M",
    help="Altitude of the beacon, above the same reference as the log's altitudes.",
)
@click.option(
    "--mission", type=click.Path(), metavar="FILE", help="Also write the result into this mission."
)
@OUT
def calibrate() -> None:
    """Measure the errors of a radio as a function of the range, by a flight with GPS, and write
    them as mission keys.

    Prints and plots the error, and writes ranging.scale, ranging.bias_m and ranging.delay_s, or
    ranging.points_m for a radio that is not linear. The place of the beacon may be unknown. Fly to
    the circle from afar, or fly two radii: one radius shows a bias, but no scale. Exit codes: 0
    calibrated, 2 bad usage, 3 nothing to calibrate.

    \b
    Examples:
        circnav ranging calibrate runs/20260101-120000-quickstart --mission mine.toml
        circnav ranging calibrate flight.tlog --altitude 584 --gps-sigma 0.05
    """
