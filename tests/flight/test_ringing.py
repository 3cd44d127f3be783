"""The emulated plane and copter swing where the real ones swing, and are quiet where those are quiet.

Real firmware, flown with the gains below as `flown` (DISTANCE_SENSOR .5 m at 10 Hz, calm air, 11 .. 21 ms there and
back, last two laps): ArduPlane 4.6.3 at R 150, V 22: radius RMS .8 .. 1.7 m, commanded turn sd 11.7 .. 14 deg/s, roll
-43 .. +51 deg; ArduCopter at R 30, V 5: sd 26 .. 30 deg/s at 1 Hz. Without lead: sd .3 .. 1 deg/s, .28 .. .33, .15 m.
"""

from collections.abc import Callable
from math import degrees, pi

import numpy as np
import pytest

from circnav_mav.core import guidance
from circnav_mav.core.drift_law import DriftGains
from sim.faults.impairment import Impairment
from sim.faults.pipe import Pipe
from tests.flight.lockstep import Flight, clockwise_turns, flight, rms_error

RADIUS, SPEED = {"arduplane": 150.0, "arducopter": 30.0}, {"arduplane": 22.0, "arducopter": 5.0}
LAG = {"arduplane": 0.5, "arducopter": 0.7}  # turn_lag_s of the missions flown
Gains = Callable[..., DriftGains]


def flown_gains(V: float, lag: float, delay: float) -> DriftGains:
    """As flown on firmware: made for a pure first-order lag, with a full lead."""
    lead = max(1 - 2 * delay / lag, 0.0)
    left = lag / (1 + lead)
    heading = 0.5 / (left + delay)
    return DriftGains(heading, heading / (2.5 * V), lead, left, delay)


def quiet_gains(V: float, lag: float, delay: float) -> DriftGains:
    """Slower and without lead."""
    return DriftGains(1.0, 1.0 / (2.5 * V), 0.0, 0.5, delay)


def laps(mission: str, gains: Gains, monkeypatch: pytest.MonkeyPatch) -> Flight:
    """Three laps after a minute of approach. The one place that knows how the pilot comes by its gains."""
    monkeypatch.setattr(guidance, "drift_gains", lambda V, r_d, lag, *, delay=0.0: gains(V, LAG[mission], delay))
    duration = 60 + 3 * lap(mission)
    flown = flight(mission, f"vehicle.turn_lag_s={LAG[mission]}", f"limits.duration_s={duration}", law="auto")
    flown.down, flown.up = (Pipe(Impairment(delay=0.005, jitter=0.006, in_order=True), seed) for seed in (1, 2))
    return flown.fly(duration + 30)


def lap(mission: str) -> float:
    return 2 * pi * RADIUS[mission] / SPEED[mission]


def last_two_laps(flown: Flight, mission: str) -> tuple[float, float, float, list[float]]:
    """Radius RMS, m; sd of the commanded turn rate, deg/s; turns round the target; roll, deg, smallest and largest."""
    begin = flown.now - 2 * lap(mission)
    truths = [truth for truth in flown.truths if truth.time > begin]
    turns = [tick.turn_rate for tick in flown.ticks if tick.time > begin and tick.turn_rate is not None]
    rolls = [degrees(truth.roll) for truth in truths]
    sd = degrees(float(np.std(turns)))
    return rms_error(truths, RADIUS[mission]), sd, clockwise_turns(truths), [min(rolls), max(rolls)]


def test_the_plane_swings_with_the_gains_that_swing_on_firmware(monkeypatch: pytest.MonkeyPatch) -> None:
    rms, sd, turns, rolls = last_two_laps(laps("arduplane", flown_gains, monkeypatch), "arduplane")
    assert 8.0 < sd < 14.1 * 1.5 and 0.8 / 1.5 < rms < 1.7 * 1.5
    assert rolls[0] < -25 and rolls[1] > 45
    assert turns > 1.9


def test_the_copter_swings_with_the_gains_that_swing_on_firmware(monkeypatch: pytest.MonkeyPatch) -> None:
    flown = laps("arducopter", flown_gains, monkeypatch)
    _, sd, turns, _ = last_two_laps(flown, "arducopter")
    assert 26 / 1.5 < sd < 30 * 1.5
    assert turns > 1.9
    rates = [tick.turn_rate for tick in flown.ticks[-400:] if tick.turn_rate is not None]  # 20 s of 50 ms ticks
    crossings = np.count_nonzero(np.diff(np.sign(np.array(rates) - np.mean(rates))))
    assert crossings / 40 == pytest.approx(1.0, abs=0.2)  # Hz


@pytest.mark.parametrize(("mission", "most"), [("arduplane", 0.5), ("arducopter", 0.3)])
def test_slower_gains_without_lead_fly_quietly_and_truly(
    mission: str, most: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rms, sd, turns, _ = last_two_laps(laps(mission, quiet_gains, monkeypatch), mission)
    assert sd < 2.0 and rms < most
    assert turns > 1.9
