"""The command `circnav paper`, described; `command` carries it out."""

import click

from circnav_mav.cli.describe import Folder, command


@command("circnav_mav.extras.paper.command:reproduce_paper", short_help="Reproduce the paper's three examples.")
@click.option("--out", type=Folder(), default="paper", metavar="DIR", help="Where to write.")
@click.option("--starts", type=click.IntRange(1), default=200, metavar="N", help="Random starts of each example.")
@click.option("--seed", type=click.IntRange(0), default=1, metavar="N", help="Of the random starts.")
def paper() -> None:
    """Reproduce the three examples of the paper. Draws six figures, and prints a table of predicted and reached radius.

    \b
    Example:
        circnav paper --out paper --starts 500
    """
