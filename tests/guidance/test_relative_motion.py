"""The relative-motion filter with asynchronous, lost, false and interrupted ranges and own
motion."""

from cmath import phase
from dataclasses import replace
from math import cos, hypot, sin, sqrt

import numpy as np
import pytest

from circnav_mav.guidance.estimators.relative_ekf import GX, GY, KAPPA
from circnav_mav.guidance.estimators.relative_motion import AutoEstimator, DriftEstimator
from circnav_mav.guidance.maths import wrap
from circnav_mav.guidance.types import IntegratedAcceleration, OwnMotion, RangeSample
from tests.guidance.relative import (
    OMEGA,
    RADIUS,
    SETTINGS,
    WIND,
    Circling,
    V,
    converged,
    error,
    move_only,
    observe,
    still,
)


@pytest.mark.parametrize(
    ("every", "motion_every", "motion_delay"),
    [(0.05, 0.05, 0.0), (0.05, 0.1, 0.04), (0.2, 0.04, 0.02)],
)
def test_drift_estimator_finds_target_at_any_message_rates(every, motion_every, motion_delay):
    world = Circling()
    estimator = DriftEstimator(SETTINGS)
    observe(estimator, world, 0.0, 25.0, every, motion_every, motion_delay)
    estimate = estimator.at(25.0)
    assert estimator.ready and estimate.relative.trusted
    assert error(estimator, world, 25.0) < 5.0
    assert (estimate.relative.drift_x, estimate.relative.drift_y) == pytest.approx(WIND, abs=0.5)
    assert 0.05 < estimate.r_dot_sigma < 1.0


def test_search_continues_between_first_estimate_and_next_range():
    """The first estimate after a range becomes a setpoint at once, and a search iteration would
    delay this setpoint. The search therefore continues after the estimate."""
    world = Circling()
    estimator = DriftEstimator(SETTINGS)
    observe(estimator, world, 0.0, 2.0)
    acquisition = estimator.filter.acquisition
    acquisition.due = 0.5
    assert [
        (estimator.at(t) is not None, acquisition.due is not None) for t in (1.95, 1.95, 2.0)
    ] == [(True, True), (True, True), (True, False)]


def test_position_in_steady_wind_is_precise_to_two_decimeters():
    """White range noise of 0.5 m. A filter that expects changes of the wind passes more of it to
    the position, and so to the turn command."""
    world = Circling(wind=(0.5, -0.3))
    estimator = DriftEstimator(SETTINGS)
    observe(estimator, world, 0.0, 60.0)
    errors = []
    for start in np.arange(60.0, 90.0, 0.5):
        observe(estimator, world, start, start + 0.5)
        errors.append(error(estimator, world, start + 0.45))
    assert np.sqrt(np.mean(np.square(errors))) < 0.2


@pytest.mark.parametrize("wrong", ["outliers", "airspeed"])
def test_drift_estimator_tolerates_outliers_and_wrong_airspeed(wrong):
    world = Circling()
    estimator = DriftEstimator(SETTINGS)
    for i, t in enumerate(np.arange(0, 60, 0.05)):
        sample = world.range(t)
        wild = 20.0 if i % 7 == 3 else -20.0 if i % 11 == 5 else 0.0
        estimator.move(
            world.motion(t) if wrong == "outliers" else world.motion(t)._replace(airspeed=1.1 * V)
        )
        estimator.observe(
            sample._replace(r=max(sample.r + wild, 0.1)) if wrong == "outliers" else sample
        )
    assert estimator.ready and error(estimator, world, 59.95) < 3.0
    scale = 1.0 if wrong == "outliers" else 1 / 1.1
    assert estimator.at(59.95).relative.scale == pytest.approx(scale, abs=0.02)


@pytest.mark.parametrize("make", [DriftEstimator, AutoEstimator])
def test_filter_accepts_ranges_again_during_new_search(make):
    """Meanwhile the estimator `auto` uses the range filter. A reset discards the state of that
    filter."""
    world, estimator = converged(make)
    world.target = (-250.0, 300.0)
    results = []
    for t in np.arange(30.0, 33.0, 0.05):
        estimator.move(world.motion(t))
        results.append(estimator.observe(world.range(t)))
    lost = results.index(True)
    assert 0 < lost < 55 and False not in results[lost + 1 :]
    if make is AutoEstimator:
        assert lost < 10
        assert estimator.at(33.0).r == pytest.approx(hypot(*world.offset(33.0)), abs=3.0)
    estimator.reset()
    assert (estimator.ready, estimator.at(33.0), estimator.nis) == (False, None, None)


def test_estimator_auto_needs_no_heading_but_drift_does():
    world = Circling()
    drift = DriftEstimator(SETTINGS)
    auto = AutoEstimator(SETTINGS)
    for t in np.arange(0, 5, 0.05):
        assert drift.observe(world.range(t))
        auto.observe(world.range(t))
    assert not drift.ready and drift.at(5.0) is None
    assert auto.ready and auto.at(5.0).relative is None


