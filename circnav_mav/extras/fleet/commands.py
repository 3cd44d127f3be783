"""Fleet options of `circnav fly`."""

import click

from circnav_mav.cli.describe import Finite

FLEET = click.option(
    "--fleet",
    type=click.IntRange(2, 100),
    metavar="N",
    help="Fly N emulated vehicles on one circle.",
)
LOSS = click.option(
    "--fleet-loss",
    type=Finite(0, 1),
    default=0.0,
    metavar="P",
    help="Simulated share of lost reports between the vehicles of --fleet.",
)
COMPASS = click.option(
    "--fleet-compass",
    type=click.FloatRange(0, 45),
    default=0.0,
    metavar="DEG",
    help="Simulated compass errors of the vehicles of --fleet, standard deviation.",
)
DELAY = click.option(
    "--fleet-delay",
    type=Finite(0, 60),
    default=0.0,
    metavar="S",
    help="Simulated delay of the reports between the vehicles of --fleet.",
)
