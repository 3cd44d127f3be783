"""Settings of all tests.

Property tests draw the same examples on every machine, and a slow machine is no failure. No two
tests share a port. Each process computes on one core.
"""

import os
from collections.abc import Iterator

import pytest
from hypothesis import settings

from tests.process import reserved_port

# before numpy: its threads would wait for each other's cores
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
settings.register_profile("seeded", derandomize=True, deadline=None, database=None)
settings.load_profile("seeded")


def pytest_xdist_auto_num_workers() -> int:
    """One worker more than processors: while one waits for a process or a socket, another
    computes."""
    return (os.cpu_count() or 1) + 1


@pytest.fixture
def port() -> Iterator[int]:
    """A free port, UDP and TCP."""
    with reserved_port() as number:
        yield number
