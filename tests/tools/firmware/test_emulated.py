"""The emulator flies as truly as the firmware did, by the flights that are kept in flights.jsonl."""

from statistics import mean, median

import pytest

from tests.tools.firmware.emulated import fly
from tests.tools.firmware.table import FLIGHTS, told

KEPT = told(FLIGHTS)


@pytest.mark.parametrize("row", ["Plane, wind 8", "PX4 copter, wind 3", "PX4 plane by stick, wind 2"])
def test_a_flight_of_the_emulator_is_as_true_as_the_firmwares(row: str) -> None:
    """Within a factor of two: one lap of two seeds each."""
    real = [one for (name, _), one in KEPT.items() if name == row]
    rms, turn_sd = (median(one[key] for one in real) for key in ("rms", "turn_sd"))
    flown = [fly(row, seed, direction="counterclockwise", count=1) for seed in (1, 2)]
    assert all(one.right for one in flown)
    assert rms / 2 < mean(one.rms for one in flown) < rms * 2
    assert turn_sd / 2 < mean(one.turn_sd for one in flown) < turn_sd * 2
