"""What holds for every test: property tests draw the same examples on every machine, a slow machine is no failure, and
no two tests share a port."""

from collections.abc import Iterator

import pytest
from hypothesis import settings

from tests.ports import reserved_port

settings.register_profile("seeded", derandomize=True, deadline=None, database=None)
settings.load_profile("seeded")


@pytest.fixture
def port() -> Iterator[int]:
    """A port that is nobody else's, UDP and TCP."""
    with reserved_port() as number:
        yield number
