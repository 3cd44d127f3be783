"""Memory, descriptors and disk space that a flight takes before the engagement."""

import json
import os
import resource
import subprocess
from contextlib import closing

import pytest

from circnav_mav.runtime.reserve import DESCRIPTORS, Reserve
from tests.process import python


@pytest.fixture
def no_descriptor_left():
    """Limit the descriptors to those that are open when the returned function is called."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    fillers = []

    def limit():
        fillers.append(os.dup(0))
        resource.setrlimit(resource.RLIMIT_NOFILE, (fillers[-1] + 1, hard))
        with pytest.raises(OSError, match="Too many open files"):
            while True:
                fillers.append(os.dup(0))

    yield limit
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    for filler in fillers:
        os.close(filler)


def test_reserved_descriptor_writes_file_when_no_other_is_free(tmp_path, no_descriptor_left):
    reserve = Reserve(tmp_path)
    no_descriptor_left()
    with pytest.raises(OSError, match="Too many open files"):
        (tmp_path / "other").open("w")
    reserve.write(tmp_path / "summary.json", "{}\n")
    reserve.release()
    with (tmp_path / "other").open("w"):
        reserve.close()
    assert {one.name: one.stat().st_size for one in tmp_path.iterdir()} == {
        "other": 0,
        "summary.json": 3,
    }


def test_too_few_descriptors_are_refused_before_flight(tmp_path, no_descriptor_left):
    no_descriptor_left()
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft + 3, hard))
    with pytest.raises(OSError, match=f"{DESCRIPTORS} more file descriptors are needed"):
        Reserve(tmp_path)
    assert not list(tmp_path.iterdir())


def test_summary_is_written_on_full_disk(tmp_path):
    """The run folder is on a file system of 6 MB, which another program fills in flight."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=6m", "tmpfs", str(disk)]
    if os.geteuid() or subprocess.run(mount, check=False).returncode:
        pytest.skip("needs the right to mount a file system")
    try:
        with closing(Reserve(disk)) as reserve:
            with pytest.raises(OSError, match="No space left"):
                (disk / "other").write_bytes(bytes(6_000_000))
            with pytest.raises(OSError, match="No space left"):
                (disk / "plain.json").write_text("{}\n" * 2000)
            reserve.write(disk / "summary.json", json.dumps({"outcome": "completed"}))
        assert json.loads((disk / "summary.json").read_text()) == {"outcome": "completed"}
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_guidance_needs_no_more_memory_than_at_start():
    """The first product of matrices once allocated 32 MB in flight. A limit ended the process by a
    signal, without a safe setpoint."""
    code = """
import resource
from pathlib import Path
from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import OutputMode
from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.types import OwnMotion, RangeSample
from circnav_mav.runtime.reserve import take_memory
settings = load_mission("config/quickstart.toml", ())
take_memory(settings)
size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (size, size))
estimator = ESTIMATORS["auto"](settings.tuning.estimation)
kept = [bytes(300) for _ in range(20_000)]
for n in range(300):
    estimator.move(OwnMotion(0.1 * n, 0.015 * n, 0.15, airspeed=15.0))
    estimator.observe(RangeSample(stamp=0.1 * n, time=0.1 * n, r=100.0 + n % 7, sigma=0.5))
    estimator.at(0.1 * n)
print("flown", flush=True)
"""
    process = python("-c", code)
    printed, _ = process.communicate()
    assert (process.returncode, printed) == (0, "flown\n")
