"""The emulated plane and copter oscillate with the gains with which the real firmware oscillates,
and only with these.

Real firmware, flown with the gains below as `flown` (DISTANCE_SENSOR 0.5 m at 10 Hz, calm air, 11
to 21 ms of round-trip delay, last two laps): ArduPlane 4.6.3 at R 150, V 22: radius RMS 0.8 to 1.7
m, commanded turn sd 11.7 to 14 deg/s, roll -43 to +51 deg; ArduCopter at R 30, V 5: sd 26 to 30
deg/s at 1 Hz. Without lead: sd 0.3 to 1 deg/s, radius RMS 0.28 to 0.33 m and 0.15 m.
"""

from collections.abc import Callable
from math import cos, degrees, inf, pi, remainder, sin

import numpy as np
import pytest
from circnav_sim.airframes import multicopter

from circnav_mav.guidance import step
from circnav_mav.guidance.step import Inputs, StepSettings
from circnav_mav.guidance.types import RelativeMotion
from circnav_mav.guidance.vector_field import field_heading
from tests.flight.lockstep import (
    Flight,
    clockwise_turns,
    flight,
    last_third,
    rms_error,
    tangent,
    true_radius,
    unrest,
)
from tests.tools.fault_link.pipe import Impairment, Pipe

RADIUS = {"arduplane": 150.0, "arducopter": 30.0}
SPEED = {"arduplane": 22.0, "arducopter": 5.0}
APPROACH = 50.0
LAG = {"arduplane": 0.5, "arducopter": 0.7}  # turn_lag_s of the missions flown on firmware, s


def as_shipped(mission: str) -> Callable[..., float]:
    """Return the law as first flown on firmware. It is designed for a pure first-order lag without
    dead time, and its lead compensates the whole lag."""

    before = {"psi": 0.0, "time": -inf, "rate": 0.0}

    def steer(
        settings: StepSettings, found: RelativeMotion, _change: object, inputs: Inputs
    ) -> float:
        lag = LAG[mission]
        delay = 0.022
        sense = settings.sense
        V = found.airspeed
        r_d = settings.r_d
        lead = 1 - 2 * delay / lag
        left = lag / (1 + lead)
        heading = 0.5 / (left + delay)
        p = (found.x, found.y * sense)
        d = (found.drift_x, found.drift_y * sense)
        psi = found.heading * sense
        if inputs.time - before["time"] > 0.001:
            before["rate"] = remainder(psi - before["psi"], 2 * pi) / (inputs.time - before["time"])
            before["psi"], before["time"] = psi, inputs.time
        rate = before["rate"]

        def wanted(ahead: float) -> float:
            at = psi + rate * ahead / 2
            there = (
                p[0] + d[0] * ahead + V * ahead * cos(at),
                p[1] + d[1] * ahead + V * ahead * sin(at),
            )
            k = heading / (2.5 * V)
            return float(field_heading(there, d, V=V, r_d=r_d, k=k, max_turn_rate=settings.limit))

        rotation = remainder(wanted(left + 0.05) - wanted(left - 0.05), 2 * pi) / 0.1
        aimed = rotation + heading * remainder(wanted(0.0) - psi, 2 * pi)
        return aimed + lead * (aimed - rate)

    return steer


def laps(mission: str, *overrides: str, count: int = 1) -> Flight:
    """Fly laps after the approach, with 10 to 22 ms of round-trip delay."""
    duration = APPROACH + count * lap(mission)
    lag = "sim.truth.rate_hz=10", f"vehicle.turn_lag_s={LAG[mission]}"
    flown = flight(mission, *lag, *overrides, f"limits.duration_s={duration}", law="auto")
    flown.down, flown.up = (
        Pipe(Impairment(delay=0.005, jitter=0.006, in_order=True), seed) for seed in (1, 2)
    )
    return flown.fly(duration + 30)


def lap(mission: str) -> float:
    return 2 * pi * RADIUS[mission] / SPEED[mission]


def last_lap(flown: Flight, mission: str) -> tuple[float, float, float, list[float]]:
    """Return radius RMS, m; standard deviation of the commanded turn rate, deg/s; laps round the
    target; smallest and largest roll, deg."""
    begin = flown.now - lap(mission)
    truths = [truth for truth in flown.truths if truth.time > begin]
    turns = [
        tick.turn_rate for tick in flown.ticks if tick.time > begin and tick.turn_rate is not None
    ]
    rolls = [degrees(truth.roll) for truth in truths]
    sd = degrees(float(np.std(turns)))
    return rms_error(truths, RADIUS[mission]), sd, clockwise_turns(truths), [min(rolls), max(rolls)]


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("mission", "least", "most"), [("arduplane", 8.0, 14.1 * 1.5), ("arducopter", 26 / 1.5, 45.0)]
)
def test_emulator_oscillates_with_gains_that_oscillate_on_firmware(
    mission, least, most, monkeypatch
):
    """least, most: bounds of the standard deviation of the commanded turn rate, deg/s, from the
    firmware flights above."""
    monkeypatch.setattr(step, "_by_drift", as_shipped(mission))
    flown = laps(mission)
    rms, sd, turns, rolls = last_lap(flown, mission)
    assert least < sd < most
    assert turns > 0.8
    if mission == "arduplane":
        assert 0.8 / 1.5 < rms < 1.7 * 1.5
        assert rolls[0] < -25 and rolls[1] > 45
        return
    # frequency of the oscillation over the last 20 s (400 ticks of 50 ms)
    rates = [tick.turn_rate for tick in flown.ticks[-400:] if tick.turn_rate is not None]
    crossings = np.count_nonzero(np.diff(np.sign(np.array(rates) - np.mean(rates))))
    assert crossings / 40 == pytest.approx(1.0, abs=0.2)  # frequency of the oscillation, Hz


