"""The command `circnav ranging`, described; `command` carries it out."""

import click

from circnav_mav.cli.describe import Finite, Folder, command

ERROR = Finite(0.001, 1000)
"""A standard deviation, m."""


@click.group(short_help="Try a ranging radio and its driver.")
def ranging() -> None:
    """Try a ranging radio and its driver without a vehicle, and calibrate it by a flight.

    \b
    Example:
        circnav ranging watch linktrack:/dev/ttyUSB0
    """


@command(
    "circnav_mav.extras.radios.command:watch_radio",
    group=ranging,
    short_help="Show what a radio measures, a line a second.",
)
@click.argument("endpoint", metavar="DRIVER:PORT")
@click.option("--seconds", type=Finite(1), metavar="N", help="How long. [default: until Ctrl-C]")
def watch() -> None:
    """Show what a radio measures: a line a second for each beacon, over the last ten seconds.

    DRIVER is dwm1001, lines, linktrack or one of an installed package; PORT a device (/dev/ttyUSB0, or with its baud
    rate /dev/ttyUSB0:115200) or an endpoint (udpin:0.0.0.0:5005, tcp:HOST:PORT). A mission takes the same as its
    ranging.endpoint. Exit codes: 0 ranges were heard, 2 no such driver or port, 3 none were heard.

    \b
    Examples:
        circnav ranging watch linktrack:/dev/ttyUSB0
        circnav ranging watch lines:udpin:0.0.0.0:5005 --seconds 10
    """


@command(
    "circnav_mav.extras.locate.calibrate:calibrate_radio",
    group=ranging,
    short_help="Measure the error of a radio by a flight with GPS.",
)
@click.argument("path", type=click.Path(), metavar="RUN|LOG")
@click.option("--tag", metavar="ID", help="The radio, if the log has several.")
@click.option(
    "--sigma", type=ERROR, metavar="M", help="Noise of the ranges, if the log has none. [default: as it shows]"
)
@click.option("--gps-sigma", type=ERROR, default=1.5, metavar="M", help="Error of the positions.")
@click.option("--altitude", type=Finite(-1e6, 1e6), metavar="M", help="Altitude of the beacon, as the log counts it.")
@click.option("--mission", type=click.Path(), metavar="FILE", help="Write the keys into this mission, too.")
@click.option("--out", type=Folder(), metavar="DIR", help="Where to write. [default: beside the log]")
def calibrate() -> None:
    """Measure the error of a radio over its range by a flight with GPS, and write it for the mission.

    Prints and plots the error, and writes ranging.scale, ranging.bias_m and ranging.delay_s; of a radio that is not
    linear ranging.points_m. The beacon need not be surveyed. Fly to the circle from afar, or on two radii: on one, only
    the error of that radius is known. Exit codes: 0 calibrated, 2 bad usage, 3 nothing to calibrate.

    \b
    Examples:
        circnav ranging calibrate runs/20260101-120000-quickstart --mission mine.toml
        circnav ranging calibrate flight.tlog --altitude 584 --gps-sigma 0.05
    """
