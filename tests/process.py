"""The command line as a process of its own, and ports that no other test on this machine has while they are used."""

import itertools
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[1]
QUICKSTART = str(ROOT / "config" / "quickstart.toml")
COPTER = str(ROOT / "config" / "arducopter.toml")
PATIENCE = 300.0
"""Time, s, after which a process counts as hanging; how long it takes on a busy machine is not judged."""


UNHURRIED = ("--set", "limits.stale_s=4.0")
"""What lets a vehicle or a radio that stood still for a moment pass where it is not judged how late they are."""


UNDRAWN = """
import importlib, types
from circnav_mav.cli import main
fly = importlib.import_module("circnav_mav.cli.fly")
fly.Drawing = lambda folder: types.SimpleNamespace(draw=list)
main()
"""


def circnav(*arguments: str, drawn: bool = True) -> subprocess.Popen[str]:
    """Start it; what it prints and its errors can be read. drawn: whether a flight ends with its pictures, which take a
    process some seconds."""
    return python(*(("-m", "circnav_mav") if drawn else ("-c", UNDRAWN)), *arguments)


def python(
    *arguments: str, stdin: int | None = None, stderr: int = subprocess.PIPE, **environment: str
) -> subprocess.Popen[str]:
    """The same of any Python program, from the project's folder."""
    return subprocess.Popen(
        [sys.executable, *arguments], stdin=stdin, stdout=subprocess.PIPE, stderr=stderr, text=True, cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
    )  # fmt: skip


@contextmanager
def running(process: subprocess.Popen[str]) -> Iterator[subprocess.Popen[str]]:
    """A process that ends with the block, however that ends."""
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def read_until(process: subprocess.Popen[str], words: str) -> str:
    """What a process prints up to some words; fails when it ends without them."""
    assert process.stdout is not None
    said = ""
    for line in process.stdout:
        said += line
        if words in said:
            return said
    raise AssertionError(f"{words!r} not in {said!r}")


def until(condition: Callable[[], bool]) -> None:
    """Wait for it; fails when it never comes true."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


FIRST, COUNT = 10_000, 2_000
"""Below those that a kernel gives out by itself (Linux from 32768, gVisor from 16000, macOS from 49152)."""
_turns = itertools.count(os.getpid())


@contextmanager
def reserved_port() -> Iterator[int]:
    """A port of this machine, free on UDP and TCP for whatever the test starts. It belongs to whoever has bound TCP
    port + COUNT, which the kernel takes back when that process ends, however it does."""
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
    """Whether no stranger to the tests has it."""
    with socket.socket() as tcp, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        return _taken(tcp, port) and _taken(udp, port)
