"""Run folders that were damaged in every way: report, export and replay tell what there is, or refuse in one line."""

import importlib
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from circnav_mav.runlog.ticks import read_truth
from circnav_mav.runlog.tlog import read_tlog
from tests.flight.recorded import recorded_flight


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """10 s of the quickstart, unfinished."""
    folder = tmp_path_factory.mktemp("flown")
    recorded_flight(folder, "quickstart", "limits.duration_s=5").fly(12).recorder.close()
    return folder


@pytest.fixture
def run(flown, tmp_path):
    shutil.copytree(flown, tmp_path / "run")
    return tmp_path / "run"


@pytest.fixture
def no_pictures(monkeypatch):
    """Where only words are looked at: drawing takes nearly all of a report's time."""
    module = importlib.import_module("circnav_mav.cli.report")  # the package's `report` is the command
    monkeypatch.setattr(module, "plot_flight", lambda path, *what: path.write_bytes(b"a picture"))


def rows(run):
    return [line.split(",") for line in (run / "ticks.csv").read_text().splitlines()]


def with_cell(run, line, name, cell):
    """ticks.csv with one cell changed; lines as an editor counts them, from the end if below 0."""
    changed = rows(run)
    changed[line if line < 0 else line - 1][changed[0].index(name)] = cell
    write(run, changed)


def write(run, lines):
    (run / "ticks.csv").write_text("".join(",".join(line) + "\n" for line in lines))


def with_times(run, time_of):
    header, *ticks = rows(run)
    write(run, [header, *([time_of(at, tick[0]), *tick[1:]] for at, tick in enumerate(ticks))])


@pytest.mark.parametrize("command", [("report",), ("export", "--mcap"), ("replay",)], ids=lambda words: words[0])
@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda run: with_cell(run, 2, "time", ""), "line 2: time: must be seconds of the run, not nan"),
        (lambda run: with_cell(run, 5, "time", "nan"), "line 5: time: must be seconds of the run, not nan"),
        (lambda run: with_cell(run, 5, "time", "inf"), "line 5: time: must be seconds of the run, not inf"),
        (lambda run: with_cell(run, 5, "time", "1e308"), "line 5: time: must be seconds of the run, not 1e+308"),
        (lambda run: with_cell(run, 2, "time", "-1"), "line 2: time: must be seconds of the run, not -1"),
        (lambda run: with_cell(run, -1, "time", "0.0"), "time: 0.000000 comes after "),
        (lambda run: write(run, [rows(run)[0], *rows(run)[:0:-1]]), "line 3: time: "),
        (lambda run: with_times(run, lambda at, time: "1.0"), "line 3: time: stands still to the end"),
        (lambda run: with_cell(run, 7, "r", "far"), "line 7: r: 'far' is not a number"),
    ],
    ids=["empty first", "nan", "inf", "1e308", "negative", "last at 0", "reversed", "all equal", "a word"],
)
def test_ticks_whose_times_make_no_sense_are_refused_with_their_line(circnav, run, command, spoil, says):
    spoil(run)
    ran = circnav(command[0], run, *command[1:])
    assert ran.code == 2
    assert ran.line.startswith(f"circnav: {run / 'ticks.csv'}: ")
    assert says in ran.line


@pytest.mark.parametrize(
    ("name", "cell"),
    [(name, "1e308") for name in ("accepted", "rejected", "r", "measured", "nis", "turn_rate")]
    + [("accepted", ""), ("measured", "nan"), ("turn_rate", "inf")],
)
def test_a_number_that_no_flight_has_is_unknown(circnav, run, name, cell):
    with_cell(run, -1, name, cell)
    ran = circnav("report", run)
    assert (ran.code, ran.err) == (0, "")


def test_a_run_of_a_single_tick_is_called_that(circnav, run):
    write(run, rows(run)[:2])
    ran = circnav("report", run)
    assert (ran.code, ran.line) == (3, f"circnav: {run}: a single tick was recorded, too little for a report")


WHOLE = {
    "mission": "quickstart", "outcome": "completed", "reason": "flown to its end", "desired_radius_m": 100.0,
    "direction": "clockwise", "direction_commanded": "clockwise", "engaged_s": 1.0, "flown_s": 5.0, "settled_s": None,
    "radius_mean_m": 99.0, "radius_rms_error_m": 1.0, "samples_accepted": 7777, "samples_rejected": {"gated": 3},
    "frames_refused": {}, "setpoints_sent": 20, "truth": None, "firmware": None, "version": "0", "epoch_us": 5,
    "recording_problem": None,
}  # fmt: skip


