"""Exit codes, and the one way to refuse."""

from enum import IntEnum
from pathlib import Path


class Exit(IntEnum):
    """What the process tells its caller."""

    DONE = 0
    INTERNAL = 1
    USAGE = 2
    NOTHING_HEARD = 3
    ABORTED = 4
    NOT_RECORDED = 5
    INTERRUPTED = 130


class Refused(Exception):  # noqa: N818 - a refusal is not our error
    """The command cannot be carried out: one line for the person, and the exit code."""

    def __init__(self, text: str, exit: Exit = Exit.USAGE) -> None:
        super().__init__(text)
        self.exit = exit


def check_named(option: str, value: str | None) -> None:
    """An empty name, as of a variable of a script that was never set, would mean the current folder. Raises Refused."""
    if value == "":
        raise Refused(f"{option}: is empty, give it a name")


def cannot(place: str | Path, error: OSError) -> Exception:
    """A file that cannot be read or written as the line to raise, named by the error or else by `place`. A reader of
    our output that went away (`| head`) is no file of ours: click ends the process quietly for it."""
    if isinstance(error, BrokenPipeError):
        return error
    return Refused(f"{error.filename or place}: {error.strerror or error}")
