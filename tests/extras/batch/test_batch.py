"""The batch: exact motion, the requested errors, and the same commands as the flight stack."""

from dataclasses import replace

import numpy as np
import pytest

from circnav_mav.api import tune
from circnav_mav.extras.batch import metrics
from circnav_mav.extras.batch.estimators import Auto
from circnav_mav.extras.batch.flight import (
    ESTIMATION,
    ORBIT,
    STALE,
    TURN_LAG,
    Situation,
    begin,
    fly_situation,
    policy,
)
from circnav_mav.extras.batch.sensors import LORA, NO_NOISE, UWB, MotionNoise, MotionSensors, Radio, Ranging, Reading
from circnav_mav.extras.batch.world import Airframe, Surroundings, World, flown, turn_step
from circnav_mav.guidance.estimators.interface import Fused
from circnav_mav.guidance.estimators.relative_motion import AutoEstimator
from circnav_mav.guidance.pending_turn import PendingTurn
from circnav_mav.guidance.step import Steering, holding
from circnav_mav.guidance.turn_response import Response
from circnav_mav.guidance.types import Direction, OwnMotion, RangeSample

WINDY = Situation("windy", wind=5.0, duration=30.0)
OUTAGE = Situation("outage", wind=5.0, ranging=Ranging(outage=10.0), duration=40.0)


class InTheAir:
    """The estimator and steering of the flight stack, one pair per flight, instead of the batch's guidance."""

    def __init__(self, sense):
        ways = [Direction.COUNTERCLOCKWISE if s > 0 else Direction.CLOCKWISE for s in sense]
        orbits, choice = [replace(ORBIT, direction=way) for way in ways], tune(ORBIT)
        self.flights = [(o, AutoEstimator(ESTIMATION), Steering(o, choice), PendingTurn()) for o in orbits]
        self.answer = Response(0.0, TURN_LAG, 1 / TURN_LAG)
        self.newest = [-np.inf] * sense.size
        self.estimator = Auto(ESTIMATION, sense.size, ORBIT.speed)  # for its metrics alone

    def observe(self, now, measured, true):
        self.now, self.measured = now, measured
        self.estimator.observe(measured, true)

    @property
    def good(self):
        return np.ones(len(self.flights), bool)

    def learn_turn_gain(self, now, heading, flies):
        """Its turn gain is fixed."""

    def command(self, steers):
        turns = np.array([self.turn(i, *flight) for i, flight in enumerate(self.flights)])
        return turns, np.zeros(turns.size, bool)

    def turn(self, i, orbit, estimator, steer, under_way):
        measured, now = self.measured, self.now
        motion = float(measured.psi[i]), float(measured.turn_rate[i]), float(measured.airspeed[i])
        estimator.move(OwnMotion(now, *motion))
        if measured.arrived[i]:
            sample = RangeSample(now, now, float(measured.z[i]), float(measured.sigma[i]))
            self.newest[i] = self.newest[i] if estimator.observe(sample) is Fused.GATED else now
            estimator.drift.bank.search()  # the batch starts to search at once
        estimate, pending = estimator.at(now), under_way.at(now, self.answer, float(measured.turn_rate[i]))
        if estimator.ready and now - self.newest[i] < STALE + 1e-6:
            command = steer(estimate, 0.0, pending).turn_rate
        else:
            command = holding(orbit, estimate.relative if estimate else None, pending).turn_rate
        under_way.command(now, command)
        return command


def test_the_stack_in_the_air_flies_the_same_numbers_as_the_batch():
    """Equal up to rounding, because the flight stack uses the C library's sines. Equal to 0.1 m through an outage of
    10 s that begins after 21 and 26 s: the flight stack takes one long step to the next range, the batch many."""
    air, batch = (fly_situation(OUTAGE, make, 2, seed=3) for make in (InTheAir, policy("auto")))
    before = air.time < 20.0
    assert np.abs(air.r - batch.r)[before].max() < 1e-3
    assert np.abs(air.command - batch.command)[before].max() < 1e-4
    assert np.abs(air.r - batch.r).max() < 0.1


