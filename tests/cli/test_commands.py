"""Help, check, preflight and emulate: output and exit codes."""

import os
import pty
import re
import signal
import time
import tomllib

import pytest

from circnav_mav import __version__
from circnav_mav.cli import circnav as cli
from circnav_mav.cli.check import show_checks
from circnav_mav.extension import extensions
from circnav_mav.mav.check_result import Check, Grade
from tests.process import PATIENCE, ROOT, UNHURRIED
from tests.process import circnav as process_of

MISSIONS = sorted(path.stem for path in (ROOT / "config").glob("*.toml"))


# --- help and version


@pytest.mark.parametrize("flag", ["--help", "-h"])
def test_help_lists_commands_and_exit_codes(circnav, flag):
    out = circnav(flag).done
    for word in ("Exit codes", "130", "circnav fly quickstart"):
        assert word in out
    commands = [line.split()[0] for line in out.partition("Commands:\n")[2].splitlines()]
    assert commands[:4] == ["fly", "init", "check", "preflight"]
    assert commands == [
        *cli.commands,
        *(name for one in extensions() for name in one.commands if " " not in name),
    ]
    for command in commands:
        out = circnav(command, flag).done
        assert "Example" in out
        assert f"    circnav {command} " in out
        within = out.partition("Commands:\n")[2].splitlines()
        assert within or command not in ("ranging", "runs")
        assert not [line for line in within if line.endswith("...")], (
            "a help text is cut off at 80 columns"
        )
    assert circnav().done == circnav(flag).done
    assert circnav("--version").done == f"circnav, version {__version__}\n"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["project"]["version"] == __version__


# --- check


@pytest.mark.parametrize("name", MISSIONS)
def test_bundled_missions_pass_their_checks(circnav, name):
    """The emulator must also support the vehicle of the [sim] table."""
    assert "0 FAIL" in circnav("check", name).done


def test_check_counts_grades_of_lines(circnav, mission):
    *lines, count = circnav("check", mission).done.splitlines()
    grades = [line.split()[0] for line in lines]
    assert set(grades) <= {"PASS", "WARN", "FAIL"}
    counts = ", ".join(f"{grades.count(grade)} {grade}" for grade in ("PASS", "WARN", "FAIL"))
    assert count == f"{mission}: {counts}"


def test_check_fails_impossible_gain(circnav, mission):
    ran = circnav("check", mission, "--set", "guidance.gain=1e-5")
    assert ran.code == 2
    (line,) = [line for line in ran.out.splitlines() if line.startswith("FAIL")]
    assert "k = 1e-05 1/m^2 (given), needs k > 1/(2 r_d^2) = 5e-05" in line
    assert "1 FAIL" in ran.out
    assert "\x1b" not in ran.out


def test_check_wraps_long_lines_at_words(monkeypatch):
    """A terminal breaks a long line inside a word."""
    text = (
        "1 m of error in the height above the target (60.0 m) changes the radius by 0.40 m (WARN"
        " above 0.3)"
    )
    ours, terminal = pty.openpty()
    monkeypatch.setenv("COLUMNS", "80")
    with open(terminal, "w", encoding="utf-8") as out:
        monkeypatch.setattr("sys.stdout", out)
        show_checks([Check(Grade.WARN, "height cost", text)])
        out.flush()
        shown = re.sub("\x1b.*?m", "", os.read(ours, 4096).decode()).splitlines()
    os.close(ours)
    assert shown[0].startswith("WARN  height cost   1 m of error")
    assert max(map(len, shown)) <= 80
    assert " ".join(line[20:] for line in shown) == text


