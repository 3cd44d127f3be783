"""Small campaigns of the bundled mission."""

from pathlib import Path

import pytest

CONFIG = Path(__file__).parents[3] / "config"
START = """
"start.range_m" = {uniform = [40, 300]}
"start.bearing_deg" = {uniform = [0, 360]}
"start.heading_deg" = {uniform = [0, 360]}
"""


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a campaign file on the bundled mission and returns its path:
    write(vary, head)."""

    def write(vary, head="runs = 8\nseed = 3", starts=START):
        path = tmp_path / "campaign.toml"
        path.write_text(
            f'mission = "{CONFIG / "campaign_mission.toml"}"\n{head}\n[vary]\n{starts}{vary}\n'
        )
        return path

    return write
