"""A flight with the bundled vehicle is identical to the last digit, under any load of the
computer."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from tests.command_line import circnav, undrawn

__all__ = ["circnav", "undrawn"]


@contextmanager
def busy() -> Iterator[None]:
    """Start one busy process for each processor."""
    hogs = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"])
        for _ in range(os.cpu_count() or 1)
    ]
    try:
        yield
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()


def test_flight_result_is_independent_of_load_and_simulation_speed(circnav, undrawn, tmp_path):
    def flown(name: str, *options: str) -> tuple[dict[str, object], bytes, bytes]:
        folder = tmp_path / name
        assert circnav("fly", "quickstart", "--duration", "6", "--out", folder, *options).done
        summary = json.loads((folder / "summary.json").read_text())
        assert summary.pop("epoch_us") > 0
        return summary, (folder / "ticks.csv").read_bytes(), (folder / "steps.csv").read_bytes()

    alone = flown("alone")
    with busy():
        beside = flown("beside", "--speed", "20")
    assert beside == alone
    assert alone[0]["setpoints_sent"] > 100
