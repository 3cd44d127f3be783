"""Options and help of `circnav export`. The module `command` runs it."""

import click

from circnav_mav.cli.describe import command


@command(
    "circnav_mav.extras.mcap.command:export_run",
    short_help="Convert a run for Foxglove or PlotJuggler.",
)
@click.argument("folder", type=click.Path(), metavar="RUN")
@click.option(
    "--mcap",
    "mcap",
    is_flag=False,
    flag_value="",
    metavar="[FILE]",
    help="Write an MCAP file. [default: RUN/flight.mcap]",
)
def export() -> None:
    """Convert RUN, a run folder, for Foxglove or PlotJuggler. The file contains ticks, truth and
    events. From a fleet folder, the file contains all vehicles, with topics such as /01/ticks.

    \b
    Example:
        circnav export runs/20260101-120000-quickstart --mcap
    """
