"""The user-defined law and estimator of docs/api.md, selected by name in the benchmark, in
missions and on a vehicle."""

import json
import re
import signal
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from circnav_mav import Direction, Guidance, Orbit
from circnav_mav import time_limit as limits
from circnav_mav.extras.bench.flight import fly
from circnav_mav.extras.bench.situations import SITUATIONS
from circnav_mav.extras.campaign.plan import load_campaign, prepare
from circnav_mav.guidance.own_code import OwnCodeError, StuckCodeError, call
from circnav_mav.mav.ranging.driver import DriverError, make_driver
from circnav_mav.mission.load import MissionError, parse_mission
from circnav_mav.pilot import Ending
from circnav_mav.time_limit import time_limit
from tests import small_mission
from tests.command_line import circnav, undrawn
from tests.docs.test_printed_commands import write_modules
from tests.flight.recorded import recorded_flight
from tests.process import ROOT

__all__ = ["circnav", "undrawn"]

PAGE = ROOT / "docs" / "api.md"
ORBIT = Orbit(100.0, Direction.CLOCKWISE, 15.0, 0.35)


@pytest.fixture(autouse=True)
def modules(tmp_path, monkeypatch):
    """A folder on the search path with the module of the page, and with laws that do not work."""
    write_modules(PAGE, tmp_path)
    (tmp_path / "wrong.py").write_text(
        "def estimate(estimate): return estimate.r\n"
        "def number(orbit): return 1.0\n"
        "def nan(orbit): return lambda estimate: float('nan')\n"
        "def crash(orbit): return lambda estimate: 1 / 0\n"
        "def text(orbit): return lambda estimate: '0.1'\n"
        "def late(orbit): return lambda estimate: 1 / (estimate.time < 5)\n"
        "def stuck(orbit):\n"
        "    def law(estimate):\n"
        "        while estimate.time > 5:\n"
        "            try: pass\n"
        "            except Exception: pass\n"
        "        return 0.1\n"
        "    return law\n"
        "def never(orbit):\n"
        "    def law(estimate):\n"
        "        while True: pass\n"
        "    return law\n"
    )
    package = tmp_path / "spiral-1.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Name: spiral\nVersion: 1\n")
    (package / "entry_points.txt").write_text(
        "[circnav.laws]\nspiral = mine:law\ntwice = mine:law\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(limits, "SIMULATED_LIMIT", 0.2)
    for name in ("mine", "ekf", "wrong"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return tmp_path


@pytest.mark.parametrize(
    ("policy", "flight"),
    [("mine:law", 1), ("mine:law+mine:Observer", 0), ("spiral+auto", 0), ("drift+ekf:Bank", 1)],
)
def test_user_law_and_estimator_keep_circle_in_benchmark(policy, flight):
    calm = replace(SITUATIONS["calm"], start=(80.0, 160.0), duration=110.0)
    track = fly(calm, policy, 1, flight)
    end = track.time > 80
    assert track.rows["r"][end] == pytest.approx(100.0, abs=3.0)
    assert np.sign(np.unwrap(track.rows["angle"][end])[[0, -1]] @ [-1, 1]) == track.sense
    nees = track.rows["nees"][end]
    if policy.endswith(("auto", "Bank")):
        assert 0.1 < np.nanmean(nees) < 8.0
    else:
        assert np.isnan(nees).all()


def test_user_estimator_with_own_motion_starts_on_hovering_copter(tmp_path):
    own = ("guidance.law=mine:law", "guidance.estimator=ekf:Bank")
    flight = recorded_flight(tmp_path / "run", "quickstart", *own).fly(70)
    flight.recorder.close()
    truth = flight.vehicle.truth
    offset = (truth.east - truth.target_east, truth.north - truth.target_north)
    assert np.hypot(*offset) == pytest.approx(100.0, abs=2.0)


def test_outcome_names_motion_when_user_estimator_gates_without(modules):
    (modules / "late.py").write_text(
        "from ekf import Bank\n"
        "class Late(Bank):\n"
        "    ready = False\n"
        "    def observe(self, sample):\n"
        "        return False if self.own is None else super().observe(sample)\n"
    )
    flight = recorded_flight(
        modules / "run", "quickstart", "guidance.estimator=late:Late", "link.wait_s=2"
    ).fly(5)
    flight.recorder.close()
    assert re.fullmatch(
        r"\d+ ranges gated, estimator late:Late has not converged yet; this estimator first needs"
        r" the vehicle's motion \(estimator auto does not\)",
        flight.pilot.mission.outcome.reason,
    )


@pytest.mark.parametrize(
    ("name", "error"),
    [
        ("mine:lew", "mine:lew cannot be imported: AttributeError"),
        ("no_such_module:law", "cannot be imported: ModuleNotFoundError"),
        ("wrong:estimate", "must be a function from the circle to a law.*AttributeError"),
        ("wrong:number", "must be a function from the circle to a law.*returns 1.0"),
        ("code:interact", "code is a module of Python's standard library"),
    ],
)
def test_unusable_law_is_refused_with_reason(name, error, circnav):
    with pytest.raises(OwnCodeError, match=error):
        Guidance(ORBIT, name)
    ran = circnav("check", "quickstart", "--set", f"guidance.law={name}")
    assert (ran.code, "FAIL  own code" in ran.out) == (2, True)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mine:law", "on the circle it returns -0.150 rad/s, the circle needs -0.150 rad/s"),
        ("wrong:nan", "law wrong:nan returns nan on the circle, not a turn rate in rad/s"),
        ("wrong:crash", "wrong.py, line 4: ZeroDivisionError('division by zero')"),
        ("wrong:text", "wrong.py, line 5) returns '0.1', not a turn rate in rad/s"),
        ("wrong:never", "law wrong:never did not return within 0.2 s of processor time"),
    ],
)
def test_check_calls_user_law_once(name, words, circnav):
    ran = circnav("check", "quickstart", "--set", f"guidance.law={name}")
    assert words in ran.out
    assert (ran.code == 0) == (name == "mine:law")


