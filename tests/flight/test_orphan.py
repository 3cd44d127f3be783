"""The bundled vehicle does not outlive the application that started it."""

import signal
import time
from pathlib import Path

import pytest

from tests.process import PATIENCE, QUICKSTART, circnav


def test_a_killed_application_leaves_no_vehicle_behind(tmp_path: Path) -> None:
    process = circnav("fly", QUICKSTART, "--out", str(tmp_path))
    assert process.stdout is not None
    process.stdout.readline()
    assert vehicles(tmp_path)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    end = time.monotonic() + PATIENCE
    while vehicles(tmp_path):
        assert time.monotonic() < end
        time.sleep(0.05)


def vehicles(folder: Path) -> list[str]:
    """Processes that fly the mission of a run folder."""
    return [
        entry.name
        for entry in Path("/proc").iterdir()
        if entry.name.isdecimal() and f"{folder}/mission.toml".encode() in read(entry / "cmdline")
    ]


def read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_while_the_vehicle_starts_ends_both(number: int, tmp_path: Path) -> None:
    process = circnav("fly", QUICKSTART, "--out", str(tmp_path))
    while not vehicles(tmp_path):
        assert process.poll() is None
        time.sleep(0.005)
    process.send_signal(number)
    assert process.wait(PATIENCE) == 130
    assert vehicles(tmp_path) == []
