"""The emulator flies as truly as the firmware did: docs/firmware.md has the firmware's figures."""

import re
from statistics import mean

import pytest

from tests.process import ROOT
from tests.tools.firmware.emulated import fly

PAGE = (ROOT / "docs" / "firmware.md").read_text()


@pytest.mark.parametrize("row", ["Plane, wind 8", "PX4 copter, wind 3", "PX4 plane by stick, wind 2"])
def test_a_flight_of_the_emulator_is_as_true_as_the_firmwares(row: str) -> None:
    """Within a factor of two, for it is one lap of two seeds each."""
    found = re.search(rf"^\| {re.escape(row)} \| ([\d.]+), [\d.]+ \| ([\d.]+), [\d.]+ \|", PAGE, re.MULTILINE)
    assert found is not None
    rms, turn_sd = map(float, found.groups())
    flown = [fly(row, seed, direction="counterclockwise", count=1) for seed in (1, 2)]
    assert all(one.right for one in flown)
    assert rms / 2 < mean(one.rms for one in flown) < rms * 2
    assert turn_sd / 2 < mean(one.turn_sd for one in flown) < turn_sd * 2
