"""Plots and report of a flight, drawn by a separate process."""

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import circnav_mav
from circnav_mav.cli.exits import say
from circnav_mav.cli.progress import progress

LOG = "report.log"
"""Output of the drawing process. The file stays in the run folder only if drawing failed."""


class Drawing:
    """Process that draws flight.png and report.html of a run folder.

    The flight's process never loads the plotting packages, and a signal to the flight's process
    does not interrupt the drawing. The drawing process starts at once and draws on request. If the
    flight's process is killed before the request, the drawing process exits too.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._process: subprocess.Popen[str] | None = None
        self._problem = ""
        try:
            with (folder / LOG).open("w") as log:
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
                    stdout=log,
                    stderr=log,
                    text=True,
                    env={**os.environ, "PYTHONPATH": str(Path(circnav_mav.__file__).parents[1])},
                    start_new_session=True,
                )
        except OSError as error:  # too little memory for another process, or a full disk
            self._problem = error.strerror or str(error)

    def draw(self) -> list[str]:
        """Draw the finished flight. Return a line for each file that could not be made.

        The job of an interactive shell ends at once, and the drawing process continues. All other
        programs wait for the files.
        """
        process = self._process
        if process is None:
            return [self._failed(self._problem)]
        assert process.stdin is not None
        with suppress(OSError):  # the drawing process has died, and its log has the reason
            process.stdin.write("over\n")
            process.stdin.close()
        if is_job_of_shell():
            say(f"  report     {self._folder / 'report.html'}, ready in a few seconds")
            return []
        with progress("drawing flight.png and report.html"):
            process.wait()
        errors = ""
        with suppress(OSError):
            errors = (self._folder / LOG).read_text(encoding="utf-8", errors="replace").strip()
        if process.returncode == 0:
            return errors.splitlines()
        why = errors.rpartition("\n")[2].removeprefix("circnav: ")
        return [self._failed(why or f"exit code {process.returncode}")]

    def _failed(self, why: str) -> str:
        return f"{self._folder}: flight.png and report.html could not be made: {why}"


def is_job_of_shell() -> bool:
    """True if an interactive shell has started this process as its foreground job. A script, a pipe
    and a service manager may use the files as soon as the command ends."""
    # An interactive shell gives each job a process group of its own, and the terminal to the group.
    # A session leader is the first process of its terminal or container, which ends with it.
    try:
        group = os.tcgetpgrp(sys.stdout.fileno())
    except (OSError, ValueError):  # no terminal
        return False
    return group == os.getpid() != os.getsid(0)
