"""Options and help of `circnav paper`. The module `command` runs it."""

import click

from circnav_mav.cli.describe import FORMAT, Folder, command


@command(
    "circnav_mav.extras.paper.command:reproduce_paper",
    short_help="Reproduce the paper's three examples.",
)
@click.option("--out", type=Folder(), default="paper", metavar="DIR", help="Output folder.")
@click.option(
    "--starts", type=click.IntRange(1), default=200, metavar="N", help="Random starts per example."
)
@click.option(
    "--seed", type=click.IntRange(0), default=1, metavar="N", help="Seed of the random starts."
)
@FORMAT
def paper() -> None:
    """Reproduce the three examples of the paper: six figures, and a table of predicted and reached
    radius. The figures show one start for all examples: the first from which example 1 stays
    outside the circle and settles before example 3.

    \b
    Example:
        circnav paper --out paper --starts 500
    """