def verdict_of(circnav, run, summary):
    (run / "summary.json").write_text(summary if isinstance(summary, str) else json.dumps(summary))
    ran = circnav("report", run)
    assert (ran.code, ran.err) == (0, "")
    return (run / "report.html").read_text().partition('<div class="outcome')[2].partition("</pre>")[0]


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("missing", WHOLE)
def test_a_summary_without_one_of_its_values_is_told_with_what_was_recorded(circnav, run, missing):
    told = verdict_of(circnav, run, {key: value for key, value in WHOLE.items() if key != missing})
    assert ("7777 accepted" in told) == (missing != "samples_accepted")
    assert ("COMPLETED" in told) == (missing != "outcome")


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize(
    "changed",
    [
        {"outcome": 5}, {"samples_rejected": [1]}, {"samples_rejected": {"gated": "many"}}, {"engaged_s": "soon"},
        {"truth": {}}, {"truth": [1]}, {"desired_radius_m": 0}, {"flown_s": float("nan")}, {"radius_mean_m": None},
        {"setpoints_sent": 10**400}, {"recording_problem": {"a": 1}}, {"reason": None}, {"frames_refused": "none"},
    ],
    ids=str,
)  # fmt: skip
def test_a_summary_with_a_value_of_another_kind_is_told_with_what_was_recorded(circnav, run, changed):
    assert "setpoints" in verdict_of(circnav, run, WHOLE | changed)


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("text", ["", "{", "[]", "{}", "[" * 100_000, "null"], ids=range(6))
def test_a_summary_that_a_full_disk_left_half_written_is_no_obstacle(circnav, run, text):
    told = verdict_of(circnav, run, text)
    assert "no whole summary.json: the figures are of what was recorded" in told
    assert circnav("replay", run).code == 0


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize(
    "changed",
    [{"autopilot": "x"}, {"seeds": [1]}, {"versions": None}, {"versions": []}, {"exit": "y"}, {"mission": 5},
     {"outcome": 5}, {"reason": []}],
    ids=str,
)  # fmt: skip
def test_a_manifest_with_a_value_of_another_kind_is_unknown_there(circnav, run, changed):
    manifest = json.loads((run / "manifest.json").read_text())
    (run / "manifest.json").write_text(json.dumps(manifest | changed))
    for command in ("report", run), ("export", run, "--mcap"), ("replay", run):
        ran = circnav(*command)
        assert (ran.code, ran.err) == (0, "")


@pytest.mark.parametrize("epoch", [-1, 2**63, 10**30, 0, "now", None, 1.5, True])
def test_a_beginning_that_is_no_moment_is_refused(circnav, run, epoch):
    manifest = json.loads((run / "manifest.json").read_text())
    (run / "manifest.json").write_text(json.dumps(manifest | {"epoch_us": epoch}))
    for command in ("report", run), ("export", run, "--mcap"):
        assert "tells when the run began (epoch_us)" in circnav(*command).line


def test_a_manifest_without_end_is_refused(circnav, run):
    (run / "manifest.json").write_text("[" * 100_000)
    for command in ("report", run), ("export", run, "--mcap"), ("replay", run):
        assert circnav(*command).line == f"circnav: {run / 'manifest.json'}: is nested too deeply"


def test_a_folder_named_like_a_part_of_the_page_is_only_named(circnav, run, tmp_path):
    odd = tmp_path / "@EVENTS@"
    run.rename(odd)
    assert circnav("report", odd).code == 0
    assert f"<dt>run folder</dt><dd><span>{odd}</span>" in (odd / "report.html").read_text()


# --- a log that is damaged: read as far as it goes, and said so ---


def records(run):
    """Where each record of the tlog begins."""
    at, found = 0, []
    for _, frame in read_tlog(run / "flight.tlog"):
        found.append(at)
        at += 8 + len(frame)
    return found


def spoil(path, at, data):
    whole = bytearray(path.read_bytes())
    whole[at : at + len(data)] = data
    path.write_bytes(whole)


