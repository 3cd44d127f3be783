"""Exit codes, and the one way to refuse."""

from enum import IntEnum


class Exit(IntEnum):
    """What the process tells its caller."""

    DONE = 0
    INTERNAL = 1
    USAGE = 2
    NOTHING_HEARD = 3
    ABORTED = 4
    INTERRUPTED = 130


class Refused(Exception):  # noqa: N818 - a refusal is not our error
    """The command cannot be carried out: one line for the person, and the exit code."""

    def __init__(self, text: str, exit: Exit = Exit.USAGE) -> None:
        super().__init__(text)
        self.exit = exit
