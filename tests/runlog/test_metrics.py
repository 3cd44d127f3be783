"""Figures of a circle and of its turn command, calculated by hand, and the detection of a limit
cycle in wind, noise and gusts."""

from math import degrees, pi

import numpy as np
import pytest

from circnav_mav.guidance.types import Direction, Orbit
from circnav_mav.runlog import metrics
from circnav_mav.runlog.metrics import turn_figures

CLOCKWISE = Direction.CLOCKWISE
COUNTERCLOCKWISE = Direction.COUNTERCLOCKWISE
V = 22.0
R = 150.0
LIMIT = 0.45
STEP = 0.05
ORBIT = Orbit(R, CLOCKWISE, V, LIMIT)
TIME = np.arange(0.0, 100.0, STEP)


def column(*values):
    return np.array(values, dtype=float)


@pytest.mark.parametrize(
    ("radius", "settled"),
    [
        ([150] * 20 + [104] * 80, 20.0),
        ([150] * 20 + [95, 105] * 40, 20.0),
        ([150] * 20 + [94.9, 105.1] * 40, None),
        ([150] * 20 + [100] * 20 + [120] * 3 + [100] * 57, 20.0),
        ([150] * 20 + [100] * 20 + [120] * 5 + [100] * 55, 45.0),
        ([150] * 20 + [100] * 76 + [120] * 4, 20.0),
        ([150] * 20 + [100] * 75 + [120] * 5, None),
        ([150] * 20 + [100] * 40 + [np.nan] + [100] * 39, 20.0),
        ([100] * 100, 0.0),
        ([150] * 66 + [100] * 34, 66.0),
        ([150] * 67 + [100] * 33, None),
    ],
)
def test_radius_settles_when_95_percent_stay_within_5_percent(radius, settled):
    """At r_d = 100 m the band is 95 to 105 m, both included. The settling time is measured from the
    first sample."""
    assert metrics.settled(np.arange(10.0, 110.0), column(*radius), 100.0) == settled


def test_settling_needs_last_third_within_the_band():
    """The range oscillates by 8 m about 100 m with a period of 40 s, and never stays in the
    band."""
    time = np.arange(0.0, 301.0)
    for entered, settled in ((60, 60.0), (200, 200.0), (201, None)):
        assert metrics.settled(time, np.where(time < entered, 150.0, 101.0), 100.0) == settled
    time = np.arange(0.0, 195.0)
    assert metrics.settled(time, 100 - 8 * np.cos(2 * np.pi * time / 40), 100.0) is None


def test_flight_without_samples_has_no_figures():
    empty = column()
    assert metrics.settled(empty, empty, 100.0) is None
    assert metrics.mean(empty) is metrics.rms_error(empty, 100.0) is None
    assert metrics.swept_angle(empty, empty) == len(metrics.last_part(empty, empty)) == 0
    assert turn_figures(TIME, np.full_like(TIME, np.nan), ORBIT) is None


def test_last_third_is_chosen_by_time():
    time = column(0, 1, 2, 3, 4, 5, 20, 30)
    assert list(metrics.last_part(time, time)) == [20, 30]
    assert list(metrics.last_part(column(0, 1, 2, 3), column(5, 6, 7, 8))) == [7, 8], (
        "samples at both ends of the last third are included"
    )


def test_rms_error_shows_oscillation_around_exact_mean():
    assert (metrics.mean(column(90, 110)), metrics.rms_error(column(90, 110), 100.0)) == (
        100.0,
        10.0,
    )


@pytest.mark.parametrize(
    ("turns", "direction"),
    [
        (1.0, COUNTERCLOCKWISE),
        (-3.7, CLOCKWISE),
        (0.26, COUNTERCLOCKWISE),
        (-0.26, CLOCKWISE),
        (0.24, None),
        (-0.24, None),
        (0.0, None),
    ],
)
def test_direction_of_rotation_needs_swept_quarter_turn(turns, direction):
    """Angles are counter-clockwise from east, as seen from above with north up."""
    angle = 1.0 + np.linspace(0, turns * 2 * np.pi, 1000)
    swept = metrics.swept_angle(5 * np.sin(angle), 5 * np.cos(angle))
    assert swept == pytest.approx(turns * 2 * np.pi)
    assert metrics.direction_of(swept) is direction


# --- the turn command


