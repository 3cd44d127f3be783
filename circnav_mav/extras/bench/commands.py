"""Options and help of `circnav bench`. The module `command` runs it."""

import click

from circnav_mav.cli.describe import FORMAT, PROCESSES, SCHEDULER, Folder, command


@command(
    "circnav_mav.extras.bench.command:fly_bench", short_help="Compare the laws over many flights."
)
@click.option(
    "--flights",
    type=click.IntRange(1),
    default=4,
    metavar="N",
    help="Flights per law and situation.",
)
@click.option(
    "--law",
    "laws",
    multiple=True,
    metavar="NAME",
    help="Fly only this law, or law+estimator. Your own: module:name. May be repeated.",
)
@click.option(
    "--situation",
    "situations",
    multiple=True,
    metavar="NAME",
    help="Fly only this situation. May be repeated. A wrong name lists the situations.",
)
@click.option(
    "--seed", type=click.IntRange(0), default=1, metavar="N", help="Seed of all random numbers."
)
@click.option("--out", type=Folder(), metavar="DIR", help="Write the tables and pictures there.")
@click.option("--resume", is_flag=True, help="Fly the missing flights of the folder of --out.")
@PROCESSES
@SCHEDULER
@FORMAT
def bench() -> None:
    """Compare the laws over many simulated flights, with wind, gusts, moving targets and bad
    sensors. Prints a table.

    \b
    Examples:
        circnav bench --flights 20 --out bench
        circnav bench --law auto --situation "wind 0.33 V"
    """
