"""A flight outlives the terminal that it was started from."""

import io
import signal
import sys
from typing import Any, TextIO


def outlive_terminal() -> None:
    """From here on a terminal that is closed, or an SSH session that drops, ends nothing: its signal is ignored, which
    the processes that we start inherit, and what nobody can read any more is printed without complaint."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    sys.stdout, sys.stderr = _patient(sys.stdout), _patient(sys.stderr)


class _Unheard(io.FileIO):
    """A descriptor that takes whatever is written, also when it has nowhere to go."""

    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except OSError:
            return len(data)


def _patient(stream: TextIO) -> TextIO:
    """The same stream, onto an _Unheard; one that is no file stays as it is."""
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    try:
        stream.flush()
        raw = _Unheard(stream.fileno(), "w", closefd=False)
    except (OSError, ValueError):
        return stream
    return io.TextIOWrapper(
        raw if stream.write_through else io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