def test_an_outage_in_wind_leaves_the_vehicle_on_its_circle():
    """It holds the circle's turn rate for the estimated drift. At V/r_d, 5 m/s of wind would carry it away for 10 s."""
    tracks = fly_situation(replace(OUTAGE, start=(60.0, 160.0), duration=120.0), policy("auto"), 8, seed=4)
    assert np.abs(tracks.r[tracks.time > 60] - 100.0).max() < 5.0


def test_arcs_are_exact_for_any_step():
    V, psi, omega, command, lag = 15.0, np.array([0.3]), np.array([0.1]), np.array([-0.3]), 0.4
    whole = flown(V, psi, omega, command, lag, 0.05)
    total, heading, rate = 0.0, psi, omega
    for _ in range(50):
        total = total + flown(V, heading, rate, command, lag, 0.001)
        rate, turned = turn_step(rate, command, lag, 0.001)
        heading = heading + turned
    assert whole == pytest.approx(total, abs=1e-9)
    assert turn_step(omega, command, lag, 0.05)[0] == pytest.approx(rate, abs=1e-12)


def seeds(flights):
    return [(0, flight) for flight in range(flights)]


def world(flights, wind=0.0, **surroundings):
    """Return a world of vehicles at the target, without motion."""
    around = Surroundings(wind=np.array([[wind], [0.0]]), **surroundings)
    return World(around, Airframe(15.0, 0.35, 0.4), np.zeros((2, flights)), np.zeros(flights), seeds(flights))


def test_gusts_have_the_strength_and_memory_asked_for():
    air = world(4000, wind=5.0, gust=1.5, gust_time=10.0)
    first = air.wind - [[5.0], [0.0]]
    for _ in range(200):
        air.step(0.05, np.zeros(4000), 0.0)
    after = air.wind - [[5.0], [0.0]]
    assert after.std() == pytest.approx(1.5, rel=0.03)
    assert (first * after).mean() / 1.5**2 == pytest.approx(np.exp(-1), abs=0.05)


def test_a_target_that_accelerates_at_random_keeps_within_its_first_speed():
    pushed = world(50, target_speed=3.0, target_walk=0.5)
    for _ in range(100):
        pushed.step(0.1, np.zeros(50), 0.0)
    speeds = np.hypot(*pushed.target_velocity)
    assert speeds.max() <= 3.0 + 1e-9
    assert speeds.std() > 0.3


@pytest.mark.parametrize(("ranging", "sigma"), [(UWB, 0.151), (LORA, 2.236), (Ranging(), 0.5)])
def test_radios_err_as_much_as_they_say(ranging, sigma):
    radio, errors = Radio(ranging, Reading(ranging.sigma), seeds(500)), []
    for step in range(100):
        z, _, arrived = radio.measure(np.full(500, 200.0), step, 0.05)
        errors.append((z - 200.0)[arrived])
    assert np.concatenate(errors).std() == pytest.approx(sigma, rel=0.1)
    assert ranging.sigma == pytest.approx(sigma, abs=1e-3)


def test_losses_outliers_and_outages_come_as_often_as_asked_for():
    ranging = Ranging(every=4, loss=0.5, outlier_share=0.1, outage=10.0)
    radio = Radio(ranging, Reading(0.5), seeds(200))
    rows = [radio.measure(np.full(200, 300.0), step, 0.05) for step in range(4800)]
    arrived = np.array([row[2] for row in rows])
    assert arrived.mean() == pytest.approx(0.25 * 0.5 * 50 / 60, rel=0.1)
    wild = np.abs(np.array([row[0] for row in rows])[arrived] - 300) > 10
    assert wild.mean() == pytest.approx(0.1 / 2, rel=0.1), "up to 20 m, either way: half of them beyond 10"


