"""Exit codes, refusals and printing, including output that cannot be written."""

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
from circnav_mav.guidance.own_code import OwnCodeError, StuckCodeError

OUT_OF_MEMORY = ("failed to map segment", "can't start new thread", "cannot allocate memory")
"""Parts of error messages that mean out of memory."""


class Exit(IntEnum):
    """Exit codes of the process."""

    DONE = 0
    INTERNAL = 1
    USAGE = 2
    NOTHING_RECEIVED = 3
    ABORTED = 4
    NOT_RECORDED = 5
    INTERRUPTED = 130


class Refused(Exception):  # noqa: N818 - a refusal is not a program error
    """Refusal of a command: a one-line message for the user, and the exit code."""

    def __init__(self, text: str, exit: Exit = Exit.USAGE) -> None:
        super().__init__(text)
        self.exit = exit


def say(text: str, *, styled: str = "", err: bool = False) -> None:
    """Print lines, with unprintable characters escaped. styled: prefix with colors. err: print to
    standard error."""
    click.echo(styled + "\n".join(map(printable, text.split("\n"))), err=err)


def warn(*texts: str | None) -> None:
    """Print a warning for each text. None and empty texts are skipped."""
    for text in filter(None, texts):
        say(f"  WARNING    {text}")


def in_one_line(error: BaseException) -> str:
    """Describe an unexpected exception: the missing resource, or the error and its place in the
    program."""
    if isinstance(error, MemoryError) or any(words in str(error) for words in OUT_OF_MEMORY):
        return "out of memory"
    if isinstance(error, OwnCodeError | StuckCodeError):
        return str(error)
    if isinstance(error, ModuleNotFoundError):
        return f"the Python package {error.name} is not installed: install it with pip"
    if isinstance(error, OSError):
        return f"{error.filename or 'this computer'}: {error.strerror or error}"
    at = traceback.extract_tb(error.__traceback__)[-1]
    return f"internal error: {type(error).__name__}: {error} ({Path(at.filename).name}:{at.lineno})"


@contextmanager
def refusing(place: str | Path, *kinds: type[Exception]) -> Iterator[None]:
    """Convert errors of these kinds, and any OSError, to Refused. place: name of the file if an
    OSError has none.

    The exit code is NOTHING_RECEIVED for an error with the attribute `no_peer` (vehicle or radio
    not found), else USAGE.
    """
    try:
        yield
    # The program that reads the output has closed it, as `| head` does. Click ends the process
    # quietly.
    except BrokenPipeError:
        raise
    except kinds as error:
        no_peer = getattr(error, "no_peer", False)
        raise Refused(str(error), Exit.NOTHING_RECEIVED if no_peer else Exit.USAGE) from None
    except OSError as error:
        raise Refused(f"{error.filename or place}: {error.strerror or error}") from None


def mind_output() -> None:
    """Let a failed write to standard output, such as on a full disk, raise Refused. Ignore failed
    writes to standard error. Characters that the output cannot encode are escaped."""
    sys.stdout, sys.stderr = _onto(_RaisingErrors, sys.stdout), _onto(_IgnoringErrors, sys.stderr)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def outlive_terminal() -> None:
    """Keep running when the terminal closes or the SSH session drops: ignore SIGHUP, also in child
    processes, and failed writes."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    sys.stdout, sys.stderr = _onto(_IgnoringErrors, sys.stdout), _onto(_IgnoringErrors, sys.stderr)


class _IgnoringErrors(io.FileIO):
    """Output file that ignores failed writes."""

    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except OSError:
            return len(data)


class _RaisingErrors(io.FileIO):
    """Output file that raises Refused on the first failed write, and ignores later writes.
    BrokenPipeError is passed on."""

    _reported = False

    def write(self, data: Any, /) -> int:
        try:
            # Click checks the stream with an empty write.
            return len(data) if self._reported or not data else super().write(data)
        except BrokenPipeError:
            raise
        except OSError as error:
            self._reported = True
            raise Refused(f"standard output cannot be written: {error.strerror or error}") from None


def _onto(kind: type[io.FileIO], stream: TextIO) -> TextIO:
    """Return a stream like this one, but with an output file of this class. A stream without a file
    is returned unchanged."""
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
