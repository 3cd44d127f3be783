"""A synthetic run folder."""

import csv
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

EPOCH_US = 1_790_000_000_000_000
RADIUS = 100.0
TURN = 0.15


def truth_frame(seconds: float, north: float, east: float, name: bytes = b"SIM_TRUTH") -> bytes:
    """Return the truth message of the bundled vehicle, with the positions of vehicle and target."""
    data = [0.0] * 58
    data[0], data[1], data[7], data[9], data[10] = north, east, TURN, 5.0, 7.0
    message = mavlink.MAVLink_debug_float_array_message(round(seconds * 1e6), name, 0, data)
    frame = bytes(message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1)))
    return struct.pack(">Q", EPOCH_US + round(seconds * 1e6)) + frame


def rewrite_ticks(folder: Path, change: Callable[[float, dict[str, str]], Any]) -> Path:
    """Rewrite ticks.csv: change(time, row as a dict) changes a row, or returns False to omit it."""
    with (folder / "ticks.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    kept = [row for row in rows if change(float(row["time"]), row) is not False]
    with (folder / "ticks.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(kept)
    return folder


@pytest.fixture
def run_folder(tmp_path: Path) -> Callable[..., Path]:
    """Run folder of 300 s around a target at (5, 7) m: engaged at 10 s, clockwise, at 120 m for 100
    s and then at 101 m."""

    def make(*, engaged: bool = True, truth: bool = True, clockwise: bool = True) -> Path:
        header = (
            "time,phase,measured,r,r_dot,demanded,turn_rate,saturated,yaw_rate_sent,mode,"
            "accepted,rejected"
        )
        lines = [header]
        log = b""
        for second in np.arange(0.0, 300.5, 0.5):
            on = engaged and second >= 10
            radius = 120.0 if second < 100 else 101.0
            turn = (-TURN if clockwise else TURN) if on else None
            numbers = (
                f"{radius:.6f},{radius:.6f},0.0,{turn or ''},{turn or ''},0,{-turn if turn else ''}"
            )
            lines.append(
                f"{second:.6f},{'engaged' if on else 'ready'},{numbers},GUIDED,{int(second)},0"
            )
            angle = (-1 if clockwise else 1) * TURN * second
            north, east = 5 + radius * np.sin(angle), 7 + radius * np.cos(angle)
            log += truth_frame(second, north, east) if truth else b""
        (tmp_path / "ticks.csv").write_text("\n".join(lines) + "\n")
        (tmp_path / "flight.tlog").write_bytes(log)
        return tmp_path

    return make
