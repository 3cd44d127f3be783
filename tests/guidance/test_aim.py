"""The field's surprises led: a drift that turns leaves no lasting error, and a gap is no surprise."""

from dataclasses import replace

import numpy as np
import pytest

from circnav_mav.experiments.batch.estimators import FullInformation
from circnav_mav.experiments.batch.flight import STALE, fly_situation
from circnav_mav.experiments.batch.guidance import Guidance
from circnav_mav.experiments.batch.situations import SITUATIONS
from circnav_mav.guidance.air_path import steadied
from circnav_mav.guidance.turn_response import Pending
from circnav_mav.guidance.vector_field import Aim, drift_gains


def informed(name, flights=8):
    """Radius errors (m) over the last 60 s of flights that know position and drift exactly."""

    def make(circle, sense):
        truth = FullInformation(circle.speed, sense.size)
        return Guidance(circle.settings("drift", sense), truth, sense.size, lag=circle.lag, stale=STALE)

    situation = replace(SITUATIONS[name].situation, start=(80, 120), duration=100.0)
    tracks = fly_situation(situation, make, flights, 5)
    return tracks.r[tracks.time > 40] - situation.circle.radius


def test_a_wind_that_turns_or_a_target_that_circles_is_followed_without_a_lasting_error():
    """Without the lead: 2.5 m at most, and .36 m in the root mean square."""
    assert np.abs(informed("wind .33 V turns 90 deg in 10 s")).max() < 1.2
    assert np.sqrt((informed("target turns") ** 2).mean()) < 0.15


def followed(aims):
    """The lead after steps of .05 s in which the aim's heading is where the wind takes it."""
    gains = drift_gains(15.0, 0.4, 2.5)
    aim = Aim()
    for d in aims:
        aim = aim.follow(
            0.05, np.array([100.0, 0.0]), d, np.pi / 2, Pending(0.0, 0.4), True,
            V=15.0, r_d=100.0, max_turn_rate=0.35, gains=gains,
        )  # fmt: skip
    return aim.lead


def test_the_lead_is_how_fast_the_wanted_nose_turns_beyond_what_the_path_foresees():
    """On the circle, flying north past a target in the west, a crosswind w m/s asks for a crab of asin(w/V)."""
    still = followed([np.array([0.0, 0.0])] * 3)
    freshening = followed([np.array([0.05 * 0.5 * i, 0.0]) for i in range(200)])
    assert still == pytest.approx(0.0, abs=0.01)
    crab_rate = (np.arcsin(5.0 / 15.0) - np.arcsin(4.0 / 15.0)) / 2.0
    assert abs(freshening - still) == pytest.approx(crab_rate, rel=0.25)


def test_a_heading_that_shakes_is_steadied_by_the_turn_rates():
    """Noise of .02 rad and .01 rad/s at 20 Hz: what is left is a third of it at most, without a lag in the turn."""
    rng = np.random.default_rng(2)
    heading, errors, rate = 0.0, [], 0.15
    for i in range(1, 4000):
        reported = 0.15 * 0.05 * i + 0.02 * rng.standard_normal()
        fresh = 0.15 + 0.01 * rng.standard_normal()
        heading, rate = steadied(heading, rate, reported, fresh, 0.05), fresh
        errors.append(heading - 0.15 * 0.05 * i)
    assert np.std(errors[100:]) < 0.02 / 3
    assert abs(np.mean(errors[100:])) < 0.002
