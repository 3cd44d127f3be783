"""Plots and report of a flight, drawn by a separate process."""

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import circnav_mav
from circnav_mav.cli.progress import progress


class Drawing:
    """Process that draws flight.png and report.html of a run folder.

    The flight's process never loads the plotting packages, and a signal to the flight's process
    does not interrupt the drawing. The drawing process starts at once and draws on request. If the
    flight's process is killed, the drawing process exits too.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._process: subprocess.Popen[str] | None = None
        with suppress(OSError):  # too little memory for another process
            self._process = subprocess.Popen(
                [
                    sys.executable,
                    "-P",
                    "-m",
                    "circnav_mav",
                    "report",
                    "--after-flight",
                    "--",
                    str(folder),
                ],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                env={**os.environ, "PYTHONPATH": str(Path(circnav_mav.__file__).parents[1])},
                start_new_session=True,
            )

    def draw(self) -> list[str]:
        """Draw the finished flight. Return a line for each file that could not be made."""
        process = self._process
        drawn = ""
        why = "no room for one more process"
        if process is not None:
            with progress("drawing flight.png and report.html"):
                drawn, errors = process.communicate("over\n")
            why = (
                errors.strip().rpartition("\n")[2].removeprefix("circnav: ")
                or f"exit code {process.returncode}"
            )
        failed = process is None or process.returncode != 0
        return drawn.splitlines() + failed * [
            f"{self._folder}: flight.png and report.html could not be made: {why}"
        ]
