"""The end of a flight: all recorded data are kept, even if pictures or figures fail or the terminal
has closed."""

import csv
import json
import os
import pty
import signal
import sys
from contextlib import suppress
from importlib import import_module

import pytest

from circnav_mav.pilot.mission_state import Phase
from circnav_mav.report.chart_data import alarms
from circnav_mav.runlog.events import events
from circnav_mav.runlog.run_folder import open_run
from tests.process import ROOT, python, until


def strict(path):
    """Return the content of a JSON file. NaN and other values outside the JSON standard raise an
    error."""
    return json.loads(path.read_text(), parse_constant=pytest.fail)


def fails(*arguments, **named):
    raise IndexError("list index out of range")


@pytest.fixture
def fly(circnav, tmp_path):
    """Return a function that runs a short flight of the bundled vehicle with one warning. It
    returns the output and the summary."""

    def fly():
        out = circnav("fly", "quickstart", "--duration", 4, "--out", tmp_path / "run").done
        summary = strict(tmp_path / "run" / "summary.json")
        assert (summary["outcome"], out.count("WARNING")) == ("completed", 1)
        assert strict(tmp_path / "run" / "manifest.json")["exit"] == 0
        return out, summary

    return fly


def test_failed_picture_prints_one_line_after_flight(circnav, fly, tmp_path):
    (tmp_path / "run" / "report.html").mkdir(parents=True)
    out, _ = fly()
    assert "report.html: could not be made: " in out
    assert (tmp_path / "run" / "flight.png").is_file()
    log = tmp_path / "run" / "report.log"
    assert "report.html: could not be made: " in log.read_text()
    (tmp_path / "run" / "report.html").rmdir()
    assert circnav("report", tmp_path / "run").done
    assert not log.exists()


def test_drawing_library_loads_after_real_flight(circnav, mission, monkeypatch):
    """Loading takes processor time that a companion computer needs for setpoints."""
    fly = import_module("circnav_mav.cli.fly")
    happened = []

    class Fake:
        def __init__(self, folder):
            happened.append("loads")

        def draw(self):
            happened.append("draws")
            return []

    run = fly.run
    monkeypatch.setattr(
        fly, "run", lambda *things, **named: (run(*things, **named), happened.append("flown"))
    )
    monkeypatch.setattr(fly, "Drawing", Fake)
    circnav("fly", "quickstart", "--duration", 1)
    assert happened == ["loads", "flown", "draws"]
    happened.clear()
    circnav("fly", mission)
    assert happened == ["flown", "loads", "draws"]


def test_drawing_process_ends_when_flight_is_killed(tmp_path):
    words = "from circnav_mav.cli.drawing import *; import time; "
    words += f"one = Drawing(Path({str(tmp_path)!r})); "
    flight = python("-c", words + "print(one._process.pid, flush=True); time.sleep(900)")
    drawing = int(flight.stdout.readline())
    os.kill(drawing, 0)
    flight.kill()
    flight.communicate()
    until(lambda: not is_there(drawing))
    assert not list(tmp_path.iterdir())


def test_job_of_interactive_shell_ends_before_drawing(tmp_path):
    """The shell has job control on a real terminal. report.log is removed when all is drawn."""
    folder = tmp_path / "run"
    flight = f"{sys.executable} -m circnav_mav fly quickstart --duration 1 --out {folder}"
    process, terminal = pty.fork()
    if process == 0:
        os.environ.update(TERM="xterm", PYTHONPATH=str(ROOT))
        os.execv("/bin/sh", ["sh", "-m", "-c", f"{flight}; echo exit code $?; ls {folder}"])
    shown = b""
    with suppress(OSError):
        while block := os.read(terminal, 65536):
            shown += block
    os.waitpid(process, 0)
    os.close(terminal)
    verdict, _, listed = shown.decode().partition("exit code 0")
    assert f"{folder}/report.html, ready in a few seconds" in verdict
    assert "report.log" in listed
    assert "report.html" not in listed
    until(lambda: not (folder / "report.log").exists())
    assert (folder / "report.html").stat().st_size > 10_000


def is_there(process):
    """True if the process runs. A zombie process has ended."""
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.usefixtures("undrawn")
def test_summary_lists_alarms_beyond_recording_limit(circnav, tmp_path, monkeypatch):
    monkeypatch.setattr("circnav_mav.runtime.recorder.MOST_MB", 0.16)
    silence = 'sim.events=[{at_s=6, action="mute_ranging"}, {at_s=9, action="unmute_ranging"}]'
    ran = circnav("fly", "quickstart", "--duration", 12, "--set", silence, "--out", "run")
    assert (ran.code, strict(tmp_path / "run" / "manifest.json")["exit"]) == (5, 5)
    summary = strict(tmp_path / "run" / "summary.json")
    assert summary["outcome"] == "completed"
    begun = [(alarm["time_s"], alarm["text"][:11]) for alarm in summary["alarms"]]
    assert begun[0] == (pytest.approx(7, abs=1), "RANGE STALE")
    assert begun[1:] == [(pytest.approx(10, abs=1.5), "NOT RECORDI")]
    assert [(time, text[:11]) for time, text in alarms(events(open_run(tmp_path / "run")))] == begun


