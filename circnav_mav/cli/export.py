"""`circnav export`."""

from pathlib import Path

import click

from circnav_mav.analysis.export_mcap import export_mcap
from circnav_mav.analysis.run import RunError, open_run
from circnav_mav.cli.exits import Exit, Refused


def export_run(folder: str, out: str | None) -> int:
    """Write the MCAP file and say what is in it. Raises Refused."""
    path = Path(out) if out else Path(folder) / "flight.mcap"
    try:
        run = open_run(Path(folder))
        if not len(run.ticks.time):
            raise Refused(f"{folder}: an empty run, nothing was recorded", Exit.NOTHING_HEARD)
        counts = export_mcap(run, path)
    except ImportError:
        raise Refused("export --mcap needs the package mcap: pip install 'circnav-mav[mcap]'") from None
    except RunError as error:
        raise Refused(str(error)) from None
    except OSError as error:
        raise Refused(f"{error.filename or path}: {error.strerror or error}") from None
    click.echo(f"{path}: " + ", ".join(f"{count} messages on {topic}" for topic, count in counts.items()))
    return Exit.DONE
