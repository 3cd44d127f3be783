"""Ticks and truth read from complete and incomplete run folders, and their description in
docs/logs.md."""

import re
import struct
from math import nan
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.ranging.interface import Reject
from circnav_mav.pilot.record import COLUMNS
from circnav_mav.runlog.ticks import read_ticks, read_truth
from tests.runlog.conftest import EPOCH_US

LOGS = Path(__file__).parents[2] / "docs" / "logs.md"


def test_ticks_are_read_without_incomplete_last_line(run_folder):
    ticks = read_ticks(run_folder())
    assert (len(ticks.time), ticks.engaged_at, ticks.words["mode"][0]) == (601, 10.0, "GUIDED")
    assert set(ticks.words["phase"]) == {"ready", "engaged"}
    assert np.isnan(ticks.numbers["turn_rate"][0])
    assert ticks.numbers["turn_rate"][-1] == -0.15
    assert read_ticks(run_folder(engaged=False)).engaged_at is None
    folder = run_folder()
    text = (folder / "ticks.csv").read_text()
    (folder / "ticks.csv").write_text(text[:-40])
    assert len(read_ticks(folder).time) == 600
    (folder / "ticks.csv").write_text(text.splitlines()[0])
    assert (len(read_ticks(folder).time), read_ticks(folder).engaged_at) == (0, None)


def test_simulated_truth_is_read_with_times_of_run(run_folder):
    truth = read_truth(run_folder(), EPOCH_US)
    assert truth.time[[0, 1, -1]] == pytest.approx([0.0, 0.5, 300.0])
    assert truth.radius[[0, -1]] == pytest.approx([120.0, 101.0], abs=1e-3)
    assert (truth.target_north[0], truth.target_east[0]) == (5.0, 7.0)
    assert (truth.north[0], truth.east[0]) == pytest.approx((5.0, 127.0))


def truth(north, system=1, *, spoilt=None):
    """Return a vehicle's truth message with one invalid value."""
    numbers = [nan if at == spoilt else north for at in range(58)]
    return system, mavlink.MAVLink_debug_float_array_message(0, b"SIM_TRUTH", 0, numbers)


@pytest.mark.parametrize(
    ("messages", "system", "norths"),
    [
        ([(1, mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3))], None, None),
        ([truth(1.0), *(truth(2.0, spoilt=at) for at in (0, 9, 15)), truth(3.0)], None, [1.0, 3.0]),
        ([truth(9.0, 2), truth(1.0), truth(2.0)], 1, [1.0, 2.0]),
        ([truth(9.0, 2), truth(1.0), truth(2.0)], None, [9.0]),
    ],
    ids=["a real vehicle", "no numbers", "the vehicle that was flown", "the first sender"],
)
def test_simulated_truth_is_read_from_one_vehicle_only(tmp_path, messages, system, norths):
    """Any sender that reaches circnav's port can send truth messages."""
    frames = [
        bytes(message.pack(mavlink.MAVLink(None, srcSystem=sender))) for sender, message in messages
    ]
    (tmp_path / "flight.tlog").write_bytes(
        b"".join(struct.pack(">Q", EPOCH_US) + frame for frame in frames)
    )
    found = read_truth(tmp_path, EPOCH_US, system)
    assert (None if found is None else list(found.north)) == norths


def test_logs_page_has_declared_columns():
    rows = [f"| `{name}` | {column.unit} | {column.meaning} |" for name, column in COLUMNS.items()]
    section = LOGS.read_text(encoding="utf-8").split("## ticks.csv")[1].split("\n## ")[0]
    assert [row for row in section.splitlines() if row.startswith("| `")] == rows


def test_logs_page_describes_every_rejection_reason():
    section = LOGS.read_text(encoding="utf-8").split("## Why a range was rejected")[1]
    rows = [row for row in section.split("\n## ")[0].splitlines() if row.startswith("| `")]
    names = [name for row in rows for name in re.findall(r"`(\w+)`", row.split("|")[1])]
    assert sorted(names) == sorted(reason.value for reason in Reject)
