"""The batch: exact motion, the errors that were asked for, and the same numbers as the stack in the air."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from circnav_mav.experiments import bench_picture
from circnav_mav.experiments.batch import metrics
from circnav_mav.experiments.batch.filters import BatchKalman
from circnav_mav.experiments.batch.flight import Circle, Situation, fly
from circnav_mav.experiments.batch.policies import POLICIES, STALE, Auto
from circnav_mav.experiments.batch.sensors import LORA, NO_NOISE, UWB, Radio, Ranging
from circnav_mav.experiments.batch.world import Air, Target, Targets, Wind, flown, turn_step
from circnav_mav.experiments.bench import fly_cell, line, run
from circnav_mav.experiments.bound import AlongsideBound
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.range_rate import KalmanRangeRate
from circnav_mav.guidance.estimators.relative_motion import AutoEstimator
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.step import LawChoice, holding, steering
from circnav_mav.guidance.turn_response import PendingTurn, Response
from circnav_mav.guidance.types import Direction, Orbit, OwnMotion, RangeSample

WINDY = Situation("windy", wind=Wind(5.0), duration=30.0)

OUTAGE = Situation("outage", wind=Wind(5.0), ranging=Ranging(outage=10.0), duration=60.0)


class InTheAir:
    """The estimator and the steering that fly, one pair per flight, driven from the batch."""

    belief = None

    def __init__(self, circle, sense):
        settings = EstimatorSettings(circle.speed, circle.max_turn_rate)
        ways = [Direction.COUNTERCLOCKWISE if s > 0 else Direction.CLOCKWISE for s in sense]
        orbits = [Orbit(circle.radius, way, circle.speed, circle.max_turn_rate) for way in ways]
        gain = LAWS["auto"].default_gain(circle.speed, circle.radius)
        self.flights = [
            (o, AutoEstimator(settings), steering(o, LawChoice("auto", gain)), PendingTurn()) for o in orbits
        ]
        self.answer = Response(0.0, circle.lag, 1 / circle.lag)
        self.estimate, self.time = (0.0, 0.0), 0.0
        self.newest = [-np.inf] * sense.size

    def command(self, seen, true):
        turns = [self.turn(seen, i, *flight) for i, flight in enumerate(self.flights)]
        self.time += seen.dt
        return np.array(turns)

    def turn(self, seen, i, orbit, estimator, steer, under_way):
        estimator.move(OwnMotion(self.time, float(seen.psi[i]), float(seen.turn_rate[i]), float(seen.airspeed[i])))
        if seen.arrived[i]:
            estimator.observe(RangeSample(self.time, self.time, float(seen.z[i]), float(seen.sigma[i])))
            self.newest[i] = self.time
        estimate, pending = estimator.at(self.time), under_way.at(self.time, self.answer, float(seen.turn_rate[i]))
        if estimator.ready and self.time - self.newest[i] < STALE + 1e-6:
            command = steer(estimate, 0.0, pending).turn_rate
        else:
            command = holding(orbit, estimate.relative if estimate else None, pending).turn_rate
        under_way.command(self.time, command)
        return command


def test_the_stack_in_the_air_flies_the_same_numbers_as_the_batch():
    """To the last place of single precision, which tracks are kept in: in the air sines are the C library's."""
    air, batch = fly(WINDY, InTheAir, 2, seed=3), fly(WINDY, Auto, 2, seed=3)
    assert np.abs(air.r - batch.r).max() < 1e-6
    assert (np.abs(air.command - batch.command) <= np.spacing(np.abs(batch.command))).all()


def test_the_stack_in_the_air_holds_through_an_outage_as_the_batch_does():
    """Not bit by bit: in the air the bank takes one long step to the next range, in the batch many short ones."""
    air, batch = fly(OUTAGE, InTheAir, 2, seed=3), fly(OUTAGE, Auto, 2, seed=3)
    assert np.abs(air.r - batch.r).max() < 0.05


def test_an_outage_in_wind_leaves_the_vehicle_on_its_circle():
    """The circle's own turn in the drift known; V/r_d would let 5 m/s of wind carry it off for 10 s."""
    tracks = fly(OUTAGE.lasting(180.0), Auto, 8, seed=4)
    assert np.abs(tracks.r[tracks.time > 90] - 100.0).max() < 5.0