def test_drift_estimator_rejects_late_and_repeated_samples():
    world, estimator = converged(DriftEstimator, 30.0, still)
    before = estimator.at(29.95)
    assert [estimator.observe(world.range(t)) for t in (29.95, 29.0)] == [False] * 2
    assert estimator.at(29.95) == before


def test_relative_motion_loses_trust_during_dead_reckoning():
    """Relative motion is trusted while the sigma of the position is below a quarter of the
    range."""
    world, estimator = converged()
    assert estimator.ready
    sure = estimator.at(29.95).relative.sigma
    for start, end, trusted in ((30.0, 40.0, True), (40.0, 70.0, False)):
        move_only(estimator, world, start, end)
        relative = estimator.at(end).relative
        r = estimator.at(end).r
        assert error(estimator, world, end) < 10.0
        assert relative.sigma > sure
        assert relative.trusted == (relative.sigma < 0.25 * r) == trusted


def test_filter_finds_target_again_after_target_moved():
    """The target is moved far away, where the position is less certain. The test checks each error
    against its sigma, and the median of three flights."""
    errors = []
    for seed in range(3):
        world = Circling(rng=np.random.default_rng(seed))
        estimator = DriftEstimator(SETTINGS)
        observe(estimator, world, 0.0, 25.0)
        assert estimator.ready
        world.target = (-250.0, 300.0)
        observe(estimator, world, 25.0, 29.5)
        assert not estimator.ready
        observe(estimator, world, 29.5, 70.0)
        assert estimator.ready
        errors.append(error(estimator, world, 69.95))
        assert errors[-1] < 3 * estimator.at(69.95).relative.sigma
    assert np.median(errors) < 4.0


@pytest.mark.parametrize("trouble", [False, True])
def test_filter_remembers_drift_after_gap(trouble):
    """With `trouble`, the vehicle stands still before the gap because it receives no setpoints,
    while its motion is assumed to continue."""
    world, estimator = converged(seconds=45.0)
    if trouble:
        for t in np.arange(45.0, 52.0, 0.05):
            estimator.move(world.motion(t))
            estimator.observe(world.range(45.0)._replace(time=t, stamp=t))
        for t in np.arange(53.0, 80.0, 0.5):
            estimator.observe(world.range(t))  # own motion is no longer reported
    observe(estimator, world, 80.0, 80.3)
    relative = estimator.at(80.29).relative
    assert relative.drift_remembered and relative.trial is not None and not estimator.ready
    assert (relative.drift_x, relative.drift_y) == pytest.approx(WIND, abs=0.5)


def test_filter_follows_slow_change_of_airspeed_error():
    """From 300 s on, the measured airspeed changes by 10 % in ten minutes. The vehicle flies the
    circle in wind."""
    rng = np.random.default_rng(1)
    estimator = DriftEstimator(SETTINGS)
    wind = complex(4.0, 3.0)
    place = complex(RADIUS, 0.0)
    heading = None
    off = []
    for t in np.arange(0.0, 900.0, 0.2).tolist():
        scale = 1.0 - 0.1 * max(t - 300.0, 0.0) / 600.0
        out = place / abs(place)
        course = 1j * out - out * np.clip((abs(place) - RADIUS) / 20.0, -0.5, 0.5)
        course /= abs(course)
        along = (wind * course.conjugate()).real
        ground = (along + sqrt(V**2 - abs(wind) ** 2 + along**2)) * course
        before, heading = heading, phase(ground - wind)
        turn = 0.0 if before is None else wrap(heading - before) / 0.2
        measured = V / scale + rng.normal(0, 0.2)
        estimator.move(OwnMotion(t, heading + rng.normal(0, 0.02), turn, measured))
        estimator.observe(RangeSample(t, t, abs(place) + rng.normal(0, 0.5), 0.5))
        if t > 600.0:
            relative = estimator.at(t).relative
            off.append(abs(complex(relative.x, relative.y) - place))
        place += 0.2 * ground
    assert np.mean(off) < 3.0


@pytest.mark.parametrize("wind", [WIND, (6.0, 4.0)])
def test_filter_finds_target_within_5_s_after_gap(wind):
    world = Circling(wind=wind)
    estimator = DriftEstimator(SETTINGS)
    observe(estimator, world, 0.0, 40.0)
    observe(estimator, world, 45.0, 50.0)
    assert estimator.ready
    assert error(estimator, world, 49.95) < 0.1 * hypot(*world.offset(49.95))


