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
              help="Cruise speed; may be repeated. [default: the mission's]")  # fmt: skip
@click.option("--largest", type=Finite(1), metavar="M", help="Largest radius that fits the site.")
@click.option("--smallest", type=Finite(1), metavar="M", help="Smallest radius that is allowed.")
@click.option(
    "--height",
    type=Finite(0),
    metavar="M",
    help="Height above the beacon. [default: the mission's]",
)
@click.option("--wind", type=Finite(0), default=0.0, metavar="M/S", help="Wind.")
@click.option(
    "--gusts",
    type=Finite(0),
    metavar="M/S",
    help="Turbulence, RMS per axis. [default: 0.15 of the wind]",
)
@click.option(
    "--sigma",
    type=Finite(0, min_open=True),
    metavar="M",
    help="Noise of a range. [default: the mission's]",
)
@click.option("--rate", type=Finite(0, min_open=True), metavar="HZ", help="Ranges per second.")
@click.option("--laps", type=Finite(0.5, 20), default=2.0, metavar="N", help="Laps of the survey.")
@click.option("--out", "picture", metavar="FILE.png", help="Draw a picture.")
@click.option(
    "--write", "mission", metavar="FILE.toml", help="Write a mission with the recommended circle."
)
def plan() -> None:
    """Print a table of circles for VEHICLE, with the recommended one.

    VEHICLE is copter, plane, rover, px4-copter, px4-plane, or a mission file. Each row is checked
    as `circnav check` checks it. "wind to" is the largest wind in which the circle is flyable with
    stability margin. "RMS" is the expected error of the radius, "place" the expected standard
    deviation of the beacon's place after the laps.

    \b
    Examples:
        circnav plan plane --largest 300 --wind 6
        circnav plan copter --speed 4 --sigma 0.1 --rate 20 --out plan.png --write my.toml
    """
