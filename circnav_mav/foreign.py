"""Reading of external files and texts. Only regular files are opened, reads are bounded, and texts
are printable."""

import errno
import io
import json
import os
import stat
from collections.abc import Generator
from pathlib import Path
from typing import Any, BinaryIO

MAX_BYTES = 10_000_000
"""Maximum size of a file that is read as a whole, bytes. Recorded flights are read by lines."""
MAX_LINE = 100_000
"""Maximum length of a line of a CSV file, characters."""


def printable(text: str) -> str:
    """Return a text as one line. Escape codes, line ends and lone surrogates, which a terminal or
    browser could act on, are written as Python escapes."""
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


def open_file(path: Path) -> BinaryIO:
    """Open a regular file. Reading anything else may never end: a pipe waits for a writer,
    /dev/zero has no end. Raises OSError."""
    mode = os.stat(path).st_mode
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):  # opening a folder raises anyway
        raise OSError(errno.EINVAL, "is not a regular file", str(path))
    return path.open("rb")


def read_bytes(path: Path, most: int = MAX_BYTES) -> bytes:
    """Return the contents of a file. Raises OSError, also if it is larger than `most` bytes."""
    with open_file(path) as file:
        # Compare the size first: `read(most)` would allocate `most` bytes for the smallest file.
        if os.fstat(file.fileno()).st_size > most:
            raise OSError(errno.EFBIG, f"is larger than {most / 1e6:g} MB", str(path))
        return file.read()


def read_text(path: Path) -> str:
    """Return the text of a UTF-8 file without byte-order mark, line ends as "\\n". Raises OSError,
    UnicodeError."""
    return io.StringIO(read_bytes(path).decode("utf-8-sig"), newline=None).read()


def read_lines(path: Path, errors: str = "strict") -> Generator[str, None, None]:
    """Yield the lines of a long UTF-8 file, for the csv module. Raises OSError, UnicodeError, and
    ValueError for a line longer than MAX_LINE."""
    with io.TextIOWrapper(open_file(path), encoding="utf-8-sig", errors=errors, newline="") as file:
        while line := file.readline(MAX_LINE + 1):
            if len(line) > MAX_LINE:
                raise ValueError(f"a line is longer than {MAX_LINE} characters")
            yield line


def read_json(path: Path) -> Any:
    """Return the values of a JSON file, with printable texts. Raises OSError, ValueError,
    RecursionError."""
    return _printable_values(json.loads(read_text(path)))


def _printable_values(value: Any) -> Any:
    if isinstance(value, dict):
        return {printable(key): _printable_values(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_printable_values(part) for part in value]
    return printable(value) if isinstance(value, str) else value