def test_law_name_installed_by_two_packages_is_refused(modules, circnav):
    package = modules / "second-1.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Name: second\nVersion: 1\n")
    (package / "entry_points.txt").write_text("[circnav.laws]\ntwice = wrong:nan\n")
    ran = circnav("check", "quickstart", "--set", "guidance.law=twice")
    assert ran.code == 2
    assert "'twice' is defined by " in ran.out
    assert "spiral (mine:law)" in ran.out and "second (wrong:nan)" in ran.out


def test_malformed_package_of_another_program_is_ignored(modules, circnav):
    for name, text in (("broken", "[console_scripts\nfoo bar\n"), ("worse", "= \n\x00[]\n")):
        package = modules / f"{name}-1.dist-info"
        package.mkdir()
        (package / "METADATA").write_text(f"Name: {name}\nVersion: 1\n")
        (package / "entry_points.txt").write_text(text)
    (modules / "empty-1.dist-info").mkdir()
    assert circnav("check", "quickstart", "--set", "guidance.law=spiral").code == 0
    with pytest.raises(DriverError, match="no driver 'x'; there are dwm1001, lines, linktrack"):
        make_driver("x")


@pytest.mark.parametrize(
    "name", ["./mine.py:law", "/tmp/mine:law", "mine.py", "mine:law.__globals__"]
)
def test_mission_refuses_law_that_names_no_module(name):
    with pytest.raises(MissionError, match="is not one of 'smooth'"):
        parse_mission(small_mission.TEXT, "small.toml", [f"guidance.law={name}"])