@pytest.mark.parametrize(
    ("mission", "overrides", "count", "most"),
    [
        ("arduplane", tangent(180.0), 1, 0.32),
        pytest.param("arducopter", (), 2, 0.12, marks=pytest.mark.nightly),
    ],
)
def test_default_gains_fly_circle_without_oscillation(
    mission: str, overrides: tuple[str, ...], count: int, most: float
) -> None:
    """On firmware the commanded turn has a standard deviation of 0.2 deg/s on both vehicles.
    `most`: largest radius RMS, m. Without the hypothesis of constant drift, the filter reached 0.8
    m (plane) and 0.15 m (copter)."""
    flown = laps(mission, *overrides, count=count)
    rms, sd, turns, _ = last_lap(flown, mission)
    assert sd < 0.55 and rms < most
    assert turns > 0.95
    assert {tick.gain_share for tick in flown.ticks} == {1.0}
    assert flown.ticks[-1].turn_delay < 1.0


TIGHT = (
    "orbit.radius_m=60.0",
    "vehicle.speed_mps=15.0",
    "sim.vehicle.cruise_speed_mps=15.0",
    "sim.wind.speed_mps=5.0",
)


@pytest.mark.parametrize(
    ("mission", "overrides", "frequency", "damping", "at", "until", "quiet", "off"),
    [
        ("ardurover", (), 4.0, 0.1, 20.0, 60.0, 2.0, 0.1),
        pytest.param(
            *("arduplane", TIGHT, 4.4, 0.05, 45.0, 100.0, 11.0, 0.15), marks=pytest.mark.nightly
        ),
    ],
    ids=["rover, steering badly tuned", "plane, roll rings on a tight circle in wind"],
)
def test_limit_cycle_lowers_gains_on_oscillating_vehicle(
    mission, overrides, frequency, damping, at, until, quiet, off
):
    """frequency (rad/s), damping: of the vehicle's turn. at: latest alarm, s. quiet, off: largest
    turn standard deviation (deg/s) and radius error (share) at the end. Before the detection the
    plane's bank oscillates at 0.7 Hz between -4 and 48 deg. In this wind the circle itself requires
    10 to 32 deg/s of turn during a lap, on average 18 deg/s."""
    loop = (f"sim.vehicle.turn_frequency_rad_s={frequency}", f"sim.vehicle.turn_damping={damping}")
    flown = flight(mission, *overrides, *loop, law="auto").fly(until)
    alarms = [time for time, data in flown.sent if b"limit cycle, gains reduced to 70 %" in data]
    assert alarms[0] < at
    assert unrest(flown) < quiet
    radius = flown.pilot.settings.orbit.radius
    assert max(abs(true_radius(truth) / radius - 1) for truth in last_third(flown)) < off


def test_slow_limit_cycle_is_ended_by_reduced_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    """A copter at its acceleration limit that executes only 0.4 of the feedforward acceleration:
    its turn oscillates with periods of 5 to 6 s. With full gains the radius error is 4 m, and the
    standard deviation of the turn 17 deg/s."""
    monkeypatch.setattr(multicopter, "FEED_SHARE", 0.4)
    fast = "vehicle.speed_mps=7.0", "vehicle.max_turn_rate_deg_s=30.0", "orbit.radius_m=45.0"
    radio = (
        "ranging.rate_hz=20.0",
        "ranging.sigma_m=0.3",
        "sim.ranging.rate_hz=20.0",
        "sim.ranging.noise_m=0.3",
    )
    flown = flight("arducopter", *fast, *radio, "sim.seed=3", law="auto").fly(90)
    alarms = [time for time, data in flown.sent if b"limit cycle, gains reduced to 70 %" in data]
    assert alarms[0] < 45.0
    assert unrest(flown) < 2.0 and rms_error(last_third(flown), 45.0) < 1.0
    assert clockwise_turns(flown.truths) > 1.0


def test_limit_cycle_of_law_on_range_is_ended_by_reduced_gain() -> None:
    """The default gain of `feedforward` is 0.024 rad/m here. With 0.12 rad/m, the command is at its
    limit for 80 % of the time and the radius error is 11 m, unless the gain is reduced."""
    gain = "guidance.gain=0.12", 'guidance.estimator="kalman"'
    flown = flight("arduplane", *gain, law="feedforward").fly(90)
    assert any(b"limit cycle, gains reduced" in data for _, data in flown.sent)
    assert unrest(flown) < 4.0 and rms_error(last_third(flown), 150.0) < 3.0
