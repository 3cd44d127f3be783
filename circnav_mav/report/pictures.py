"""What all pictures share: how they look, users' own words in them, and that they are there whole or not at all."""

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from circnav_mav.runlog.atomic_write import atomic_write

STYLE: Any = {"font.size": 9, "axes.grid": True, "grid.alpha": 0.3, "axes.axisbelow": True}


def literal(text: str) -> str:
    """A text that matplotlib draws as it is: in names of files and missions, dollars enclose no formula."""
    return text.replace("$", r"\$")


def save(figure: Figure, path: Path, dpi: int = 110) -> None:
    """Write a PNG. Raises OSError; an older one is then still there."""
    with atomic_write(path) as fresh:
        figure.savefig(fresh, dpi=dpi, format="png")
