"""Lock files that mark a folder as in use by a process. The lock ends with the process, even if it
is killed."""

from typing import IO, Any


def lock(file: IO[Any]) -> bool:
    """Lock an open file until it is closed. Return False if another process holds the lock. Return
    True on a system or disk without locks."""
    try:
        import fcntl  # not on Windows

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except (ImportError, OSError):
        pass
    return True
