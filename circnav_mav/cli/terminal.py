"""Where we print to: what becomes of a line that cannot be written, and of a flight whose terminal is closed."""

import io
import signal
import sys
from typing import Any, TextIO

from circnav_mav.cli.exits import Refused


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
    """A descriptor that says whose fault it is when it cannot be written, once. A reader that went away (`| head`) is
    nobody's: click ends the process quietly for it."""

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
