"""The command `circnav paper`."""

from itertools import chain
from pathlib import Path

from circnav_mav.cli.exits import Exit, refusing, say
from circnav_mav.cli.progress import each
from circnav_mav.extras.paper import paper
from circnav_mav.extras.paper.paper import random_starts
from circnav_mav.runlog.atomic_write import write_text


def reproduce_paper(out: str, starts: int, seed: int, form: str) -> int:
    """Fly the examples, draw the figures and print the table. Raises Refused."""
    folder = Path(out)
    flown = random_starts(starts, seed)
    with refusing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        examples = paper.EXAMPLES
        found = [
            paper.study(example, flown)[0]
            for example in each("flying the examples", examples, len(examples))
        ]
        shown = flown.only(paper.shown_start(found))
        drawn = [
            paper.draw(folder, example, shown, form)
            for example in each("drawing the examples", examples, len(examples))
        ]
        for path in chain.from_iterable(drawn):
            say(str(path))
        write_text(folder / "table.md", paper.table(found) + "\n")
    say(f"{folder / 'table.md'}\n\n{paper.table(found)}")
    return Exit.DONE
