"""World, radio and sensors of a benchmark flight, and statistics of `auto` over flights."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from circnav_mav.extras.bench.flight import MotionSensors, Radio, World, fly, turn_step
from circnav_mav.extras.bench.situations import LORA, UWB, ImuNoise, Ranging, Situation

STILL = Situation("still")


def world(situation=STILL, seed=0):
    random = np.random.default_rng(seed)
    return World(situation, random.random(10), random)


def test_benchmark_motion_is_exact_for_any_time_step():
    whole = world()
    pieces = world()
    whole.step(0.05, -0.3)
    for _ in range(50):
        pieces.step(0.001, -0.3)
    assert (whole.x, whole.y) == pytest.approx((pieces.x, pieces.y), abs=1e-9)
    assert (whole.heading, whole.turn_rate) == pytest.approx(
        (pieces.heading, pieces.turn_rate), abs=1e-12
    )


def test_benchmark_turn_follows_command_with_first_order_lag():
    rate, angle = turn_step(0.0, 0.3, 0.4)
    assert rate == pytest.approx(0.3 * (1 - np.exp(-1)))
    assert angle == pytest.approx(0.3 * 0.4 * np.exp(-1))


def test_benchmark_gusts_have_given_sigma_and_correlation_time():
    air = world(Situation("gusts", gust=1.5))
    gusts = []
    for _ in range(40_000):
        gusts.append(air.wind)
        air.step(0.5, 0.0)
    gusts = np.array(gusts)
    assert gusts.std() == pytest.approx(1.5, rel=0.05)
    assert (gusts[20:] * gusts[:-20]).mean() / 1.5**2 == pytest.approx(np.exp(-1), abs=0.06)


def test_random_walk_of_target_velocity_stays_below_speed_bound():
    pushed = world(Situation("walk", target=3.0, target_walk=0.5))
    speeds = []
    for _ in range(400):
        pushed.step(0.1, 0.0)
        speeds.append(np.hypot(*pushed.target_velocity))
    assert max(speeds) <= 3.0 + 1e-9
    assert np.std(speeds) > 0.3


@pytest.mark.parametrize(("ranging", "sigma"), [(UWB, 0.151), (LORA, 2.236), (Ranging(), 0.5)])
def test_radio_errors_have_the_reported_sigma(ranging, sigma):
    far = world(replace(STILL, start=(200.0, 200.0)))
    radio = Radio(ranging, None, np.random.default_rng(1))
    samples = [radio.measure(far, step, 0.05) for step in range(20_000)]
    errors = [sample.r - 200.0 for sample in samples if sample]
    assert np.std(errors) == pytest.approx(sigma, rel=0.12)
    assert ranging.sigma == pytest.approx(sigma, abs=1e-3)


def test_losses_outliers_and_outages_have_the_given_shares():
    far = world(replace(STILL, start=(300.0, 300.0)))
    radio = Radio(
        Ranging(every=4, loss=0.5, outlier_share=0.1, outage=10.0), None, np.random.default_rng(1)
    )
    samples = [radio.measure(far, step, 0.05) for step in range(48_000)]
    arrived = [sample.r for sample in samples if sample]
    assert len(arrived) / 48_000 == pytest.approx(0.25 * 0.5 * 50 / 60, rel=0.1)
    wild = np.abs(np.array(arrived) - 300.0) > 10.0
    assert wild.mean() == pytest.approx(0.1 / 2, rel=0.15), (
        "outliers are uniform in +-20 m, so half of them exceed 10 m"
    )


def test_motion_sensors_have_set_noise_and_true_velocity_change():
    air = world()
    sensors = MotionSensors(
        replace(STILL, imu=ImuNoise(0.0, 0.0)), np.zeros(10), np.random.default_rng(2)
    )
    reports = []
    velocities = []
    for step in range(2000):
        reports.append(sensors.report(air, 0.05 * step))
        velocities.append(air.velocity)
        assert abs(reports[-1].turn_rate - air.turn_rate) < 0.06
        air.step(0.05, 0.2)
    assert np.std([report.airspeed for report in reports]) == pytest.approx(0.3, rel=0.1)
    measured = np.array([(report.acceleration.x, report.acceleration.y) for report in reports])
    assert measured == pytest.approx(np.array(velocities) - velocities[0], abs=1e-9)


def test_benchmark_flight_depends_only_on_seed_and_number():
    short = Situation("windy", wind=5.0, duration=5.0)
    first, again, other = (fly(short, "feedforward", *seeds) for seeds in ((9, 1), (9, 1), (9, 2)))
    assert np.array_equal(first.rows["r"], again.rows["r"])
    assert not np.allclose(first.rows["r"], other.rows["r"])


def test_auto_keeps_circle_in_strong_wind_in_commanded_direction():
    hard = Situation("hard", wind=0.53 * 15, start=(40.0, 150.0), duration=65.0)
    for flight in range(2):
        track = fly(hard, "auto", 5, flight)
        end = track.time >= 50
        assert np.sqrt(np.mean((track.rows["r"][end] - 100) ** 2)) < 2.0
        assert np.sign(np.unwrap(track.rows["angle"][end])[[0, -1]] @ [-1, 1]) == track.sense


def test_auto_search_departs_less_than_diameter_of_tightest_turn():
    """The diameter at the turn-rate limit is 2 V/limit = 86 m. These flights depart by 60 to 82 m,
    the most of twelve."""
    outside = Situation("outside", start=(250.0, 250.0), duration=15.0)
    for flight in (4, 9, 10):
        r = fly(outside, "auto", 9, flight).rows["r"]
        assert r.max() - r[0] < 2 * 15 / radians(20)


def test_auto_filter_is_consistent_in_gusts():
    gusts = Situation("gusts", wind=5.0, gust=1.5, start=(80.0, 150.0), duration=65.0)
    tracks = [fly(gusts, "auto", 6, flight) for flight in range(2)]
    nees = np.concatenate([track.rows["nees"][track.time > 25] for track in tracks])
    assert 1.0 < np.nanmedian(nees) < 2.5
    assert np.nanmean(nees < 7.378) > 0.8


@pytest.mark.nightly
def test_measured_accelerations_reduce_radius_error_in_gusts():
    gusts = Situation("gusts", wind=5.0, gust=1.5, start=(80.0, 150.0), duration=110.0)

    def error(situation):
        tracks = [fly(situation, "auto", 5, flight) for flight in range(3)]
        return np.median(
            [np.sqrt(((track.rows["r"][track.time > 60] - 100.0) ** 2).mean()) for track in tracks]
        )

    assert error(replace(gusts, imu=ImuNoise())) < 0.7 * error(gusts)