@pytest.mark.parametrize(
    ("name", "overrides", "grades"),
    [
        ("plane", ["sim.vehicle.profile=arducopter"], ["FAIL"]),
        ("px4-copter", ["sim.vehicle.profile=arducopter"], ["FAIL"]),
        ("plane", ["sim.wind.speed_mps=30"], ["WARN"]),
        ("copter", ["sim.target.velocity_east_mps=30"], ["WARN"]),
        ("plane", ["vehicle.speed_mps=18"], []),  # the bundled plane cruises at the same speed
        ("plane", ["sim.vehicle.cruise_speed_mps=18"], ["WARN"]),
        ("copter", ["sim.wind.speed_mps=30"], ["WARN"]),  # it holds its speed over ground
        ("plane", ["sim.vehicle.profile=arducopter", "link.endpoint=udpin:0.0.0.0:14550"], []),
        (
            "plane",  # the target drifts with the wind
            ["sim.wind.speed_mps=30", "sim.wind.from_deg=0", "sim.target.velocity_north_mps=-30"],
            [],
        ),
    ],
)
def test_check_compares_emulated_vehicle_with_mission(circnav, name, overrides, grades):
    out = circnav("check", name, *(part for key in overrides for part in ("--set", key))).out
    assert [line[:4] for line in out.splitlines() if line[6:].startswith("sim ")] == grades


# --- preflight


def test_preflight_of_bundled_vehicle_passes(circnav):
    brief = circnav("preflight", "copter", "--seconds", "3").done
    assert "PASS  ranging" in brief and "turn rate" not in brief
    printed = circnav("preflight", "copter", "--seconds", "3", "-v").done
    assert (
        printed.index("turn rate") < printed.index("listening on sim") < printed.index("firmware")
    )
    assert "PASS  ranging" in printed
    counts, last = printed.splitlines()[-2:]
    assert counts.endswith("0 FAIL") and "judged the bundled emulator" in last


@pytest.mark.parametrize(
    ("options", "code", "part"),
    [("--seconds 4 --set sim.ranging.rate_hz=0.0", 4, "FAIL  ranging"),
     ("--endpoint udpin:127.0.0.1:{port} --set link.wait_s=1", 3, "0 bytes received")],
    ids=["a failing line", "silence"],
)  # fmt: skip
def test_preflight_exit_code_follows_kind_of_failure(circnav, port, options, code, part):
    ran = circnav("preflight", "copter", *options.format(port=port).split())
    assert (ran.code, part in ran.out) == (code, True)


def test_preflight_follows_clock_of_fast_simulator(circnav, port):
    with process_of(
        "emulate", "copter", "--endpoint", f"udpin:127.0.0.1:{port}", "--speed", "2"
    ) as vehicle:
        vehicle.stdout.readline()
        endpoint = ("--endpoint", f"udpout:127.0.0.1:{port}")
        follows = ("--set", 'link.clock="autopilot"')
        ran = circnav(
            "preflight", "copter", *endpoint, "--seconds", "8", "-v", *follows, *UNHURRIED
        )
        vehicle.terminate()
        vehicle.communicate(timeout=PATIENCE)
    assert "and the flight follows it" in ran.done and "bundled emulator" not in ran.done


# --- commands that end on request


@pytest.mark.parametrize(
    ("command", "number", "code"),
    [
        ("preflight copter --endpoint udpin:127.0.0.1:{port}", signal.SIGINT, 130),
        ("emulate --endpoint udpout:127.0.0.1:{port}", signal.SIGINT, 0),
        ("emulate --endpoint udpout:127.0.0.1:{port}", signal.SIGTERM, 0),
    ],
)
def test_sigint_ends_listening_command(port, command, number, code):
    with process_of(*command.format(port=port).split()) as process:
        try:
            assert any("listening" in line or "udpout" in line for line in process.stdout)
            time.sleep(0.5)
            process.send_signal(number)
            _, err = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    assert (process.returncode, err) == (code, "circnav: stopped by SIGINT\n" if code else "")


def test_emulator_above_real_time_prints_clock_setting(circnav, busy_port, monkeypatch):
    monkeypatch.setattr("circnav_sim.server._fly", lambda *_arguments: None)
    emulate = ("emulate", "--endpoint", f"udpout:127.0.0.1:{busy_port}")
    _, how = circnav(*emulate, "--speed", "8").done.splitlines()
    assert how == """8 times real time: fly it with --set 'link.clock="autopilot"'"""
    assert len(circnav(*emulate).done.splitlines()) == 1
