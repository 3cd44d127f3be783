"""The command line as a separate process, and ports that are reserved for one test at a time on
this machine."""

import itertools
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[1]
QUICKSTART = str(ROOT / "config" / "quickstart.toml")
COPTER = str(ROOT / "config" / "arducopter.toml")
PATIENCE = 300.0
"""Time, s, after which a process is regarded as hanging. It is long, because the test machine may
be busy."""


UNHURRIED = ("--set", "limits.stale_s=4.0")
"""Mission override for tests that do not check delays: accepts data of a vehicle or radio that was
stopped for a short time by a busy machine."""


UNDRAWN = """
import importlib, types
from circnav_mav.cli import main
fly = importlib.import_module("circnav_mav.cli.fly")
fly.Drawing = lambda folder: types.SimpleNamespace(draw=list)
main()
"""


def circnav(*arguments: str, drawn: bool = True) -> subprocess.Popen[str]:
    """Start circnav with readable output and errors. drawn: True to draw the pictures of a flight,
    which takes some seconds."""
    return python(*(("-m", "circnav_mav") if drawn else ("-c", UNDRAWN)), *arguments)


def python(
    *arguments: str, stdin: int | None = None, stderr: int = subprocess.PIPE, **environment: str
) -> subprocess.Popen[str]:
    """Start a Python program in the same way, from the folder of the repository."""
    return subprocess.Popen(
        [sys.executable, *arguments],
        stdin=stdin,
        stdout=subprocess.PIPE,
        stderr=stderr,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
    )


@contextmanager
def running(process: subprocess.Popen[str]) -> Iterator[subprocess.Popen[str]]:
    """Context manager that ends a process at the end of the block, also after an exception. A
    process that is regarded as hanging ends earlier, so that nothing waits for its output."""
    limit = threading.Timer(PATIENCE, process.kill)
    limit.start()
    try:
        yield process
    finally:
        limit.cancel()
        process.kill()
        process.communicate()


def read_until(process: subprocess.Popen[str], words: str) -> str:
    """Return the output of a process up to these words. Fails if the process ends without them."""
    assert process.stdout is not None
    said = ""
    for line in process.stdout:
        said += line
        if words in said:
            return said
    raise AssertionError(f"{words!r} not in {said!r}")


def resident_mb(process: int | str = "self") -> float:
    """Return the resident memory of a process, by its id, MB."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def until(condition: Callable[[], bool]) -> None:
    """Wait until a condition is true. Fails after PATIENCE."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


FIRST = 10_000
COUNT = 2_000
"""First port and number of the reserved ports. They are below the ports that kernels assign
automatically (Linux from 32768, gVisor from 16000, macOS from 49152)."""
_turns = itertools.count(os.getpid())


@contextmanager
def reserved_port() -> Iterator[int]:
    """Reserve a port of this machine that is free on UDP and TCP. A process owns a port while it
    has bound TCP port + COUNT, which the kernel frees when the process ends."""
    while True:
        port = FIRST + next(_turns) % COUNT
        with socket.socket() as claim:
            if _taken(claim, port + COUNT) and _free(port):
                yield port
                return


def _taken(by: socket.socket, port: int) -> bool:
    try:
        by.bind(("127.0.0.1", port))
    except OSError:
        return False
    return True


def _free(port: int) -> bool:
    """True if the port is free of programs outside the tests."""
    with socket.socket() as tcp, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        return _taken(tcp, port) and _taken(udp, port)
