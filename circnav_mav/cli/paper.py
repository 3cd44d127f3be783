"""`circnav paper`."""

from pathlib import Path

import click

from circnav_mav.cli.exits import Exit, Refused, refusing
from circnav_mav.experiments.paper import EXAMPLES, draw, random_starts, study, table
from circnav_mav.runlog.atomic_write import write_text

SHOWN = 2
"""The start that the figures show, where there are as many."""


def reproduce(out: str, starts: int, seed: int) -> int:
    """Fly the examples, draw, print. Raises Refused."""
    if starts < 1:
        raise Refused(f"--starts: must be at least 1, not {starts}")
    if seed < 0:
        raise Refused(f"--seed: must be at least 0, not {seed}")
    folder, found = Path(out), []
    with refusing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for example in EXAMPLES:
            findings, tracks = study(example, random_starts(starts, seed))
            found.append(findings)
            for path in draw(folder, example, tracks, min(SHOWN, starts - 1)):
                click.echo(path)
        write_text(folder / "table.md", table(found) + "\n")
    click.echo(f"{folder / 'table.md'}\n\n{table(found)}")
    return Exit.DONE