def test_ranges_near_overhead_or_out_of_bounds_do_not_count_and_slant_ones_are_made_horizontal():
    """At a height of 50 m, 8 m is too steep and 2000 m too far. At 120 m the noise grows by 130/120."""
    radio = Radio(Ranging(white=0.0), Reading(0.5, most=1000.0, height=50.0), seeds(3), 50.0)
    z, sigma, counts = radio.measure(np.array([8.0, 120.0, 2000.0]), 0, 0.05)
    assert counts.tolist() == [False, True, False]
    assert (z[1], sigma[1]) == pytest.approx((120.0, 0.5 * 130 / 120))


def test_own_motion_is_reported_with_the_noise_of_real_sensors():
    senses = MotionSensors(MotionNoise(), seeds(8))
    reports = np.array([senses.report(np.zeros(8), np.zeros(8), 15.0, 0.0) for _ in range(100)])
    errors = (reports - [[[0.0], [0.0], [15.0]]]).transpose(1, 0, 2).reshape(3, -1)
    assert errors.std(axis=1) == pytest.approx([0.02, 0.01, 0.3], rel=0.1)
    assert np.abs(np.corrcoef(errors) - np.eye(3)).max() < 0.15


def test_a_seed_is_a_flight_whoever_flies_with_it():
    once, more, other = (
        fly_situation(replace(WINDY, duration=5), policy("feedforward"), n, seed)
        for n, seed in ((4, 9), (6, 9), (4, 10))
    )
    assert once.r == pytest.approx(more.r[:, :4], rel=1e-6)
    assert not np.allclose(once.r, other.r)


def test_auto_keeps_every_flight_in_strong_wind_in_the_right_sense():
    hard = Situation("hard", wind=0.53 * 15, start=(40.0, 200.0), duration=110.0)
    tracks = fly_situation(hard, policy("auto"), 12, seed=5)
    end = tracks.time >= 90
    assert np.all(np.sqrt(np.mean((tracks.r[end] - 100) ** 2, axis=0)) < 2.0)
    assert metrics.right_way(tracks.angle[end], tracks.sense).all()


def test_no_start_leads_farther_away_than_the_tightest_circle_is_wide():
    """The diameter at the turn-rate limit is 2 V/limit = 86 m. A vehicle that turns at the limit at once departs by
    no more."""
    tracks = fly_situation(Situation("outside", start=(250.0, 250.0), duration=15.0), policy("auto"), 96, seed=9)
    assert (tracks.r.max(axis=0) - tracks.r[0]).max() < 2 * 15 / np.radians(20)


def test_the_filter_is_consistent_in_gusts():
    tracks = fly_situation(Situation("gusts", wind=5.0, gust=1.5, duration=90.0), policy("auto"), 12, seed=6)
    nees = tracks.nees[tracks.time > 45]
    assert 1.0 < np.nanmedian(nees) < 2.5
    assert np.nanmean(nees < 7.378) > 0.8


def test_range_rate_reaches_the_cramer_rao_bound_of_its_model():
    """The bound along these tracks is 0.057 m/s. It comes from the information recursion of Tichavsky, Muravchik and
    Nehorai (1998) for a drift of 3e-4 m^2/s^3. The model has the true heading. It assumes a variable drift, which is
    constant here."""
    tracks = fly_situation(Situation("calm", noise=NO_NOISE, duration=100.0), policy("auto"), 24, seed=8)
    late = tracks.time > 70
    assert metrics.rms((tracks.r_dot_hat - tracks.r_dot)[late].ravel()) < 0.057


def test_starts_lie_all_round_the_target_within_the_ranges_asked_for():
    world, *_ = begin(WINDY, 400, seed=1)
    assert (world.r.min(), world.r.max()) == pytest.approx((10.0, 600.0), abs=10.0)
    assert np.abs(np.exp(1j * np.arctan2(*world.p[::-1])).mean()) < 0.1
    assert np.hypot(*world.wind) == pytest.approx(np.full(400, 5.0))
