"""Exit codes, and the one way to refuse."""

from collections.abc import Iterator
from contextlib import contextmanager
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


@contextmanager
def refusing(place: str | Path, *kinds: type[Exception]) -> Iterator[None]:
    """Errors of these kinds in their own words; and a file that cannot be read or written, named by the error or by
    `place`. A reader of our output that went away (`| head`) is no file of ours: click ends the process quietly for it.
    Raises Refused."""
    try:
        yield
    except BrokenPipeError:
        raise
    except kinds as error:
        raise Refused(str(error)) from None
    except OSError as error:
        raise Refused(f"{error.filename or place}: {error.strerror or error}") from None
