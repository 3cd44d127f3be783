"""Ports that no other test on this machine has, nor gets while they are used, in whatever process it runs."""

import itertools
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager

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
