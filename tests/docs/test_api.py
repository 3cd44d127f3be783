"""The public API: run the examples of README and docs/api.md as printed, and circle a beacon with
them."""

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import takewhile
from json import loads
from math import cos, hypot, inf, nan, radians, sin
from pathlib import Path
from rlcompleter import Completer
from typing import Any

import pytest

import circnav_mav
from circnav_mav import (
    Direction,
    Guidance,
    LawChoice,
    Orbit,
    OwnMotion,
    RangeEstimate,
    RangeSample,
    tune,
)
from circnav_mav.guidance.types import IntegratedAcceleration
from circnav_mav.mission.load import parse_mission
from tests import small_mission

ROOT = Path(__file__).parents[2]
ORBIT = Orbit(100.0, Direction.CLOCKWISE, 15.0, 0.35)


def blocks(page: str) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(), re.MULTILINE | re.DOTALL)


def examples() -> dict[str, Any]:
    """Return the names that the code blocks of docs/api.md define."""
    names: dict[str, Any] = {}
    for block in blocks("docs/api.md"):
        exec(block, names)
    return names


class World:
    """A simulated vehicle in wind that turns at `gain` times the command, and a beacon at (0, 0).
    Independent of the emulator."""

    def __init__(self, V: float, *, gain: float = 1.0, wind: float = 0.0) -> None:
        self.V = V
        self.gain = gain
        self.wind = wind
        self.x = -2.5 * V * 10
        self.y = V * 10
        self.heading = 0.3
        self.turn_rate = 0.0
        self.now = 0.0

    def fly(self, guidance: Guidance, seconds: float, *, ranging: bool = True) -> None:
        for _ in range(round(seconds * 20)):
            if ranging:
                guidance.update_range(RangeSample(self.now, self.now, self.radius, 0.5))
            guidance.update_motion(OwnMotion(self.now, self.heading, self.turn_rate, self.V))
            command = guidance.command(self.now)
            self.step(command.turn_rate if command else 0.0)

    def step(self, commanded: float) -> None:
        self.turn_rate = self.gain * commanded
        self.heading += 0.05 * self.turn_rate
        self.x += 0.05 * (self.V * cos(self.heading) + self.wind)
        self.y += 0.05 * self.V * sin(self.heading)
        self.now += 0.05

    @property
    def radius(self) -> float:
        return hypot(self.x, self.y)

    @property
    def sense(self) -> Direction:
        """Sense of rotation, from the angular momentum about the beacon."""
        left = self.x * sin(self.heading) - self.y * cos(self.heading) > 0
        return Direction.COUNTERCLOCKWISE if left else Direction.CLOCKWISE


def test_loop_of_readme_circles_clockwise(capsys):
    (loop,) = blocks("README.md")
    assert loop.count("CLOCKWISE") == 1
    flown: dict[str, Any] = {}
    exec(loop, flown)
    moment = flown["x"] * sin(flown["heading"]) - flown["y"] * cos(flown["heading"])
    assert hypot(flown["x"], flown["y"]) == pytest.approx(100.0, abs=1.0)
    assert moment == pytest.approx(-100.0, abs=1.0)
    assert "100 m" in capsys.readouterr().out


def test_guidance_compensates_turn_gain():
    world = World(15.0, gain=0.75)
    world.fly(Guidance(ORBIT, "feedforward"), 120.0)
    assert world.radius == pytest.approx(100.0, rel=0.01)


def test_guidance_finds_target_in_wind():
    locate = examples()["locate"]
    world = World(15.0, wind=4.0)
    guidance = Guidance(ORBIT)
    assert locate(guidance, 0.0, 0.0, 0.0) is None
    world.fly(guidance, 70.0)
    assert locate(guidance, world.now, world.x, world.y) == pytest.approx((0.0, 0.0), abs=5.0)
    assert guidance.estimate(world.now).relative.drift_x == pytest.approx(4.0, abs=0.5)
    assert world.radius == pytest.approx(100.0, rel=0.05)


@pytest.mark.parametrize(
    ("name", "direction"), [("own", Direction.COUNTERCLOCKWISE), ("bold", Direction.CLOCKWISE)]
)
def test_guidance_with_user_law_and_gain_reaches_circle(name, direction):
    world = World(12.0)
    world.fly(examples()[name], 80.0)
    assert world.radius == pytest.approx(60.0, rel=0.05)
    assert world.sense is direction


