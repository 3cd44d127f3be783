"""The emulator flies as truly as the firmware did: docs/firmware.md has the firmware's figures."""

import re

import pytest

from tests.process import ROOT
from tests.tools.firmware.emulated import fly

PAGE = (ROOT / "docs" / "firmware.md").read_text()


@pytest.mark.parametrize("row", ["Plane, wind 8", "PX4 copter, wind 3", "PX4 plane by stick, wind 2"])
def test_a_flight_of_the_emulator_is_as_true_as_the_firmwares(row: str) -> None:
    """Within a factor of two, for it is one lap."""
    found = re.search(rf"^\| {re.escape(row)} \| ([\d.]+), [\d.]+ \| ([\d.]+), [\d.]+ \|", PAGE, re.MULTILINE)
    assert found is not None
    rms, turn_sd = map(float, found.groups())
    flown = fly(row, 1, direction="counterclockwise", count=1)
    assert flown.right
    assert rms / 2 < flown.rms < rms * 2
    assert turn_sd / 2 < flown.turn_sd < turn_sd * 2