def test_batch_kalman_is_the_estimator_in_flight():
    rng = np.random.default_rng(1)
    one, many = KalmanRangeRate(EstimatorSettings(15.0, 0.35)), BatchKalman(15.0, 0.35, 3)
    for i in range(300):
        z = 200 - 5 * 0.05 * i + rng.normal(0, 0.5) + (50.0 if i % 40 == 7 or 200 < i < 210 else 0.0)
        arrived = i % 3 != 1
        many.step(0.05 if i else 0.0, np.full(3, z), np.full(3, 0.5), np.full(3, arrived))
        if arrived:
            one.observe(RangeSample(0.05 * i, 0.05 * i, z, 0.5))
        estimate = one.at(0.05 * i)
        assert (many.r[1], many.r_dot[1]) == pytest.approx((estimate.r, estimate.r_dot), rel=1e-6, abs=1e-6)
        assert bool(many.ready[1]) == one.ready


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


def test_gusts_have_the_strength_and_memory_asked_for():
    air = Air(Wind(5.0, 1.5, 10.0), 4000, np.random.default_rng(0))
    first = air.velocity - air._mean
    for _ in range(200):
        air.step(0.05)
    after = air.velocity - air._mean
    assert after.std() == pytest.approx(1.5, rel=0.03)
    assert (first * after).mean() / 1.5**2 == pytest.approx(np.exp(-1), abs=0.05)


@pytest.mark.parametrize(("ranging", "sigma"), [(UWB, 0.151), (LORA, 2.236), (Ranging(), 0.5)])
def test_radios_err_as_much_as_they_say(ranging, sigma):
    radio, errors = Radio(ranging, 500, np.random.default_rng(0)), []
    for step in range(100):
        z, arrived = radio.measure(np.full(500, 200.0), step, 0.05)
        errors.append((z - 200.0)[arrived])
    assert np.concatenate(errors).std() == pytest.approx(sigma, rel=0.1)
    assert ranging.sigma == pytest.approx(sigma, abs=1e-3)


def test_own_motion_is_reported_with_the_noise_of_real_sensors_and_from_a_seed():
    seen = []

    class Listening(Auto):
        def command(self, now, true):
            seen.append((now.psi - true.psi, now.turn_rate - true.turn_rate, now.airspeed - 15.0))
            return super().command(now, true)

    fly(Situation("calm", duration=5.0), Listening, 8, seed=2)
    first = np.array(seen).transpose(1, 0, 2).reshape(3, -1)
    assert first.std(axis=1) == pytest.approx([0.02, 0.01, 0.3], rel=0.1)
    assert np.abs(np.corrcoef(first) - np.eye(3)).max() < 0.1
    seen.clear()
    fly(Situation("calm", duration=5.0), Listening, 8, seed=2)
    assert np.array_equal(np.array(seen).transpose(1, 0, 2).reshape(3, -1), first)


def test_losses_outliers_and_outages_come_as_often_as_asked_for():
    radio = Radio(Ranging(every=4, loss=0.5, outlier_share=0.1, outage=10.0), 200, np.random.default_rng(0))
    rows = [radio.measure(np.full(200, 300.0), step, 0.05) for step in range(4800)]
    arrived = np.array([row[1] for row in rows])
    assert arrived.mean() == pytest.approx(0.25 * 0.5 * 50 / 60, rel=0.1)
    wild = np.abs(np.array([row[0] for row in rows])[arrived] - 300) > 10
    assert wild.mean() == pytest.approx(0.1, rel=0.1)


def test_targets_turn_and_accelerate_within_their_speed():
    turning = Targets(Target(3.0, turn_rate=0.1), 5, np.random.default_rng(0))
    before = turning.velocity.copy()
    turning.step(0.5)
    assert np.hypot(*turning.velocity) == pytest.approx(np.full(5, 3.0))
    assert np.abs((before * turning.velocity).sum(axis=0) / 9) == pytest.approx(np.full(5, np.cos(0.05)))
    pushed = Targets(Target(3.0, acceleration=0.5), 50, np.random.default_rng(0))
    for _ in range(100):
        pushed.step(0.1)
    assert np.all(np.hypot(*pushed.velocity) <= 3.0 + 1e-9)


def test_a_seed_is_a_flight():
    once, again = (fly(WINDY.lasting(5), POLICIES["feedforward"], 4, seed=9) for _ in range(2))
    assert np.array_equal(once.r, again.r)
    assert not np.array_equal(once.r, fly(WINDY.lasting(5), POLICIES["feedforward"], 4, seed=10).r)


