"""Acquisition of the target from ranges and the flown path, without the tracker.

A vehicle flies at 15 m/s with ranges at 20 Hz. Positions are vehicle minus target, m.
"""

from math import atan2, cos, hypot, inf, pi, sin

import numpy as np
import pytest

from circnav_mav.guidance.estimators.acquisition import (
    CANDIDATES,
    UNKNOWNS,
    Acquisition,
    Prior,
    covariance,
    improve,
    on_circle,
)
from circnav_mav.guidance.estimators.acquisition import _normal_equations as normal_equations
from circnav_mav.guidance.estimators.range_bins import Bins
from circnav_mav.guidance.estimators.tracker import Tracker
from circnav_mav.guidance.maths import chord
from tests.guidance.relative import SETTINGS, V

DT = 0.05
SIGMA = 0.5
TURN = 0.2
WIND = (3.0, -2.0)


class Search:
    """An acquisition, and the vehicle that provides its path and ranges.

    speed: speed of the vehicle, m/s.
    scale: true over measured airspeed.
    solution, seconds: the solution, and the duration of the search.
    """

    def __init__(self, bearing=0.6, r=150.0, wind=WIND, speed=V, seed=0, scale=1.0):
        self.p = np.array((r * cos(bearing), r * sin(bearing)))
        self.wind = np.array(wind)
        self.speed = speed
        self.scale = scale
        self.heading = 0.3
        self.rng = np.random.default_rng(seed)
        self.acquisition = Acquisition(SETTINGS)
        self.solution = None
        self.seconds = 0.0
        self.acquisition.observe(0.0, (0.0, 0.0), self.range(), SIGMA)
        self.acquisition.begin(r)

    def range(self, outliers=0.0):
        """Return a noisy range, m. outliers: probability of an error of up to 20 m."""
        error = self.rng.normal(0, SIGMA)
        if self.rng.random() < outliers:
            error += self.rng.uniform(-20, 20)
        return hypot(*self.p) + error

    def fly(self, seconds, turn=TURN, outliers=0.0):
        """Fly with a constant turn rate (rad/s) until the solution, at most for some seconds."""
        for _ in range(round(seconds / DT)):
            path = np.array(chord(self.speed, self.heading, turn * DT, DT))
            self.heading += turn * DT
            self.p = self.p + path + DT * self.wind
            self.seconds += DT
            self.acquisition.observe(DT, tuple(path / self.scale), self.range(outliers), SIGMA)
            self.solution = self.acquisition.search()
            if self.solution is not None:
                break
        return self

    @property
    def truth(self):
        return np.array((*self.p, *self.wind, self.scale))

    @property
    def error(self):
        """Distance of the solution from the true position, m."""
        return hypot(*(self.solution.x[:2] - self.p))


def bins_of(path, p, sigma=SIGMA):
    """Return the bins of noiseless ranges on the flown path (2, N) that ends at p."""
    count = path.shape[1]
    age = 0.25 * np.arange(count)[::-1]
    z = np.hypot(*(np.array(p)[:, None] - path - age * np.array(WIND)[:, None]))
    return Bins(age, path, z, np.full(count, sigma**2))


def arc(count=40):
    """Return the path flown since each bin of a turn, (2, N), newest last."""
    heading = TURN * 0.25 * np.arange(count)
    steps = 0.25 * V * np.array((np.cos(heading), np.sin(heading)))
    return np.cumsum(steps[:, ::-1], axis=1)[:, ::-1] - steps


@pytest.mark.parametrize("bearing", np.arange(8) * pi / 4)
def test_search_finds_target_in_every_direction(bearing):
    search = Search(bearing).fly(25.0)
    assert search.solution is not None
    assert search.error < 0.3 * hypot(*search.p)
    assert search.acquisition.estimate is None and search.acquisition.search() is None


@pytest.mark.parametrize("r", [30.0, 400.0])
def test_search_finds_near_and_far_target(r):
    search = Search(r=r).fly(40.0)
    assert search.error < 0.3 * hypot(*search.p)


def test_tracking_starts_with_errors_within_stated_covariance():
    """Mean normalized error squared of range, direction, drift and airspeed scale at the start of
    24 tracks: 5 for exact covariances, less because the prior of drift and scale is wider than the
    true values.

    In Cartesian coordinates it is up to 245, because a direction error bends the range error.
    """
    squared = [normalized_error(Search(bearing=seed, seed=seed).fly(30.0)) for seed in range(24)]
    assert 1.0 < np.mean(squared) < 7.0
    assert np.max(squared) < 25.0


def normalized_error(search):
    """Return the normalized error squared at the start of the track from a solution."""
    estimate = Tracker.located(SETTINGS, search.solution, SIGMA).estimate
    x, y, *rest = search.truth
    error = estimate.mean[:UNKNOWNS] - (hypot(x, y), atan2(y, x), *rest)
    error[1] = (error[1] + pi) % (2 * pi) - pi
    P = estimate.covariance[:UNKNOWNS, :UNKNOWNS]
    return error @ np.linalg.solve(P, error)


