"""Exit codes, the one way to refuse and to print, and what becomes of a line that cannot be printed."""

import io
import signal
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from typing import Any, TextIO

import click

from circnav_mav.foreign import printable

OUT_OF_MEMORY = ("failed to map segment", "can't start new thread", "cannot allocate memory")
"""How libraries and threads that find no memory are reported."""


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


def say(text: str, *, styled: str = "", err: bool = False) -> None:
    """Print lines, whatever they contain. styled: a beginning of our own with colors. err: on standard error."""
    click.echo(styled + "\n".join(map(printable, text.split("\n"))), err=err)


def in_one_line(error: BaseException) -> str:
    """Describe an exception that no command has foreseen: what the computer lacks, or where in the program it arose."""
    if isinstance(error, MemoryError) or any(words in str(error) for words in OUT_OF_MEMORY):
        return "out of memory"
    if isinstance(error, OSError):
        return f"{error.filename or 'this computer'}: {error.strerror or error}"
    at = traceback.extract_tb(error.__traceback__)[-1]
    return f"internal error: {type(error).__name__}: {error} ({Path(at.filename).name}:{at.lineno})"


@contextmanager
def refusing(place: str | Path, *kinds: type[Exception]) -> Iterator[None]:
    """Errors of these kinds in their own words, with the exit code of a vehicle or radio that is not there (`nobody`)
    or of bad usage; and a file that cannot be read or written, named by the error or by `place`. A reader of our output
    that went away (`| head`) is no file of ours: click ends the process quietly for it. Raises Refused."""
    try:
        yield
    except BrokenPipeError:
        raise
    except kinds as error:
        nobody = getattr(error, "nobody", False)
        raise Refused(str(error), Exit.NOTHING_HEARD if nobody else Exit.USAGE) from None
    except OSError as error:
        raise Refused(f"{error.filename or place}: {error.strerror or error}") from None


def mind_output() -> None:
    """From here on standard output that cannot be written, as on a full disk, is refused in one line wherever it
    happens; what cannot be told on standard error is told nobody. A name that the output cannot show is escaped."""
    sys.stdout, sys.stderr = _onto(_Refusing, sys.stdout), _onto(_Unheard, sys.stderr)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def outlive_terminal() -> None:
    """From here on a terminal that is closed, or an SSH session that drops, ends nothing: its signal is ignored, which
    the processes that we start inherit, and what nobody can read any more is printed without complaint."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    sys.stdout, sys.stderr = _onto(_Unheard, sys.stdout), _onto(_Unheard, sys.stderr)


class _Unheard(io.FileIO):
    """A descriptor that takes whatever is written, also when it has nowhere to go."""

    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except OSError:
            return len(data)


class _Refusing(io.FileIO):
    """A descriptor that says once whose fault it is when it cannot be written; `| head` that went away is nobody's."""

    _told = False

    def write(self, data: Any, /) -> int:
        try:
            return len(data) if self._told or not data else super().write(data)  # nothing at all is click's own trial
        except BrokenPipeError:
            raise
        except OSError as error:
            self._told = True
            raise Refused(f"standard output cannot be written: {error.strerror or error}") from None


def _onto(kind: type[io.FileIO], stream: TextIO) -> TextIO:
    """The same stream, onto a descriptor of this kind; one that is no file stays as it is."""
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    try:
        stream.flush()
        raw = kind(stream.fileno(), "w", closefd=False)
    except (OSError, ValueError):
        return stream
    return io.TextIOWrapper(
        raw if stream.write_through else io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
