"""Port of the live page: how the next flight gets it from the page of a flight that is over."""

import os
import socket
import sys


def release_name(port: int) -> str | None:
    """Return the address of the local socket by which a finished page is asked to release its port. None on systems
    other than Linux: they have no abstract addresses, which need no file."""
    return f"\0circnav-live-page-{os.getuid()}-{port}" if sys.platform == "linux" else None


def release(port: int, patience: float) -> bool:
    """Ask a finished page to release the port, and wait until it has. Return False if there is none. patience: s."""
    name = release_name(port)
    if name is None:
        return False
    with socket.socket(socket.AF_UNIX) as asked:
        asked.settimeout(patience)
        try:
            asked.connect(name)
            return not asked.recv(1)  # its end: the process is gone
        except OSError:
            return False
