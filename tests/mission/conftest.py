"""A small mission, and changes that break it."""

from collections.abc import Callable
from pathlib import Path

import pytest

from circnav_mav.mission.load import parse_mission
from circnav_mav.mission.mission import Mission
from tests.small_mission import TEXT


@pytest.fixture
def text() -> str:
    return TEXT


@pytest.fixture
def mission() -> Callable[..., Mission]:
    """The small mission with overrides."""
    return lambda *overrides: parse_mission(TEXT, "small.toml", overrides)


@pytest.fixture
def config() -> Path:
    """The folder of the bundled mission files."""
    return Path(__file__).parents[2] / "config"
