"""The pictures and the report of a flight, drawn by a process beside it."""

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import circnav_mav


class Drawing:
    """flight.png and report.html of a run folder, made by a process of its own: what draws is never loaded into the
    flight's, and a signal that comes now ends neither; the exit code stays the flight's. It starts at once, and draws
    when it is told to; where the flight's process goes without a word, it goes, too."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._process: subprocess.Popen[str] | None = None
        with suppress(OSError):  # no room for one more process
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "circnav_mav", "report", "--after-flight", "--", str(folder)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                env={**os.environ, "PYTHONPATH": str(Path(circnav_mav.__file__).parents[1])},
                start_new_session=True,
            )

    def draw(self) -> list[str]:
        """Draw the flight, which is over; a line for each picture that could not be made."""
        process, drawn, why = self._process, "", "no room for one more process"
        if process is not None:
            drawn, errors = process.communicate("over\n")
            why = errors.strip().rpartition("\n")[2].removeprefix("circnav: ") or f"exit code {process.returncode}"
        failed = process is None or process.returncode != 0
        return drawn.splitlines() + failed * [f"{self._folder}: flight.png and report.html could not be made: {why}"]