@pytest.mark.usefixtures("undrawn")
def test_failing_display_prints_one_line(fly, monkeypatch):
    monkeypatch.setattr("circnav_mav.runtime.display.Display.on_step", fails)
    assert "display: stopped at " in fly()[0]


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    "what", ["cli.closing.read_truth", "cli.closing.read_ticks", "runlog.summary._truth"]
)
def test_unreadable_truth_or_ticks_omit_their_figures(fly, monkeypatch, what):
    monkeypatch.setattr(f"circnav_mav.{what}", fails)
    _, summary = fly()
    assert "list index out of range" in summary["recording_problem"]
    assert (summary["truth"] is None) == ("truth" in what)


def exits(*arguments):
    sys.exit("of another package")


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("failure", "cause"),
    [(fails, "IndexError: list index out of range"), (exits, "SystemExit: of another package")],
)
def test_internal_error_sends_safe_setpoint_and_is_recorded(
    circnav, monkeypatch, tmp_path, failure, cause
):
    safe = []
    monkeypatch.setattr("circnav_mav.cli.fly.run", failure)
    monkeypatch.setattr(
        "circnav_mav.pilot.Pilot.last_frames", lambda pilot, now: safe.append(now) or b""
    )
    ran = circnav("fly", "quickstart", "--out", tmp_path / "run")
    report = tmp_path / "run" / "error.txt"
    line = f"internal error: {cause} (test_closing.py:{failure.__code__.co_firstlineno + 1})"
    assert (ran.code, ran.line, len(safe)) == (1, f"circnav: {line}, see {report}", 1)
    assert cause in report.read_text()
    assert strict(tmp_path / "run" / "summary.json")["reason"] == line


@pytest.mark.usefixtures("undrawn")
def test_sigint_ends_flight_when_other_handlers_are_installed(circnav, monkeypatch, tmp_path):
    """rospy and rclpy install their own signal handlers."""
    fly = import_module("circnav_mav.cli.fly")  # the attribute `cli.fly` is a command
    opened = fly.open_links
    flown = fly.run

    def opens(*arguments):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        return opened(*arguments)

    def interrupted(*arguments):
        signal.raise_signal(signal.SIGINT)
        flown(*arguments)

    monkeypatch.setattr(fly, "open_links", opens)
    monkeypatch.setattr(fly, "run", interrupted)
    assert circnav("fly", "quickstart", "--duration", 2, "--out", tmp_path / "run").code == 130
    assert strict(tmp_path / "run" / "summary.json")["outcome"] == "interrupted"
    assert signal.getsignal(signal.SIGINT) is signal.SIG_DFL


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(("option", "voice"), [("--dry-run", "dry run"), ("--shadow", "shadow")])
def test_dry_run_and_shadow_send_no_setpoint(circnav, tmp_path, option, voice):
    assert (
        "setpoints  0 sent"
        in circnav("fly", "quickstart", option, "--duration", 2, "--out", tmp_path / "run").done
    )
    assert strict(tmp_path / "run" / "summary.json")["output_mode"] == voice


def moments(folder, *phases):
    """Return the times at which a flight was in these phases."""
    with (folder / "ticks.csv").open() as file:
        return [float(row["time"]) for row in csv.DictReader(file) if row["phase"] in phases]


def test_flight_continues_when_terminal_closes(tmp_path):
    """A real terminal is closed while the vehicle circles. The kernel sends SIGHUP, and all later
    writes to the terminal fail."""
    folder = tmp_path / "run"
    engaged = Phase.ENGAGED.value.encode()
    process, terminal = pty.fork()
    if process == 0:
        os.environ.update(TERM="xterm", PYTHONPATH=str(ROOT))
        arguments = ["fly", "quickstart", "--speed", "6", "--duration", "12", "--out", str(folder)]
        os.execv(sys.executable, [sys.executable, "-m", "circnav_mav", *arguments])
    shown = b""
    while engaged not in shown.lower():
        shown += os.read(terminal, 65536)
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 0
    summary = strict(folder / "summary.json")
    assert (summary["outcome"], summary["recording_problem"]) == ("completed", None)
    assert (
        moments(folder, "leaving")[0]
        >= summary["engaged_s"] + 12.0
        > moments(folder, "engaged", "coasting")[-1]
    )
    assert summary["truth"]["radius_mean_m"] is not None
    assert (folder / "report.html").stat().st_size > 10_000
