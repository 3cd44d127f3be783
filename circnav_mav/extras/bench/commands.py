"""The command `circnav bench`, described; `command` carries it out."""

import click

from circnav_mav.cli.describe import Folder, command


@command("circnav_mav.extras.bench.command:fly_bench", short_help="Compare the laws over many flights.")
@click.option("--flights", type=click.IntRange(1), default=1000, metavar="N", help="Flights of each cell.")
@click.option("--law", "laws", multiple=True, metavar="NAME", help="Only this law (law+estimator). May be repeated.")
@click.option("--situation", "situations", multiple=True, metavar="NAME", help="Only this situation. May be repeated.")
@click.option("--seed", type=click.IntRange(0), default=1, metavar="N", help="Of all random numbers.")
@click.option("--out", type=Folder(), metavar="DIR", help="Write table.csv, table.md and table.png there.")
def bench() -> None:
    """Compare the laws over many flights. Wind, gusts, moving targets, bad sensors; the result is one table.

    \b
    Examples:
        circnav bench --flights 50 --out bench
        circnav bench --law auto --situation "wind .33 V"
    """
