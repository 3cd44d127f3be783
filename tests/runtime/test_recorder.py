"""The run folder: read back by pymavlink's own log reader, and a disk that fails in every way."""

import csv
import struct
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot import TickRecord
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.runlog.loop_steps import recorded_steps
from circnav_mav.runlog.ticks import read_ticks
from circnav_mav.runtime.recorder import TICK_COLUMNS, LoopStep, Recorder, RecorderError

EPOCH_US = 1_790_000_000_000_000


def frames(count):
    speaker = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    made = []
    for i in range(count):
        speaker.seq = i % 256
        made.append(bytes(mavlink.MAVLink_attitude_message(i, 0.1 * i, 0, 0, 0, 0, 0).pack(speaker)))
    return made


def tick(**changes):
    values = dict.fromkeys(TICK_COLUMNS, None) | {
        "time": 1.25, "phase": Phase.ENGAGED, "saturated": True, "mode": "GUIDED", "accepted": 7, "rejected": 2,
        "r": 101.23456789, "turn_gain": 1.0, "turn_delay": 0.4, "gain_share": 1.0,
    }  # fmt: skip
    return TickRecord(**(values | changes))


@pytest.fixture
def recorder(tmp_path):
    made = Recorder(tmp_path / "run", "name = 'x'\n")
    made.start(EPOCH_US)
    yield made
    made.close()


def test_the_mission_is_kept_as_flown(tmp_path):
    Recorder(tmp_path / "deep" / "run", "name = 'Zürich'\n")
    assert (tmp_path / "deep" / "run" / "mission.toml").read_text(encoding="utf-8") == "name = 'Zürich'\n"


def test_the_tlog_is_read_back_by_pymavlinks_own_reader(recorder):
    """Frame by frame, with the moment of each."""
    sent = frames(40)
    for i, frame in enumerate(sent):
        recorder.step(LoopStep(0.05 * i, said=[frame]))
    recorder.close()
    log = mavutil.mavlink_connection(str(recorder.folder / "flight.tlog"), dialect="all")
    back = []
    while (message := log.recv_match(type="ATTITUDE")) is not None:
        back.append(message)
    log.close()
    assert [message.time_boot_ms for message in back] == list(range(40))
    assert [message._timestamp for message in back] == pytest.approx([EPOCH_US / 1e6 + 0.05 * i for i in range(40)])
    assert {(message.get_srcSystem(), message.get_srcComponent()) for message in back} == {(7, 1)}
    assert recorder.problem is None


def test_the_tlog_is_big_endian_microseconds_and_the_raw_frame(recorder):
    (frame,) = frames(1)
    recorder.step(LoopStep(1.000001, said=[frame]))
    recorder.close()
    assert (recorder.folder / "flight.tlog").read_bytes() == struct.pack(">Q", EPOCH_US + 1_000_001) + frame


def test_every_tick_is_a_line_and_every_field_a_column(recorder):
    recorder.ticks([tick(), tick(time=1.3, phase=Phase.HOLDING, saturated=False, r=None)])
    recorder.close()
    with (recorder.folder / "ticks.csv").open(newline="", encoding="utf-8") as file:
        first, second = csv.DictReader(file)
    assert tuple(first) == TICK_COLUMNS
    assert {"time", "phase", "r", "r_dot", "turn_rate", "yaw_rate_sent", "range_age", "mode"} <= set(TICK_COLUMNS)
    assert (first["time"], first["phase"], first["saturated"], first["mode"]) == ("1.250000", "engaged", "1", "GUIDED")
    assert (first["r"], first["accepted"], first["r_dot"]) == ("101.234568", "7", "")
    assert (second["phase"], second["saturated"], second["r"]) == ("holding", "0", "")


def test_what_is_written_is_on_the_disk_within_a_second(recorder):
    """Whatever happens to the process, at most the last half second is lost."""
    recorder.step(LoopStep(0.5, said=frames(30)))
    wait_for(lambda: (recorder.folder / "flight.tlog").stat().st_size > 0)
    recorder.ticks([tick()])
    wait_for(lambda: "engaged" in (recorder.folder / "ticks.csv").read_text())


def wait_for(true, patience=3.0):
    import select
    import time

    end = time.monotonic() + patience
    while not true():
        assert time.monotonic() < end
        select.select([], [], [], 0.01)