def test_guidance_coasts_on_circle_during_outage_in_wind():
    world = World(15.0, wind=4.0)
    guidance = Guidance(ORBIT, coast=10.0)
    world.fly(guidance, 70.0)
    world.fly(guidance, 10.0, ranging=False)
    assert guidance.command(world.now) is not None
    assert world.radius == pytest.approx(100.0, rel=0.05)
    world.fly(guidance, 1.0, ranging=False)
    assert guidance.command(world.now) is None


def received(guidance: Guidance, ranges: Callable[[float], float] = lambda time: 150.0) -> Guidance:
    for step in range(20):
        assert guidance.update_range(RangeSample(step / 10, step / 10, ranges(step / 10), 0.5))
    return guidance


def test_guidance_commands_nothing_without_fresh_estimate():
    guidance = Guidance(ORBIT, "feedforward")
    assert guidance.command(0.0) is None
    guidance.update_range(RangeSample(-0.1, -0.1, 150.0, 0.5))
    assert guidance.command(0.0) is None  # one range gives no range rate
    received(guidance)
    assert not guidance.update_range(RangeSample(2.3, 2.3, 400.0, 0.5))
    assert guidance.command(2.4) is not None
    assert guidance.command(2.5) is None
    assert guidance.estimate(nan) is None


def test_guidance_ignores_range_with_stamp_in_future():
    guidance = received(Guidance(ORBIT, "feedforward"))
    assert guidance.update_range(RangeSample(32.0, 32.0, 150.0, 0.5))
    assert guidance.command(2.1) is None


@pytest.mark.parametrize(
    ("law", "step", "before"),
    [("auto", 60.0, 0.05), ("smooth", 1e5, 30.0), ("auto", 1.7e9, 30.0), ("auto", -3600.0, 30.0)],
)
def test_guidance_flies_circle_after_step_of_host_clock(law, step, before):
    world = World(15.0)
    guidance = Guidance(ORBIT, law)
    world.fly(guidance, before)
    world.now += step
    assert guidance.command(world.now) is None
    world.fly(guidance, 70.0)
    assert world.radius == pytest.approx(100.0, abs=1.0)
    assert world.sense is Direction.CLOCKWISE


def test_guidance_limits_turn_rate_of_user_law():
    for turn, commanded in ((9.0, 0.35), (-9.0, -0.35), (0.1, 0.1)):
        command = received(Guidance(ORBIT, lambda estimate, turn=turn: turn)).command(2.0)
        assert (command.turn_rate, command.saturated) == (commanded, turn != commanded)


def test_guidance_uses_estimate_of_user_estimator():
    class Recorder:
        ready = True
        nis = None

        def observe(self, sample):
            self.sample = sample
            return True

        def move(self, own):
            pass

        def at(self, time):
            return RangeEstimate(time, self.sample.r, 7.0, 0.1, 0.1)

    guidance = received(Guidance(ORBIT, lambda estimate: 0.01 * estimate.r_dot, Recorder()))
    assert guidance.command(2.0).turn_rate == pytest.approx(0.07)


NO_MEASUREMENT = (
    *({"r": value} for value in (nan, inf, 0.0, -1.0)),
    *({name: value} for name in ("stamp", "time") for value in (nan, inf)),
    *({"sigma": value} for value in (nan, -1.0, 1e200)),
)
NO_MOTION = (
    *({name: nan} for name in ("time", "heading", "turn_rate", "airspeed", "bank_turn")),
    {"airspeed": 1e200},
    {"airspeed": 0.0},
    {"acceleration": IntegratedAcceleration(nan, 0.0, 0.0)},
)


@pytest.mark.parametrize("law", ["auto", "feedforward"])
def test_guidance_rejects_invalid_samples_and_motion(law):
    """Radios and drivers report NaN, infinity, 0 or -1 when they have no measurement."""
    spoiled = Guidance(ORBIT, law)
    whole = Guidance(ORBIT, law)
    world = World(15.0)
    for step in range(100):
        sample = RangeSample(world.now, world.now, world.radius, 0.5)
        own = OwnMotion(world.now, world.heading, world.turn_rate, world.V)
        assert not spoiled.update_range(
            sample._replace(**NO_MEASUREMENT[step % len(NO_MEASUREMENT)])
        )
        assert not spoiled.update_motion(own._replace(**NO_MOTION[step % len(NO_MOTION)]))
        for guidance in (spoiled, whole):
            assert guidance.update_range(
                sample._replace(r_dot=nan if guidance is spoiled and step % 2 else None)
            )
            assert guidance.update_motion(own)
        command = whole.command(world.now)
        assert spoiled.command(world.now) == command
        world.step(command.turn_rate if command else 0.0)