def needed(wind):
    """Return the turn rate of the nose (rad/s) on a circle over ground in steady wind, integrated
    step by step."""
    at = 0.0
    noses = []
    for _ in TIME:
        along = np.array([-np.sin(at), np.cos(at)])
        ground = wind * along[0] + np.sqrt(V**2 - wind**2 * (1 - along[0] ** 2))
        noses.append(np.arctan2(*(ground * along - np.array([wind, 0.0]))[::-1]))
        at += ground / R * STEP
    return -np.gradient(np.unwrap(noses), STEP)


def coloured(size, seconds, seed=1):
    """Return noise with a standard deviation (rad/s) and a correlation time (s), as in the response
    to gusts."""
    chance = np.random.default_rng(seed)
    keep = np.exp(-STEP / seconds)
    values = [0.0]
    for fresh in chance.standard_normal(len(TIME) - 1):
        values.append(keep * values[-1] + size * np.sqrt(1 - keep**2) * fresh)
    return np.array(values)


def swinging(size, period):
    return size * np.sin(2 * pi * TIME / period)


def from_limit_to_limit():
    """Return the command of a loop that oscillates between both limits with a period that gusts
    vary."""
    phase = 2 * pi * np.cumsum(STEP / 2.0 * np.exp(coloured(0.5, 2.0))) + np.random.default_rng(
        3
    ).uniform(0, 6)
    return 2.0 * np.sin(phase)


def test_metrics_of_relay_command_match_hand_calculation():
    """The command is LIMIT and -LIMIT for 0.5 s each: the standard deviation is LIMIT, and the
    variation 4 LIMIT per second."""
    relay = np.where(np.arange(len(TIME)) // 10 % 2 == 0, LIMIT, -LIMIT)
    found = turn_figures(TIME, relay, ORBIT)
    assert found.turn_std_deg_s == pytest.approx(degrees(LIMIT))
    assert (found.turn_at_limit, found.turn_limit_cycle) == (1.0, True)
    assert found.turn_variation_rad_s2 == pytest.approx(4 * LIMIT, rel=0.01)
    assert turn_figures(TIME, relay / 1.2, ORBIT, at_limit=relay > 0).turn_at_limit == 0.5


@pytest.mark.parametrize("wind", [0.0, 8.0, 0.5 * V])
def test_turn_standard_deviation_in_wind_follows_theory(wind):
    """To first order in W/V, the turn rate of the nose varies with an amplitude of 2 W/R: half by
    the ground speed and half by the crab angle."""
    found = turn_figures(TIME, needed(wind), ORBIT)
    assert found.turn_std_deg_s == pytest.approx(degrees(2**0.5 * wind / R), rel=0.1)


@pytest.mark.parametrize(
    ("command", "cycles"),
    [
        *((needed(wind), False) for wind in (0.0, 8.0, 0.5 * V)),
        *((needed(wind) + coloured(0.03, 0.2), False) for wind in (0.0, 8.0, 0.5 * V)),
        # response to strong gusts: standard deviation 11 deg/s, sometimes at the turn limit
        *(
            (needed(8.0) + coloured(0.2, seconds, seed), False)
            for seconds in (0.1, 0.5, 2.0)
            for seed in range(5)
        ),
        # an oscillation of 1.1 deg/s is too small, at a turn limit of 26 deg/s
        (needed(8.0) + swinging(0.02, 2.0), False),
        # limit cycles with the periods flown on firmware: 1 s (copter), 2.5 to 4.6 s (planes)
        *(
            (needed(wind) + swinging(size, period) + coloured(0.04, 0.5), True)
            for wind in (0.0, 8.0)
            for size, period in ((0.12, 2.5), (0.3, 1.0), (0.5, 4.6))
        ),
        (from_limit_to_limit(), True),
        # less than half a lap is too short to detect a limit cycle
        *(
            (swinging(0.3, 2.0)[: round(laps * 2 * pi * R / V / STEP)], laps > 0.5)
            for laps in (0.6, 0.49)
        ),
    ],
    ids=lambda value: str(value) if isinstance(value, bool) else "",
)
def test_limit_cycle_is_detected_in_oscillating_command(command, cycles):
    assert (
        turn_figures(TIME[: len(command)], np.clip(command, -LIMIT, LIMIT), ORBIT).turn_limit_cycle
        is cycles
    )