@pytest.mark.parametrize("place", ["/proc/circnav", "/dev/null/run"])
def test_a_folder_that_cannot_be_made_is_told_in_one_line(place):
    with pytest.raises(RecorderError) as caught:
        Recorder(Path(place), "")
    assert str(caught.value).startswith(f"{place}: cannot be written: ")
    assert "\n" not in str(caught.value)


def test_a_file_in_the_way_of_the_folder_is_told_in_one_line(tmp_path):
    (tmp_path / "run").write_text("a file")
    with pytest.raises(RecorderError, match=r"run: cannot be written: File exists$"):
        Recorder(tmp_path / "run", "")


@pytest.mark.parametrize(("file", "mode"), [("_tlog", "wb"), ("_ticks", "w"), ("_turns", "w")])
def test_a_disk_that_fills_up_in_flight_is_noted_and_the_flight_goes_on(tmp_path, file, mode):
    """/dev/full: every write fails with "no space left on device"."""
    recorder = Recorder(tmp_path, "")
    setattr(recorder, file, Path("/dev/full").open(mode))  # noqa: SIM115
    recorder.start(EPOCH_US)
    for i in range(200):
        recorder.step(LoopStep(0.05 * i, said=frames(5)))
        recorder.ticks([tick()])
    recorder.close()
    assert recorder.problem == f"{tmp_path}: recording stopped: No space left on device"


@pytest.mark.parametrize("name", ["mission.toml", "ticks.csv"])
def test_a_disk_that_is_full_from_the_start_is_told_in_one_line(tmp_path, name):
    (tmp_path / name).symlink_to("/dev/full")
    with pytest.raises(RecorderError, match=r"cannot be written: No space left on device$"):
        Recorder(tmp_path, "name = 'x'\n")


def test_closing_without_a_start_is_no_mistake(tmp_path):
    Recorder(tmp_path, "").close()


def test_closing_twice_is_no_mistake(recorder):
    recorder.close()
    recorder.close()


def test_a_bounded_run_folder_keeps_its_bound_and_the_ticks_outlast_the_frames(tmp_path):
    recorder = Recorder(tmp_path, "", max_mb=0.1)
    recorder.start(EPOCH_US)
    for i in range(1500):
        recorder.step(LoopStep(0.05 * i, heard=[("vehicle", "a", frames(2))], said=frames(1)))
        recorder.ticks([tick(time=0.05 * i)])
    recorder.close()
    sizes = {name: (tmp_path / name).stat().st_size for name in ("flight.tlog", "turns.csv", "ticks.csv")}
    assert 0.095e6 < sum(sizes.values()) < 0.1e6 + 1000
    steps = list(recorded_steps(tmp_path))
    ticks = read_ticks(tmp_path)
    assert sizes["flight.tlog"] == sum(8 + len(frame) for step in steps for frame in (*step.sent, *frames(2)))
    assert steps[-1].time < ticks.time[-1] < 74
    assert recorder.problem == (
        f"{tmp_path}: frames are recorded up to {steps[-1].time + 0.05:.0f} s: log.max_mb = 0.1 is reached"
    )


def test_a_disk_that_hangs_costs_gaps_and_not_all_the_memory(tmp_path, monkeypatch):
    """Nobody writes: the recorder's thread was never started, as if it hung in its first write."""
    monkeypatch.setattr("circnav_mav.runtime.recorder.MOST_WAITING", 50)
    recorder = Recorder(tmp_path, "")
    for i in range(200):
        recorder.step(LoopStep(0.05 * i))
    assert recorder._queue.qsize() == 50
    assert recorder.problem == f"{tmp_path}: recording has gaps from 2 s on: the disk is too slow"


def test_a_flood_of_senders_does_not_fill_the_memory(tmp_path):
    recorder = Recorder(tmp_path, "")
    recorder.start(EPOCH_US)
    for i in range(3000):
        recorder.step(LoopStep(0.001 * i, heard=[("vehicle", ("10.0.0.1", i), [])]))
    recorder.close()
    numbers = {row.split(",")[1] for row in (tmp_path / "turns.csv").read_text().splitlines()[1:]}
    assert len(recorder._sources) == 1000
    assert len(numbers) == 1001