def test_a_log_that_was_cut_is_compared_up_to_there_and_called_cut(circnav, run):
    log = run / "flight.tlog"
    size, third = log.stat().st_size, records(run)[len(records(run)) // 3]
    log.write_bytes(log.read_bytes()[: third + 10])
    ran = circnav("replay", run)
    assert (ran.code, ran.err) == (0, "")
    assert f"WARNING    flight.tlog: cut off or damaged at byte {third} of {third + 10} (" in ran.out
    assert size > 3 * third
    assert re.search(r"byte for byte the same up to \d\.\d s, and", ran.out)
    assert "cut off or damaged at byte" in circnav("report", run).out
    assert "cut off or damaged at byte" in (run / "report.html").read_text()
    assert "cut off or damaged at byte" in circnav("export", run, "--mcap").out


def test_a_log_that_ends_between_two_frames_is_not_called_the_same_to_the_end(circnav, run):
    log = run / "flight.tlog"
    log.write_bytes(log.read_bytes()[: records(run)[len(records(run)) // 2]])
    ran = circnav("replay", run)
    assert re.search(r"WARNING    replayed up to \d\.\d s of \d\.\d s, where flight\.tlog or turns\.csv ends", ran.out)
    assert "byte for byte the same up to" in ran.out


def test_zeros_in_the_middle_of_a_log_are_told_with_their_place(circnav, run):
    middle = records(run)[len(records(run)) // 2]
    spoil(run / "flight.tlog", middle, bytes(64))
    out = circnav("replay", run).out
    assert f"WARNING    flight.tlog: damaged at byte {middle} of " in out
    assert re.search(r"replayed up to \d\.\d s of \d\.\d s, where flight\.tlog or turns\.csv is damaged", out)
    assert "byte for byte the same up to" in out


def test_the_truth_and_the_texts_behind_a_damage_are_in_the_report(circnav, run):
    newest = read_truth(run, epoch(run)).time[-1]
    spoil(run / "flight.tlog", records(run)[10], bytes(64))
    out = circnav("report", run).out
    assert re.search(r"WARNING    flight\.tlog: damaged at byte \d+ of \d+, \d+ bytes left out \(from 0\.\d s of", out)
    assert read_truth(run, epoch(run)).time[-1] == newest


def epoch(run):
    return json.loads((run / "manifest.json").read_text())["epoch_us"]


def test_a_frame_whose_check_fails_is_told(circnav, run):
    frames = list(read_tlog(run / "flight.tlog"))
    heard = next(n for n, (_, frame) in enumerate(frames) if n > 100 and frame[5] != 255 and frame[7] == 30)
    spoil(run / "flight.tlog", records(run)[heard] + 8 + 10, b"\xaa\x55")
    ran = circnav("replay", run)
    assert "flight.tlog: left out as damaged: 1 of the frames that came in" in ran.out


@pytest.mark.parametrize(
    ("offset", "data"), [(8, b"\x00"), (0, b"\xff" * 8)], ids=["no frame begins", "a stamp of the far future"]
)
def test_a_plain_log_is_replayed_to_its_end_and_what_is_damaged_is_counted(
    circnav, run, tmp_path, config, offset, data
):
    log = tmp_path / "yesterday.tlog"
    log.write_bytes((run / "flight.tlog").read_bytes())
    middle, behind = records(run)[len(records(run)) // 2 :][:2]
    spoil(log, middle + offset, data)
    ran = circnav("replay", log, "--mission", config / "quickstart.toml")
    assert (ran.code, ran.err) == (0, "")
    lost = f"damaged at byte {middle} of {log.stat().st_size}, {behind - middle} bytes left out\n"
    assert f"WARNING    yesterday.tlog: {lost}" in ran.out
    ends = [circnav("replay", run).out, ran.out]
    assert len({re.search(r": (\d+\.\d) s, ", out)[1] for out in ends}) == 1


def test_a_plain_log_that_was_cut_is_replayed_up_to_there(circnav, run, tmp_path, config):
    log = tmp_path / "yesterday.tlog"
    middle = records(run)[len(records(run)) // 2]
    log.write_bytes((run / "flight.tlog").read_bytes()[: middle + 10])
    ran = circnav("replay", log, "--mission", config / "quickstart.toml")
    assert re.search(rf"cut off or damaged at byte {middle} of {middle + 10}: replayed up to \d\.\d s\n", ran.out)


def test_frames_of_a_plain_log_whose_check_fails_are_counted(circnav, run, tmp_path, config):
    log = tmp_path / "yesterday.tlog"
    log.write_bytes((run / "flight.tlog").read_bytes())
    frames = list(read_tlog(log))
    heard = next(n for n, (_, frame) in enumerate(frames) if n > 100 and frame[5] != 255 and frame[7] == 30)
    spoil(log, records(run)[heard] + 8 + 10, b"\xaa\x55")
    ran = circnav("replay", log, "--mission", config / "quickstart.toml")
    assert "WARNING    yesterday.tlog: left out as damaged: 1 of the frames\n" in ran.out


def test_a_log_of_which_every_stamp_is_wild_is_none(circnav, run, tmp_path, config):
    log = tmp_path / "yesterday.tlog"
    log.write_bytes(b"".join(b"\xff" * 8 + frame for _, frame in read_tlog(run / "flight.tlog")))
    ran = circnav("replay", log, "--mission", config / "quickstart.toml")
    assert (ran.code, "no MAVLink frame in it" in ran.line) == (3, True)


def test_a_folder_whose_name_is_no_utf_8_is_told_of_all_the_same(run, tmp_path):
    """In a process of its own: pytest's own streams bear every name."""
    odd = Path(os.fsdecode(os.fsencode(tmp_path) + b"/bad\xff\xfename"))
    run.rename(odd)
    (odd / "manifest.json").write_text(json.dumps(json.loads((odd / "manifest.json").read_text()) | {"mission": ""}))
    for command in (["report", odd], ["replay", odd, "--out", odd / "what-if"], ["export", odd, "--mcap"]):
        ran = subprocess.run(
            [sys.executable, "-m", "circnav_mav", *command], capture_output=True, text=True, check=False,
            env={"PYTHONPATH": str(Path(__file__).parents[2]), "PATH": "/bin", "PYTHONIOENCODING": "utf-8:strict"},
        )  # fmt: skip
        assert (ran.returncode, ran.stderr) == (0, "")


def test_a_name_that_no_font_of_the_pictures_has_is_no_noise(circnav, run, tmp_path, recwarn):
    other = tmp_path / "飛行"
    run.rename(other)
    assert circnav("replay", other, "--out", tmp_path / "what-if").err == ""
    assert not [warning for warning in recwarn if "Glyph" in str(warning.message)]
