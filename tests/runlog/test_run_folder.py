"""A run folder read back, also one that was cut off."""

import math
import re
import struct
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.ranging.interface import Reject
from circnav_mav.pilot import TickRecord
from circnav_mav.runlog.run_folder import read_ticks, read_truth


def test_ticks_are_columns_and_an_empty_cell_is_no_number(run_folder):
    ticks = read_ticks(run_folder())
    assert len(ticks.time) == 601
    assert ticks.engaged_at == 10.0
    assert set(ticks.phases) == {"ready", "engaged"}
    assert np.isnan(ticks.numbers["turn_rate"][0])
    assert ticks.numbers["turn_rate"][-1] == -0.15
    assert ticks.modes[0] == "GUIDED"


def test_a_flight_that_never_engaged_has_no_such_moment(run_folder):
    assert read_ticks(run_folder(engaged=False)).engaged_at is None


def test_a_last_line_that_was_cut_off_is_left_out(run_folder):
    folder = run_folder()
    text = (folder / "ticks.csv").read_text()
    (folder / "ticks.csv").write_text(text[:-40])
    assert len(read_ticks(folder).time) == 600


def test_a_header_alone_is_a_flight_without_ticks(tmp_path):
    (tmp_path / "ticks.csv").write_text("time,phase,mode,r,turn_rate\n")
    ticks = read_ticks(tmp_path)
    assert len(ticks.time) == 0
    assert ticks.engaged_at is None


def test_the_truth_is_found_in_the_log_at_the_runs_own_time(run_folder, epoch_us):
    truth = read_truth(run_folder(), epoch_us)
    assert truth.time[[0, 1, -1]] == pytest.approx([0.0, 0.5, 300.0])
    assert truth.radius[[0, -1]] == pytest.approx([120.0, 101.0], abs=1e-3)
    assert (truth.target_north[0], truth.target_east[0]) == (5.0, 7.0)
    assert (truth.north[0], truth.east[0]) == pytest.approx((5.0, 127.0))


def test_a_log_of_a_real_vehicle_has_no_truth(run_folder, epoch_us, tmp_path):
    folder = run_folder(truth=False)
    beat = bytes(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(mavlink.MAVLink(None, srcSystem=1)))
    (folder / "flight.tlog").write_bytes(struct.pack(">Q", epoch_us) + beat)
    assert read_truth(folder, epoch_us) is None


@pytest.mark.parametrize("spoilt", [0, 9, 15])
def test_truth_that_is_no_number_is_left_out(tmp_path, epoch_us, spoilt):
    """Whoever reaches our port can send it."""
    numbers = [10.0 * at for at in range(16)]
    frames = [numbers, [math.nan if at == spoilt else number for at, number in enumerate(numbers)], numbers]
    log = b""
    for moment, told in enumerate(frames, epoch_us):
        message = mavlink.MAVLink_debug_float_array_message(0, b"SIM_TRUTH", 0, told + [0.0] * 42)
        log += struct.pack(">Q", moment) + bytes(message.pack(mavlink.MAVLink(None, srcSystem=1)))
    (tmp_path / "flight.tlog").write_bytes(log)
    assert read_truth(tmp_path, epoch_us).time == pytest.approx([0.0, 2e-6])


def test_every_column_of_the_ticks_is_described():
    text = (Path(__file__).parents[2] / "docs" / "logs.md").read_text(encoding="utf-8")
    rows = [row for row in text.split("## ticks.csv")[1].split("## MCAP")[0].splitlines() if row.startswith("| `")]
    described = [name for row in rows for name in re.findall(r"`(\w+)`", row.split("|")[1])]
    assert sorted(described) == sorted(field.name for field in fields(TickRecord))


def test_every_reason_to_reject_a_range_is_described():
    text = (Path(__file__).parents[2] / "docs" / "logs.md").read_text(encoding="utf-8")
    rows = [row for row in text.split("## Why a range was rejected")[1].splitlines() if row.startswith("| `")]
    described = [name for row in rows for name in re.findall(r"`(\w+)`", row.split("|")[1])]
    assert sorted(described) == sorted(reason.value for reason in Reject)


def test_the_truth_of_another_bundled_vehicle_on_the_link_is_left_out(run_folder, epoch_us):
    folder = run_folder()
    other = mavlink.MAVLink(None, srcSystem=2)
    frame = bytes(mavlink.MAVLink_debug_float_array_message(0, b"SIM_TRUTH", 0, [9.0] * 58).pack(other))
    log = folder / "flight.tlog"
    log.write_bytes(struct.pack(">Q", epoch_us) + frame + log.read_bytes())
    assert (read_truth(folder, epoch_us, 1).radius < 121).all()
    assert len(read_truth(folder, epoch_us).time) == 1, "without a system, the first that tells"
