"""The command line as a process of its own."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
QUICKSTART = str(ROOT / "config" / "quickstart.toml")
COPTER = str(ROOT / "config" / "arducopter.toml")
PATIENCE = 120.0
"""Time, s, after which a process counts as hanging; how long it takes on a busy machine is not judged."""


UNHURRIED = ("--set", "limits.stale_s=3.0", "--set", "limits.round_trip_s=5.0")
"""What lets a vehicle or a radio that stood still for a moment pass where it is not judged how late they are."""


def circnav(*arguments: str) -> subprocess.Popen[str]:
    """Start it; what it prints and its errors can be read."""
    return python("-m", "circnav_mav", *arguments)


def python(*arguments: str) -> subprocess.Popen[str]:
    """The same of any Python program, from the project's folder."""
    return subprocess.Popen(
        [sys.executable, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