def test_guidance_commands_only_finite_turn_rates():
    for turn in (nan, inf):
        assert received(Guidance(ORBIT, lambda estimate, turn=turn: turn)).command(2.0) is None


def law_of_text(estimate):
    return "0.1"


def law_of_library(estimate):
    return loads("{")


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (law_of_text, r"law law_of_text \(.*test_api\.py, line \d+\) returns '0\.1', not a turn"),
        (lambda estimate: None, r"test_api\.py, line \d+\) returns None, not a turn rate in rad/s"),
        (lambda estimate: 1 / 0, r"test_api\.py, line \d+: ZeroDivisionError"),
        (law_of_library, r"law law_of_library failed at .*test_api\.py, line \d+: JSONDecodeError"),
    ],
)
def test_guidance_names_line_of_failing_user_law(law, words):
    with pytest.raises(ValueError, match=words):
        received(Guidance(ORBIT, law)).command(2.0)


@pytest.mark.parametrize("law", ["auto", "feedforward", "smooth", "switching"])
def test_tune_returns_gain_of_mission(law):
    overrides = (
        f"guidance.law={law}",
        "vehicle.turn_lag_s=0.9",
        "ranging.sigma_m=2.0",
        "ranging.rate_hz=4.0",
    )
    mission = parse_mission(small_mission.TEXT, "small.toml", overrides)
    orbit = Orbit(100.0, Direction.CLOCKWISE, 15.0, radians(20.0))
    assert tune(orbit, law, turn_lag=0.9, sigma=2.0, rate=4.0) == mission.law


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Guidance(ORBIT, "magic"), "law 'magic' is not one of smooth"),
        (lambda: Guidance(ORBIT, LawChoice("magic", 1.0)), "law 'magic' is not one of smooth"),
        (lambda: tune(ORBIT, "magic"), "law 'magic' is not one of smooth"),
        (lambda: Guidance(ORBIT, estimator="magic"), "estimator 'magic' is not one of kalman"),
        (lambda: Guidance(ORBIT, LawChoice("smooth", 1e-6)), "must be above"),
        (
            lambda: Guidance(replace(ORBIT, radius=0.0)),
            "orbit.radius: must be a finite number above 0, not 0",
        ),
        (
            lambda: Guidance(replace(ORBIT, speed=nan)),
            "orbit.speed: must be a finite number above 0, not nan",
        ),
        (
            lambda: Guidance(replace(ORBIT, max_turn_rate=-0.4)),
            "orbit.max_turn_rate: must be a finite number above 0",
        ),
        (
            lambda: Guidance(replace(ORBIT, max_turn_rate=20.0)),
            "orbit.max_turn_rate: 20 rad/s .* not deg/s",
        ),
        (
            lambda: Guidance(replace(ORBIT, direction="clockwise")),
            "orbit.direction: must be Direction.CLOCKWISE or",
        ),
        (lambda: Guidance(replace(ORBIT, radius=40.0)), "needs 0.375 rad/s, more than"),
        (lambda: Guidance(ORBIT, turn_lag=nan), "turn_lag: must be 0 to 10 s, not nan"),
        (lambda: Guidance(ORBIT, turn_lag=40.0), "turn_lag: must be 0 to 10 s, not 40"),
        (
            lambda: Guidance(ORBIT, LawChoice("smooth", 1e-4, lag=inf)),
            "turn_lag: must be 0 to 10 s, not inf",
        ),
        (lambda: Guidance(ORBIT, stale=-1.0), "stale: must be at least 0 s, not -1"),
        (lambda: Guidance(ORBIT, LawChoice("smooth", -1e-4)), "gain: must be .* above 0"),
        (lambda: tune(ORBIT, sigma=0.0), "sigma: must be a finite number above 0, not 0"),
        (lambda: tune(ORBIT, rate=0.0), "rate: must be a finite number above 0, not 0"),
    ],
)
def test_guidance_error_names_invalid_argument(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_api_page_lists_public_names():
    rows = re.findall(r"^\| (`.*?`) \|", (ROOT / "docs" / "api.md").read_text(), re.MULTILINE)
    listed = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
    assert sorted(listed) == sorted(circnav_mav.__all__)
    assert all(hasattr(circnav_mav, name) for name in circnav_mav.__all__)


def test_interpreter_completes_only_public_names():
    completer = Completer({"circnav_mav": circnav_mav})
    found = list(
        takewhile(bool, (completer.complete("circnav_mav.", number) for number in range(99)))
    )
    assert [name.removeprefix("circnav_mav.").rstrip("()") for name in found] == sorted(
        circnav_mav.__all__
    )