def searches(wind, scale):
    """Return 16 searches with random directions, ranges and turn rates. wind: m/s."""
    flown = []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        blows = rng.uniform(0, 2 * pi)
        search = Search(
            bearing=rng.uniform(0, 2 * pi),
            r=rng.choice([60.0, 150.0, 300.0]),
            wind=(wind * cos(blows), wind * sin(blows)),
            seed=seed,
            scale=scale,
        )
        flown.append(search.fly(60.0, turn=rng.choice([0.1, 0.2, 0.3])))
    return flown


def test_search_in_calm_air_takes_11_seconds_on_average():
    assert np.mean([search.seconds for search in searches(0.0, 1.0)]) < 11.5


def test_search_in_wind_with_wrong_airspeed_states_its_error():
    """The airspeed is 10 % too low, two standard deviations of its prior."""
    found = searches(0.3 * V, 1.1)
    assert np.mean([search.seconds for search in found]) < 13.5
    assert np.median([normalized_error(search) for search in found]) < 22.0


def test_straight_flight_keeps_both_mirror_positions():
    """Ranges of a straight flight are the same for a target to the left and to the right."""
    search = Search(bearing=0.3 + pi + 0.6, r=200.0, wind=(0.0, 0.0)).fly(15.0, turn=0.0)
    assert search.solution is None
    along = np.array((cos(0.3), sin(0.3)))
    mirror = 2 * (search.p @ along) * along - search.p
    candidates = search.acquisition._candidates
    costs = [
        candidates.cost[np.hypot(*(candidates.x[:, :2] - p).T) < 30.0].min()
        for p in (search.p, mirror)
    ]
    assert costs[0] == pytest.approx(costs[1], abs=0.5)
    search.fly(15.0)
    assert search.error < 0.3 * hypot(*search.p)


@pytest.mark.parametrize(("speed", "turn"), [(0.0, 0.0), (V, 0.0)], ids=["hover", "straight"])
def test_search_without_turn_gives_no_solution(speed, turn):
    search = Search(wind=(0.0, 0.0), speed=speed).fly(40.0, turn)
    estimate = search.acquisition.estimate
    assert search.solution is None
    assert estimate.hypothesis in range(CANDIDATES)
    assert estimate.spread == inf and not estimate.trusted


def test_search_tolerates_outliers():
    search = Search().fly(40.0, outliers=0.1)
    assert search.error < 0.3 * hypot(*search.p)


def test_search_rejects_solution_with_implausible_drift():
    """The target is carried away with nearly the speed of the vehicle."""
    assert Search(wind=(0.95 * V, 0.0)).fly(40.0).solution is None


def test_most_likely_hypothesis_moves_with_the_flown_path():
    search = Search(wind=(0.0, 0.0))
    before = search.acquisition.estimate.mean
    search.acquisition.observe(0.1, (3.0, -4.0), None, SIGMA)
    after = search.acquisition.estimate.mean
    x = before[0] * cos(before[1]) + 3.0
    y = before[0] * sin(before[1]) - 4.0
    assert after[:2] == pytest.approx((hypot(x, y), atan2(y, x)))


def test_search_iterates_once_per_quarter_second_of_ranges():
    """A bin lasts 0.25 s."""
    search = Search()
    due = []
    for _ in range(20):
        search.acquisition.observe(DT, (DT * V, 0.0), 150.0, SIGMA)
        due.append(search.acquisition.due is not None)
        search.acquisition.search()
    assert sum(due) == 4


def test_normal_equations_contain_gradient_of_cost():
    rng = np.random.default_rng(1)
    prior = Prior(3.0, 0.05, 1.0, -0.5, 1.02)
    bins = bins_of(arc(), (120.0, -60.0))
    x = np.array((110.0, -75.0, 1.0, 2.0, 0.97)) + rng.normal(size=(6, UNKNOWNS)) * 0.1
    cost, A, b = normal_equations(x, bins, prior)
    assert (cost.shape, A.shape, b.shape) == ((6,), (6, UNKNOWNS, UNKNOWNS), (6, UNKNOWNS))
    assert np.allclose(A, np.swapaxes(A, 1, 2))
    for state, unit in enumerate(1e-6 * np.eye(UNKNOWNS)):
        ahead, *_ = normal_equations(x + unit, bins, prior)
        behind, *_ = normal_equations(x - unit, bins, prior)
        assert b[:, state] == pytest.approx((behind - ahead) / 2e-6, rel=1e-4, abs=1e-4)


def test_iterations_lower_costs_below_cost_of_truth():
    prior = Prior(3.0, 0.05)
    truth = np.array((120.0, -60.0, *WIND, 1.0))
    bins = bins_of(arc(), truth[:2])
    candidates = improve(on_circle(135.0, prior), bins, prior)
    assert candidates.x.shape == (CANDIDATES, UNKNOWNS)
    for _ in range(40):
        before = candidates.cost
        candidates = improve(candidates, bins, prior)
        assert (candidates.cost <= before).all()
    best = candidates.x[candidates.cost.argmin()]
    P = covariance(best, bins, prior)
    assert np.linalg.eigvalsh(P).min() > 0
    assert candidates.cost.min() <= normal_equations(truth[None], bins, prior)[0][0]
    assert hypot(*(best - truth)[:2]) < 2 * np.sqrt(P[0, 0] + P[1, 1])
