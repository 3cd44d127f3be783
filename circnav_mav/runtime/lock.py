"""Lock files that mark a folder as in use by a process. The lock ends with the process, even if it is killed."""

from pathlib import Path
from typing import IO, Any

from circnav_mav.foreign import open_file


def lock(file: IO[Any], *, shared: bool = False) -> bool:
    """Lock an open file until it is closed. Return False if another process holds the lock. On a system or disk without
    locks, return True. shared: True for a lock that several readers may hold at once."""
    try:
        import fcntl  # not on Windows

        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except (ImportError, OSError):
        pass
    return True


def is_held(path: Path) -> bool:
    """True if a process holds the lock of a file. Raises OSError."""
    with open_file(path) as file:
        return not lock(file, shared=True)
