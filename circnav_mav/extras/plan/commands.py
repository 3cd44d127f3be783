"""Options and help of `circnav plan`. The module `command` runs it."""

import click

from circnav_mav.cli.bundled import FileOrName
from circnav_mav.cli.describe import Finite, command


@command(
    "circnav_mav.extras.plan.command:print_plan",
    short_help="Choose radius and speed for a site and its wind.",
)
@click.argument("path", metavar="VEHICLE", type=FileOrName("mission"))
@click.option("--speed", "speeds", type=Finite(0.1, 150), metavar="M/S", multiple=True,
              help="Cruise speed. May be repeated. [default: vehicle.speed_mps]")  # fmt: skip
@click.option("--largest", type=Finite(1), metavar="M", help="Largest radius allowed by the site.")
@click.option("--smallest", type=Finite(1), metavar="M", help="Smallest radius allowed.")
@click.option(
    "--height",
    type=Finite(0),
    metavar="M",
    help="Height of the vehicle above the beacon. [default: as in the mission]",
)
@click.option("--wind", type=Finite(0), default=0.0, metavar="M/S", help="Wind speed.")
@click.option(
    "--gusts",
    type=Finite(0),
    metavar="M/S",
    help="Turbulence, RMS per axis. [default: 0.15 times --wind]",
)
@click.option(
    "--sigma",
    type=Finite(0, min_open=True),
    metavar="M",
    help="Standard deviation of the ranges. [default: ranging.sigma_m]",
)
@click.option(
    "--rate",
    type=Finite(0, min_open=True),
    metavar="HZ",
    help="Ranges per second. [default: ranging.rate_hz]",
)
@click.option(
    "--laps", type=Finite(0.5, 20), default=2.0, metavar="N", help="Laps for locating the beacon."
)
@click.option("--out", "picture", metavar="FILE.png", help="Draw a picture of the plan.")
@click.option(
    "--write", "mission", metavar="FILE.toml", help="Write a mission with the recommended circle."
)
def plan() -> None:
    """Print a table of circles for VEHICLE, and recommend one.

    VEHICLE is copter, plane, rover, px4-copter, px4-plane, or a mission file. Each row has the
    checks of `circnav check`. "wind to" is the largest wind in which the vehicle can fly the circle
    with stability margin. "RMS" is the expected RMS error of the radius, "place" the expected
    standard deviation of the located beacon after --laps.

    \b
    Examples:
        circnav plan plane --largest 300 --wind 6
        circnav plan copter --speed 4 --sigma 0.1 --rate 20 --out plan.png --write my.toml
    """
