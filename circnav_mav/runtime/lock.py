"""Files by which processes tell each other that a folder is in use. The lock goes with the process, however it ends."""

from pathlib import Path
from typing import IO, Any

from circnav_mav.foreign import open_file


def lock(file: IO[Any], *, shared: bool = False) -> bool:
    """Hold an open file until it is closed; False where another process does. shared: beside others that only look. A
    system or disk without locks is taken as it is."""
    try:
        import fcntl  # not on Windows

        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except (ImportError, OSError):
        pass
    return True


def is_held(path: Path) -> bool:
    """Whether a process holds a file. Raises OSError."""
    with open_file(path) as file:
        return not lock(file, shared=True)
