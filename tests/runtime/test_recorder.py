"""The run folder, read back by pymavlink's own log reader, and disk failures of all kinds."""

import csv
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot import TickRecord
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.runlog.loop_steps import recorded_steps
from circnav_mav.runlog.ticks import read_ticks
from circnav_mav.runtime.recorder import TICK_COLUMNS, Recorder, RecorderError
from tests.process import until

EPOCH_US = 1_790_000_000_000_000


def frames(count):
    speaker = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    made = []
    for i in range(count):
        speaker.seq = i % 256
        made.append(
            bytes(mavlink.MAVLink_attitude_message(i, 0.1 * i, 0, 0, 0, 0, 0).pack(speaker))
        )
    return made


def tick(**changes):
    values = dict.fromkeys(TICK_COLUMNS, None) | {
        "time": 1.25,
        "phase": Phase.ENGAGED,
        "saturated": True,
        "mode": "GUIDED",
        "accepted": 7,
        "rejected": 2,
        "r": 101.23456789,
        "turn_gain": 1.0,
        "turn_delay": 0.4,
        "gain_share": 1.0,
    }
    return TickRecord(**(values | changes))


@pytest.fixture
def recorder(tmp_path, monkeypatch):
    monkeypatch.setattr("circnav_mav.runtime.recorder.MOST_MB", 0.1)
    made = Recorder(tmp_path / "deep" / "run", "name = 'Zürich'\n")
    made.start(EPOCH_US)
    yield made
    made.close()


def test_pymavlink_reads_recorded_tlog(recorder):
    """Every frame is read with its time. The run folder also contains the mission as flown."""
    for i, frame in enumerate(frames(40)):
        recorder.step(LoopStep(0.05 * i, sent=[frame]))
    recorder.close()
    log = mavutil.mavlink_connection(str(recorder.folder / "flight.tlog"), dialect="all")
    back = []
    while (message := log.recv_match(type="ATTITUDE")) is not None:
        back.append(message)
    log.close()
    assert [message.time_boot_ms for message in back] == list(range(40))
    moments = [message._timestamp - EPOCH_US / 1e6 for message in back]
    assert moments == pytest.approx([0.05 * i for i in range(40)], abs=1e-6)
    assert {(message.get_srcSystem(), message.get_srcComponent()) for message in back} == {(7, 1)}
    assert recorder.problem is None
    assert (recorder.folder / "mission.toml").read_text(encoding="utf-8") == "name = 'Zürich'\n"


def test_every_recorded_tick_is_row_of_ticks_csv(recorder):
    recorder.ticks([tick(), tick(time=1.3, phase=Phase.COASTING, saturated=False, r=None)])
    recorder.close()
    with (recorder.folder / "ticks.csv").open(newline="", encoding="utf-8") as file:
        first, second = csv.DictReader(file)
    assert tuple(first) == TICK_COLUMNS
    assert {
        "time",
        "phase",
        "r",
        "r_dot",
        "turn_rate",
        "yaw_rate_sent",
        "range_age",
        "mode",
    } <= set(TICK_COLUMNS)
    assert (first["time"], first["phase"], first["saturated"], first["mode"]) == (
        "1.250000",
        "engaged",
        "1",
        "GUIDED",
    )
    assert (first["r"], first["accepted"], first["r_dot"]) == ("101.234568", "7", "")
    assert (second["phase"], second["saturated"], second["r"]) == ("coasting", "0", "")


def test_recorded_data_are_flushed_at_once(recorder):
    """Data in a buffer of the process would be lost in a crash."""
    recorder.step(LoopStep(0.5, sent=frames(30)))
    recorder.ticks([tick()])
    until(lambda: "engaged" in (recorder.folder / "ticks.csv").read_text())
    sizes = [
        (recorder.folder / name).read_bytes().count(b"\n") for name in ("steps.csv", "ticks.csv")
    ]
    assert sizes == [2, 2]
    assert (recorder.folder / "flight.tlog").stat().st_size == sum(
        8 + len(frame) for frame in frames(30)
    )


# --- disks that fail


@pytest.mark.parametrize(
    ("place", "why"),
    [
        ("/proc/circnav", "No such file or directory"),
        ("/dev/null/run", "Not a directory"),
        ("{tmp}/file", "File exists"),
        ("{tmp}/mission.toml", "No space left on device"),
        ("{tmp}/ticks.csv", "No space left on device"),
    ],
    ids=[
        "missing parent folder",
        "parent is a file",
        "folder is a file",
        "full",
        "full for the ticks",
    ],
)
def test_folder_that_cannot_be_written_is_refused(tmp_path, place, why):
    folder = Path(place.format(tmp=tmp_path))
    if folder.name == "file":
        folder.write_text("a file")
    elif folder.parent == tmp_path:
        folder.symlink_to("/dev/full")
        folder = tmp_path
    with pytest.raises(RecorderError) as caught:
        Recorder(folder, "name = 'x'\n")
    assert str(caught.value) == f"{folder}: cannot be written: {why}"


@pytest.mark.parametrize(("file", "mode"), [("_tlog", "wb"), ("_ticks", "w"), ("_steps", "w")])
def test_full_disk_in_flight_is_reported_as_recording_problem(recorder, file, mode):
    """The file is /dev/full, on which every write fails with "no space left on device"."""
    setattr(recorder, file, Path("/dev/full").open(mode))  # noqa: SIM115
    for i in range(200):
        recorder.step(LoopStep(0.05 * i, sent=frames(5)))
        recorder.ticks([tick()])
    recorder.close()
    assert recorder.problem == f"{recorder.folder}: recording stopped: No space left on device"


def test_recorder_keeps_size_limit_of_run_folder(recorder):
    folder = recorder.folder
    for i in range(1500):
        recorder.step(LoopStep(0.05 * i, received=[("vehicle", "a", frames(2))], sent=frames(1)))
        recorder.ticks([tick(time=0.05 * i)])
    recorder.close()
    sizes = {
        name: (folder / name).stat().st_size for name in ("flight.tlog", "steps.csv", "ticks.csv")
    }
    assert 0.095e6 < sum(sizes.values()) < 0.1e6 + 1000
    steps = list(recorded_steps(folder))
    ticks = read_ticks(folder)
    assert sizes["flight.tlog"] == sum(
        8 + len(frame) for step in steps for frame in (*step.sent, *step.received_frames)
    )
    assert steps[-1].time < ticks.time[-1] < 74
    assert (
        recorder.problem
        == f"{folder}: recording of frames ended at {steps[-1].time + 0.05:.0f} s: the limit of 0.1"
        " MB is reached"
    )


def test_slow_disk_causes_recording_gaps_but_no_memory_growth(tmp_path, monkeypatch):
    """The recorder's thread is not started, as if its first write never returned."""
    monkeypatch.setattr("circnav_mav.runtime.recorder.MOST_WAITING", 50)
    recorder = Recorder(tmp_path, "")
    for i in range(200):
        recorder.step(LoopStep(0.05 * i))
    assert recorder._queue.qsize() == 50
    assert recorder.problem == f"{tmp_path}: recording has gaps from 2 s on: the disk is too slow"


def test_recorder_memory_is_bounded_during_flood_of_senders(tmp_path, recorder):
    Recorder(tmp_path, "").close()
    for i in range(3000):
        recorder.step(LoopStep(0.001 * i, received=[("vehicle", ("10.0.0.1", i), [])]))
    recorder.close()
    numbers = {
        row.split(",")[1] for row in (recorder.folder / "steps.csv").read_text().splitlines()[1:]
    }
    assert len(recorder._sources) == 1000
    assert len(numbers) == 1001
