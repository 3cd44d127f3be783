"""Settings of all tests.

Property tests draw the same examples on every machine and have no time limit. No two tests share a
port. Each process computes on one core.
"""

import os
import sys
from collections.abc import Iterator

import pytest
from hypothesis import settings

from tests.process import reserved_port

# set before numpy is imported: threads of several processes would wait for the same cores
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Bytecode is written even if the environment forbids it. Otherwise every worker and every process
# of the tests would compile the program again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
settings.register_profile("seeded", derandomize=True, deadline=None, database=None)
settings.load_profile("seeded")


def pytest_xdist_auto_num_workers() -> int:
    """Return one worker more than processors: while one worker waits for a process or a socket,
    another one computes."""
    return (os.cpu_count() or 1) + 1


@pytest.fixture
def port() -> Iterator[int]:
    """A free port, UDP and TCP."""
    with reserved_port() as number:
        yield number
