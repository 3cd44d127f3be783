"""A small mission, and a way to spoil it."""

from collections.abc import Callable
from pathlib import Path

import pytest

from circnav_mav.mission.load import Mission, parse_mission

TEXT = """\
name = "small"

[vehicle]
autopilot = "ardupilot"
kind = "copter"
speed_mps = 15.0
max_turn_rate_deg_s = 20.0

[orbit]
radius_m = 100.0
direction = "clockwise"

[guidance]
law = "smooth"

[ranging]
message = "distance_sensor"
rate_hz = 10.0
sigma_m = 0.5

[link]
endpoint = "udpin:127.0.0.1:14550"

[limits]
duration_s = 60.0
"""


@pytest.fixture
def text() -> str:
    return TEXT


@pytest.fixture
def mission() -> Callable[..., Mission]:
    """The small mission with overrides."""
    return lambda *overrides: parse_mission(TEXT, "small.toml", overrides)


@pytest.fixture
def config() -> Path:
    """The folder of the mission files that ship."""
    return Path(__file__).parents[2] / "config"