def test_user_code_steers_vehicle_only_with_permission():
    """The named module does not exist, because reading a mission must not import user code."""
    own = ["guidance.law=absent:law", "guidance.estimator=absent:Filter"]
    with pytest.raises(MissionError, match=r"own_code_on_vehicle = true"):
        parse_mission(small_mission.TEXT, "small.toml", own)
    permitted = parse_mission(
        small_mission.TEXT, "small.toml", [*own, "guidance.own_code_on_vehicle=true"]
    )
    assert permitted.own_code == ["absent:law", "absent:Filter"]


CAMPAIGN = f'mission = "{ROOT}/config/campaign_mission.toml"\nruns = 2\n[vary]\n"guidance.law" = '


def test_campaign_varies_user_laws(modules):
    file = modules / "laws.toml"
    file.write_text(f'{CAMPAIGN}["smooth", "mine:law"]')
    assert prepare(load_campaign(file), 1).mission.own_code == ["mine:law"]


def test_campaign_refuses_missing_user_laws(modules, circnav):
    file = modules / "laws.toml"
    file.write_text(f'{CAMPAIGN}["smooth", "mine:lew"]')
    assert "mine:lew cannot be imported" in circnav("campaign", file).refused


def test_law_that_returns_nan_ends_flight_with_exit_action(tmp_path):
    flight = recorded_flight(tmp_path / "run", "quickstart", "guidance.law=wrong:nan").fly(20)
    flight.recorder.close()
    assert flight.pilot.mission.outcome.ending is Ending.ABORTED
    assert "unsafe setpoint of law wrong:nan not sent" in flight.pilot.mission.outcome.reason
    assert flight.pilot.done


def test_law_that_never_returns_ends_flight_with_exit_action(circnav, undrawn, tmp_path):
    folder = tmp_path / "run"
    law = ("--set", "guidance.law=wrong:stuck", "--out", folder)
    ran = circnav("fly", "quickstart", *law)
    assert ran.code == 4
    reason = json.loads((folder / "summary.json").read_text())["reason"]
    assert reason == "law wrong:stuck did not return within 0.2 s of processor time"
    ticks = (folder / "ticks.csv").read_text().splitlines()
    assert any(",leaving," in line for line in ticks)


def test_simulated_time_limit_ignores_waiting_of_busy_computer():
    def spend(clock):
        began = clock()
        while clock() < began + 0.5:
            if clock is time.monotonic:
                time.sleep(0.1)

    with time_limit(simulated=True):
        call("waits:law", spend, time.monotonic)
    with pytest.raises(StuckCodeError), time_limit(simulated=True):
        call("computes:law", spend, time.process_time)
    with pytest.raises(StuckCodeError), time_limit():
        call("waits:law", spend, time.monotonic)


def test_sigterm_ends_process_of_law_that_catches_everything():
    def law():
        caught = 0
        while caught < 2:
            try:
                while True:
                    pass
            except BaseException:
                caught += 1

    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with time_limit():
            call("stubborn:law", law)
        assert {signal.getsignal(number) for number in handlers} == {signal.SIG_DFL}
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def test_estimator_that_never_returns_ends_flight_with_safe_setpoint(circnav, undrawn, modules):
    (modules / "stuck.py").write_text(
        "from mine import Observer\n"
        "class Stuck(Observer):\n"
        "    def observe(self, sample):\n"
        "        while sample.time > 5: pass\n"
        "        return super().observe(sample)\n"
    )
    own = ("--set", "guidance.law=mine:law", "--set", "guidance.estimator=stuck:Stuck")
    ran = circnav("fly", "quickstart", *own, "--out", modules / "run")
    assert ran.code == 1
    assert "estimator stuck:Stuck did not return within 0.2 s of processor time" in ran.line


def test_law_that_raises_ends_flight_with_safe_setpoint(circnav, undrawn, tmp_path):
    ran = circnav(
        "fly", "quickstart", "--set", "guidance.law=wrong:late", "--out", tmp_path / "run"
    )
    assert ran.code == 1
    assert re.match(
        r"circnav: law wrong:late failed at .*wrong\.py, line 6: ZeroDivisionError", ran.line
    )
