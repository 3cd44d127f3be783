"""Atomic writing of files: a failure never leaves a partial file."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from math import isfinite
from pathlib import Path
from typing import Any


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to. On success it replaces `path`. Raises OSError."""
    # The number of the process: `report` may draw while the drawing after a flight is not done.
    fresh = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    try:
        yield fresh
        os.replace(fresh, path)
    except BaseException as error:
        with suppress(OSError):
            fresh.unlink(missing_ok=True)
        if isinstance(error, OSError) and str(error.filename or fresh) == str(fresh):
            # Report the name of the final file, not of the temporary one.
            error.filename = str(path)
            error.filename2 = None
        raise


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically. Characters that UTF-8 cannot encode, as in some folder names,
    become "?". Raises OSError."""
    with atomic_write(path) as fresh:
        fresh.write_text(text, encoding="utf-8", errors="replace")


def write_json(path: Path, what: Any) -> None:
    """Write plain values as a JSON file, atomically. Raises OSError."""
    write_text(path, json_text(what))


def json_text(what: Any) -> str:
    """Return plain values as JSON. NaN and infinity become null."""
    return json.dumps(_known_to_json(what), indent=2, allow_nan=False) + "\n"


def _known_to_json(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _known_to_json(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_known_to_json(part) for part in value]
    return None if isinstance(value, float) and not isfinite(value) else value
