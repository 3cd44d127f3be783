"""The radius errors of the emulator, compared with the firmware flights stored in flights.jsonl."""

from statistics import median

import pytest

from tests.tools import cells
from tests.tools.firmware.emulated import fly
from tests.tools.firmware.table import FLIGHTS

STORED = cells.read(FLIGHTS)


@pytest.mark.parametrize(
    "row",
    [
        "Plane, wind 8",
        pytest.param("PX4 copter, wind 3", marks=pytest.mark.nightly),
        pytest.param("PX4 plane by stick, wind 2", marks=pytest.mark.nightly),
    ],
)
def test_emulator_accuracy_matches_firmware(row: str) -> None:
    """The RMS radius error of a single emulated lap, 90 s after the start, is within a factor of
    two of the firmware's in its last laps."""
    real = [one for (name, _), one in STORED.items() if name == row]
    rms, turn_sd = (median(one[key] for one in real) for key in ("rms", "turn_sd"))
    flown = fly(row, 1, direction="counterclockwise", count=1, approach=90.0)
    assert flown.right
    assert rms / 2 < flown.rms < rms * 2
    assert turn_sd / 2 < flown.turn_sd < turn_sd * 2