def test_auto_keeps_every_flight_in_strong_wind_in_the_right_sense():
    situation = Situation("hard", wind=Wind(0.53 * 15), duration=170.0)
    tracks = fly(situation, Auto, 24, seed=5)
    end = tracks.time >= 150
    assert np.all(np.sqrt(np.mean((tracks.r[end] - 100) ** 2, axis=0)) < 2.0)
    swept = np.unwrap(tracks.angle[end], axis=0)
    assert np.array_equal(np.sign(swept[-1] - swept[0]), tracks.sense)


def test_the_filter_is_consistent_in_gusts():
    tracks = fly(Situation("gusts", wind=Wind(5.0, 1.5), duration=120.0), Auto, 24, seed=6)
    nees = tracks.nees[tracks.time > 60]
    assert 1.0 < np.nanmedian(nees) < 2.5
    assert np.nanmean(nees < 7.378) > 0.8


def test_range_rate_reaches_the_cramer_rao_bound_of_its_model():
    """The model knows its own heading: the estimate takes the newest one as it is reported, noise and all."""
    made = []

    def alongside(circle, sense):
        made.append(AlongsideBound(Auto(circle, sense), circle, sense.size, 3e-4, 0.0))
        return made[0]

    tracks = fly(Situation("calm", noise=NO_NOISE, duration=100.0), alongside, 24, seed=8)
    late = tracks.time > 70
    rmse = np.sqrt(np.mean((tracks.r_dot_hat - tracks.r_dot)[late] ** 2))
    assert rmse < 1.1 * np.mean(np.array(made[0].rate_bound)[late])


def test_a_cell_of_the_benchmark_tells_a_law_that_holds_from_one_that_does_not(tmp_path):
    cells = run([("wind .20 V", "full information"), ("wind .20 V", "feedforward")], 12, 1, tmp_path)
    full, feedforward = cells
    assert full.kept == feedforward.kept == 12
    assert full.rms_median < 0.05 < 2.5 < feedforward.rms_median < 4.5
    assert (tmp_path / "table.png").stat().st_size > 10_000
    assert (tmp_path / "table.csv").read_text().count("\n") == 3
    table = (tmp_path / "table.md").read_text().splitlines()
    assert table[0] == "| situation | full information | feedforward |"
    assert table[2].startswith(f"| wind .20 V | {full.rms_median:.2f}, sd {full.turn_std_deg_s:.1f} | ")
    assert "at the limit 0 %" in line(full) and "limit cycles" not in line(full)
    assert "kept   12 of 12" in line(full)


def test_a_flight_the_wrong_way_round_is_not_kept_and_told(monkeypatch):
    """Of six flights on the circle the first two are taken for such."""
    monkeypatch.setattr(metrics, "right_way", lambda angle, sense: np.arange(sense.size) >= 2)
    cell = fly_cell("calm", "pd", 6, 2)
    assert (cell.kept, cell.wrong_way) == (4, 2)
    assert "kept    4 of 6  wrong way 2  RMS" in line(cell)


def test_a_flight_that_is_lost_downwind_is_not_told_as_one_the_wrong_way_round():
    cell = fly_cell("wind .53 V", "smooth", 12, 1)
    assert cell.kept < 12
    assert cell.wrong_way == 0


def test_the_picture_of_a_single_law_has_its_whole_title_and_says_lost_where_the_document_does(monkeypatch):
    figures = []
    monkeypatch.setattr(bench_picture, "save", lambda figure, path, dpi: figures.append(figure))
    cell = fly_cell("calm", "pd", 6, 2)
    far, gone = (replace(cell, situation=str(rms), rms_median=rms) for rms in (299.0, 301.0))
    bench_picture.draw([far, gone], Path("table.png"))
    (figure,) = figures
    figure.draw_without_rendering()
    title = figure.axes[0].title.get_window_extent()
    assert figure.bbox.x0 <= title.x0 < title.x1 <= figure.bbox.x1
    assert [text.get_text() for text in figure.axes[0].texts] == ["299.00", "lost"]


def test_a_cell_prints_the_same_numbers_alone_and_in_a_table():
    first, second = (fly_cell("calm", "pd", 6, 2) for _ in range(2))
    assert first.rms_median == second.rms_median


def test_the_paper_law_is_at_home_in_calm_air():
    cell = fly_cell("calm", "smooth", 12, 1)
    assert (cell.kept, cell.wrong_way) == (12, 0)
    assert cell.rms_median < 0.12
    assert Circle().radius == 100.0
