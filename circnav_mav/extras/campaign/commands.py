"""Options and help of `circnav campaign`. The module `command` runs it."""

import click

from circnav_mav.cli.bundled import FileOrName
from circnav_mav.cli.describe import FORMAT, PROCESSES, SCHEDULER, Folder, command


@command(
    "circnav_mav.extras.campaign.command:fly_campaign",
    short_help="Fly a mission many times with varied values.",
)
@click.argument("file", type=FileOrName("campaign"), metavar="CAMPAIGN")
@click.option(
    "--runs",
    type=click.IntRange(1),
    metavar="N",
    help="Number of flights. [default: as in the file]",
)
@click.option(
    "--out", type=Folder(), metavar="DIR", help="Output folder. [default: campaigns/<time>-<name>]"
)
@click.option("--resume", is_flag=True, help="Continue the campaign in the folder of --out.")
@PROCESSES
@SCHEDULER
@FORMAT
def campaign() -> None:
    """Fly a mission many times on the bundled vehicle, with varied values. CAMPAIGN is a file or
    the name of a bundled campaign. Writes a table, a summary and plots.

    \b
    Examples:
        circnav campaign wind
        circnav campaign wind --runs 20000 --out wind --resume
    """
