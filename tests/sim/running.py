"""The emulator as a process of its own."""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

from tests.process import python


@contextmanager
def running(*arguments: str, module: str = "sim") -> Iterator[subprocess.Popen[str]]:
    process = python("-m", module, *arguments)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()
