"""The turn command's figures, and a limit cycle told from wind, noise and gusts."""

from math import degrees, pi

import numpy as np
import pytest

from circnav_mav.guidance.types import Direction, Orbit
from circnav_mav.runlog.metrics import turn_figures

V, R, LIMIT, STEP = 22.0, 150.0, 0.45, 0.05
ORBIT = Orbit(R, Direction.CLOCKWISE, V, LIMIT)
TIME = np.arange(0.0, 100.0, STEP)


def needed(wind):
    """What the circle asks for in steady wind: the nose's rate on a circle over the ground, step by step."""
    at, noses = 0.0, []
    for _ in TIME:
        along = np.array([-np.sin(at), np.cos(at)])
        ground = wind * along[0] + np.sqrt(V**2 - wind**2 * (1 - along[0] ** 2))
        noses.append(np.arctan2(*(ground * along - np.array([wind, 0.0]))[::-1]))
        at += ground / R * STEP
    return -np.gradient(np.unwrap(noses), STEP)


def coloured(size, seconds, seed=1):
    """Noise of a standard deviation (rad/s) that forgets within so many seconds, as the answer to gusts does."""
    chance, keep, values = np.random.default_rng(seed), np.exp(-STEP / seconds), [0.0]
    for fresh in chance.standard_normal(len(TIME) - 1):
        values.append(keep * values[-1] + size * np.sqrt(1 - keep**2) * fresh)
    return np.array(values)


def swinging(size, period):
    return size * np.sin(2 * pi * TIME / period)


def named(command):
    cut = np.clip(command, -LIMIT, LIMIT)
    return turn_figures(TIME, cut, ORBIT).turn_limit_cycle


def test_figures_of_a_relay_between_the_limits_are_those_drawn_by_hand():
    """Half a second each way: LIMIT deviates by itself, and 4 LIMIT are travelled in a second."""
    relay = np.where(np.arange(len(TIME)) // 10 % 2 == 0, LIMIT, -LIMIT)
    found = turn_figures(TIME, relay, ORBIT)
    assert found.turn_std_deg_s == pytest.approx(degrees(LIMIT))
    assert (found.turn_at_limit, found.turn_limit_cycle) == (1.0, True)
    assert found.turn_variation_rad_s2 == pytest.approx(4 * LIMIT, rel=0.01)
    assert turn_figures(TIME, relay / 1.2, ORBIT, at_limit=relay > 0).turn_at_limit == 0.5
    assert turn_figures(TIME, np.full_like(TIME, np.nan), ORBIT) is None


@pytest.mark.parametrize("wind", [0.0, 8.0, 0.5 * V])
def test_what_the_circle_itself_asks_for_in_wind_is_no_limit_cycle(wind):
    """Its amplitude is 2 W/R to first order in W/V: as much from the ground speed as from the crab angle."""
    command = needed(wind)
    assert turn_figures(TIME, command, ORBIT).turn_std_deg_s == pytest.approx(degrees(2**0.5 * wind / R), rel=0.1)
    assert not named(command)
    assert not named(command + coloured(0.03, 0.2))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("seconds", [0.1, 0.5, 2.0])
def test_a_busy_command_without_a_rhythm_is_no_limit_cycle(seconds, seed):
    """The answer to strong gusts: 11 deg/s of standard deviation, at the limit now and then."""
    assert not named(needed(8.0) + coloured(0.2, seconds, seed))


@pytest.mark.parametrize("wind", [0.0, 8.0])
@pytest.mark.parametrize(("size", "period"), [(0.12, 2.5), (0.3, 1.0), (0.5, 4.6)])
def test_a_command_that_rings_is_a_limit_cycle_in_wind_and_noise_too(size, period, wind):
    """Periods as flown on firmware: 1 s (copter), 2.5 .. 4.6 s (planes)."""
    assert named(needed(wind) + swinging(size, period) + coloured(0.04, 0.5))


def test_a_loop_that_gusts_drive_from_limit_to_limit_is_one_though_it_has_lost_its_rhythm():
    chance = np.random.default_rng(3)
    phase = 2 * pi * np.cumsum(STEP / 2.0 * np.exp(coloured(0.5, 2.0))) + chance.uniform(0, 6)
    assert named(np.clip(2.0 * np.sin(phase), -LIMIT, LIMIT))


def test_a_quiet_command_is_none_whatever_its_rhythm():
    """Swings of 1.1 deg/s, where the limit is 26."""
    assert not named(needed(8.0) + swinging(0.02, 2.0))


def test_less_than_half_a_lap_is_too_little_to_name_a_limit_cycle():
    few = slice(0, round((0.5 * 2 * pi * R / V - 0.1) / STEP))
    ringing = swinging(0.3, 2.0)
    assert named(ringing)
    assert not turn_figures(TIME[few], ringing[few], ORBIT).turn_limit_cycle