@pytest.mark.parametrize("change", [(5.0, 0.0), (-5.0, 2.0)])
def test_filter_forgets_drift_of_wind_changed_before_gap(change):
    world, estimator = converged(seconds=60.0)
    x, y = world.offset(60.0)
    world.wind = (WIND[0] + change[0], WIND[1] + change[1])
    now = world.offset(60.0)
    world.target = (world.target[0] + now[0] - x, world.target[1] + now[1] - y)
    observe(estimator, world, 60.0, 70.5)
    assert estimator.ready
    wrong = 0.0
    for t in np.arange(91.5, 131.5, 0.5):
        observe(estimator, world, t, t + 0.5)
        wrong += 0.5 if estimator.ready and error(estimator, world, t + 0.45) > 50 else 0.0
    assert wrong < 3.0


def test_filter_finds_wind_changed_during_gap():
    world, estimator = converged(seconds=45.0)
    world.wind = (-2.0, 3.0)
    observe(estimator, world, 80.0, 160.0)
    relative = estimator.at(159.95).relative
    assert estimator.ready
    assert error(estimator, world, 159.95) < 0.02 * hypot(*world.offset(159.95))
    assert (relative.drift_x, relative.drift_y) == pytest.approx(world.wind, abs=0.5)


def test_lost_track_discards_remembered_drift():
    world, estimator = converged(seconds=45.0)
    observe(estimator, world, 80.0, 110.0)
    assert estimator.ready and estimator.filter.acquisition.remembers
    world.target = (-250.0, 300.0)
    observe(estimator, world, 110.0, 114.5)
    assert not estimator.ready and not estimator.filter.acquisition.remembers


def test_estimator_auto_keeps_target_after_sensor_clock_jump():
    """Stamps jump by one hour. The estimator `auto` keeps the target. Only the range filter
    `kalman` restarts."""
    world, estimator = converged(AutoEstimator)
    assert estimator.drift.ready
    estimator.restamp()
    assert not estimator.kalman.ready
    for t in np.arange(30, 33, 0.05):
        sample = world.range(float(t))
        estimator.move(world.motion(float(t)))
        estimator.observe(sample._replace(stamp=sample.stamp + 3600))
        assert estimator.drift.ready
        assert error(estimator, world, float(t)) < 5.0
    assert estimator.kalman.ready


def test_filter_is_ready_only_with_own_motion():
    """Without own motion the relative-motion filter uses no ranges, and the range filter accepts or
    rejects them."""
    world, estimator = converged(AutoEstimator)
    for t in np.arange(30.0, 31.0, 0.05):
        estimator.observe(world.range(t))
    assert not estimator.drift.ready
    rng = np.random.default_rng(5)
    nonsense = [RangeSample(t, t, rng.uniform(30, 600), 0.5) for t in np.arange(31.0, 32.4, 0.05)]
    results = [estimator.observe(sample) for sample in nonsense]
    assert results.count(False) > 0.8 * len(results)
    observe(estimator, world, 32.4, 33.4)
    assert estimator.drift.ready


def test_filter_separates_wrong_airspeed_from_gust():
    """On a circle without wind, a model with accelerations cannot distinguish a reported airspeed
    with an error of 2.5 % from a gust that turns with the nose. Its wrong state must not initialize
    the other models forever: a flight then had a radius RMS of 0.3 m instead of 0.15 m.
    """
    scale = 1.065
    reported = V / 1.065
    world = still()
    estimator = DriftEstimator(replace(SETTINGS, speed=reported))

    def observe_accelerations(start, end):
        for t in np.arange(start, end, 0.05):
            acceleration = IntegratedAcceleration(V * cos(OMEGA * t), V * sin(OMEGA * t), 0.0)
            estimator.move(world.motion(t)._replace(airspeed=reported, acceleration=acceleration))
            if round(t / 0.05) % 2 == 0:
                estimator.observe(world.range(t))

    observe_accelerations(0.0, 40.0)
    assert estimator.ready
    tracks = estimator.filter.tracker.tracks
    noise = estimator.filter.tracker.noise
    nose = OMEGA * 40.0
    acceleration_weight = noise.acceleration_weight > 0
    # models with accelerations, and models initialized from them
    wrong = acceleration_weight | (noise.drift_psd < 1e-3)
    tracks.x[wrong, KAPPA] = scale - 0.025
    tracks.x[wrong, GX] = 0.025 * reported * cos(nose)
    tracks.x[wrong, GY] = 0.025 * reported * sin(nose)
    tracks.P[wrong, KAPPA] = 0.0
    tracks.P[wrong, :, KAPPA] = 0.0
    tracks.P[wrong, KAPPA, KAPPA] = 1e-6
    tracks.log_weight[:] = np.where(acceleration_weight, 0.0, -9.0)
    observe_accelerations(40.0, 120.0)
    relative = estimator.at(120.0).relative
    assert relative.scale == pytest.approx(scale, abs=0.01)
    assert hypot(relative.drift_x, relative.drift_y) < 0.15
