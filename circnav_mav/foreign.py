"""Reading of external files and texts. Only regular files are opened, reads are bounded, and texts are printable."""

import errno
import io
import json
import os
import stat
from collections.abc import Generator
from pathlib import Path
from typing import Any, BinaryIO

MAX_BYTES = 10_000_000
"""Most bytes of a file that is read as a whole, such as a mission. Recorded flights are read by lines."""
MAX_LINE = 100_000
"""Most characters of a line of a CSV file."""


def printable(text: str) -> str:
    """Return a text as one line. Escape codes, line ends and lone surrogates, which a terminal or browser could act on,
    are written as Python escapes."""
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


def open_file(path: Path) -> BinaryIO:
    """Open a regular file. Reading anything else may never end: a pipe waits for a writer, /dev/zero has no end. Raises
    OSError."""
    mode = os.stat(path).st_mode
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):  # opening a folder fails by itself
        raise OSError(errno.EINVAL, "is not a regular file", str(path))
    return path.open("rb")


def read_bytes(path: Path, most: int = MAX_BYTES) -> bytes:
    """Contents of a file. Raises OSError, also for a file of more than `most` bytes."""
    with open_file(path) as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise OSError(errno.EFBIG, f"is larger than {most / 1e6:g} MB", str(path))
    return data


def read_text(path: Path) -> str:
    """Text of a file in UTF-8, without byte-order mark, its line ends as "\\n". Raises OSError, UnicodeError."""
    return io.StringIO(read_bytes(path).decode("utf-8-sig"), newline=None).read()


def read_lines(path: Path, errors: str = "strict") -> Generator[str, None, None]:
    """Lines of a long file in UTF-8, as the csv module takes them. Raises OSError, UnicodeError, and ValueError for a
    line that does not end."""
    with io.TextIOWrapper(open_file(path), encoding="utf-8-sig", errors=errors, newline="") as file:
        while line := file.readline(MAX_LINE + 1):
            if len(line) > MAX_LINE:
                raise ValueError(f"a line is longer than {MAX_LINE} characters")
            yield line


def read_json(path: Path) -> Any:
    """Values of a JSON file, their texts printable. Raises OSError, ValueError, RecursionError."""
    return _printable_values(json.loads(read_text(path)))


def _printable_values(value: Any) -> Any:
    if isinstance(value, dict):
        return {printable(key): _printable_values(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_printable_values(part) for part in value]
    return printable(value) if isinstance(value, str) else value
