"""The bank goes from one wind to another as the wind does: not by a few unlucky ranges, at once where it is real."""

from dataclasses import replace
from math import degrees

import numpy as np
import pytest

from circnav_mav.experiments.batch.flight import Circle, Situation, begin, fly_from, fly_situation, policy
from circnav_mav.experiments.batch.sensors import NO_NOISE, Ranging

CALM = Situation(
    "calm", circle=Circle(speed=22.0, radius=150.0), ranging=Ranging(every=2), noise=NO_NOISE, start=(120.0, 180.0)
)
ROLL_RATE, GRAVITY = 1.6, 9.81
"""Of a plane, rad/s: how fast its turn rate can change is g/V times that."""
STEP = 3.0
"""Of the wind, m/s."""


def test_in_calm_air_no_range_moves_the_commanded_turn_faster_than_a_plane_rolls():
    """Honest white ranges of .5 m at 10 Hz: among thousands, five in a row stand 2 .. 3.5 sigma high."""
    tracks = fly_situation(replace(CALM, duration=240.0), policy("auto"), 20, seed=5)
    change = np.abs(np.diff(tracks.command[tracks.time > 60.0], axis=0))
    assert degrees(change.max()) < degrees(GRAVITY / CALM.circle.speed * ROLL_RATE * CALM.dt)


@pytest.fixture(scope="module")
def unknown_drift():
    """The error of the drift, m/s, at times after the wind has got up from anywhere."""
    start = begin(replace(CALM, circle=Circle(), start=(90.0, 110.0)), 16, seed=6)
    flown, angle, found = start.world.step, np.random.default_rng(1).uniform(0, 2 * np.pi, 16), []

    def step(dt, command, flies=1.0):
        if len(found) == 2001:
            start.world._steady = STEP * np.stack([np.cos(angle), np.sin(angle)])
        flown(dt, command, flies)

    def make(circle, sense):
        guidance = policy("auto")(circle, sense)
        see = guidance.see

        def seen(now, *given):
            see(now, *given)
            e = guidance.estimator.found
            found.append(np.hypot(e.drift_x - given[1].d[0], e.drift_y - given[1].d[1]))

        guidance.see = seen
        return guidance

    start.world.step = step
    fly_from(start, replace(CALM, circle=Circle(), duration=126.0), make)
    return {after: np.median(found[2001 + round(after / CALM.dt)]) for after in (0.0, 3.0, 10.0, 20.0)}


def test_a_wind_that_gets_up_is_known_within_a_third_of_a_lap(unknown_drift):
    """What is radial at once, what is tangential as the vehicle goes round: a lap takes 42 s."""
    assert unknown_drift[0.0] == pytest.approx(STEP, abs=0.2)
    assert unknown_drift[3.0] < 0.75 * STEP
    assert unknown_drift[20.0] < 0.1 * STEP
