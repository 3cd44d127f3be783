"""Some minutes of the soak flight with the wraps of the counters, and a small part of the fuzzing.
The programs tests.tools.faults.soak and tests.tools.faults.fuzz run 10 hours and 1,000,000
frames."""

from pathlib import Path

import pytest

from circnav_mav.pilot.mission_state import Phase
from circnav_mav.runlog.tlog import read_tlog
from tests.flight.lockstep import rms_error
from tests.flight.recorded import EPOCH_US, recorded_flight
from tests.frames import read
from tests.tools.fault_link.frames import message_id
from tests.tools.faults.files import assault_files
from tests.tools.faults.fuzz import ROWS, fly
from tests.tools.faults.soak import WRAP, flown

ATTITUDE = 30
RANGE = 132


def boot_times(tlog: Path, number: int) -> list[tuple[float, int]]:
    """Return time, s, and time since boot, ms, of each frame of a message."""
    return [
        ((at - EPOCH_US) / 1e6, read(frame).time_boot_ms)
        for at, frame in read_tlog(tlog)
        if message_id(frame) == number
    ]


def test_circle_is_kept_when_millisecond_counters_wrap(tmp_path: Path) -> None:
    """The autopilot's counter wraps at 45 s, the radio's at 50 s. Neither wrap may be treated as a
    reboot, a clock jump or an outage."""
    clocks = (f"sim.vehicle.boot_age_s={WRAP - 45}", f"sim.ranging.clock_offset_s={WRAP - 50}")
    flight = recorded_flight(tmp_path, "arducopter", 'guidance.law="auto"', *clocks)
    truths = []
    phases = set()

    def watch(_: object) -> None:
        if flight.now > 40:
            truths.append(flight.vehicle.truth)
            phases.add(flight.pilot.mission.phase)

    flight.fly(65, watch)
    assert flight.recorder is not None
    flight.recorder.close()
    assert phases == {Phase.ENGAGED}
    assert rms_error(truths, 30.0) < 0.05 * 30.0 / 2
    assert flight.pilot.session.vehicle.reboots == 0
    assert flight.pilot.tracker.ranging.rejected.total() <= 1
    for number, wraps_at in ((ATTITUDE, 45), (RANGE, 50)):
        stamps = boot_times(tmp_path / "flight.tlog", number)
        assert all((stamp < 2**31) == (at > wraps_at - 0.01) for at, stamp in stamps)
        assert len(stamps) > 600


@pytest.mark.nightly
def test_memory_of_flight_does_not_grow(tmp_path: Path) -> None:
    """Checked over the last 150 s. A growth of 3 kB/s, which two queues of the bundled vehicle once
    had, would be 0.45 MB."""
    memory = [
        mb for at, mb in flown(tmp_path / "run", "quickstart", "auto", 300.0) if 150 < at < 300
    ]
    assert len(memory) > 3
    assert max(memory) - memory[0] < 0.3


@pytest.mark.parametrize("row", ROWS)
def test_hostile_frames_cause_no_unsafe_setpoint_or_exception(row: str) -> None:
    found = fly(row, seed=2, frames=1_000)
    assert found["broken"] == []
    assert found["counts"]["engaged steps"] > 0


def test_damaged_files_cause_no_unexpected_exception() -> None:
    assert assault_files(5, seed=2) == []
