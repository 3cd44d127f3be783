"""The command `circnav paper`."""

from pathlib import Path

from circnav_mav.cli.exits import Exit, refusing, say
from circnav_mav.extras.paper import paper
from circnav_mav.extras.paper.paper import random_starts
from circnav_mav.runlog.atomic_write import write_text


def reproduce_paper(out: str, starts: int, seed: int) -> int:
    """Fly the examples, draw the figures and print the table. Raises Refused."""
    folder = Path(out)
    found = []
    with refusing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for example in paper.EXAMPLES:
            findings, tracks = paper.study(example, random_starts(starts, seed))
            found.append(findings)
            # Index of the start shown in the figures, at most the last one.
            for path in paper.draw(folder, example, tracks, min(2, starts - 1)):
                say(str(path))
        write_text(folder / "table.md", paper.table(found) + "\n")
    say(f"{folder / 'table.md'}\n\n{paper.table(found)}")
    return Exit.DONE
