"""The batch: exact motion, the requested errors, and the same commands as the flight stack."""

from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest

from circnav_mav.api import tune
from circnav_mav.extras.batch import metrics
from circnav_mav.extras.batch.estimators import Auto
from circnav_mav.extras.batch.flight import (
    ESTIMATION,
    ORBIT,
    SITUATIONS,
    STALE,
    TURN_LAG,
    Situation,
    Tracks,
    begin,
    fly_situation,
    policy,
)
from circnav_mav.extras.batch.guidance import POLICIES
from circnav_mav.extras.batch.sensors import LORA, NO_NOISE, UWB, MotionNoise, MotionSensors, Radio, Ranging, Reading
from circnav_mav.extras.batch.world import Airframe, Surroundings, Truth, World, flown, turn_step
from circnav_mav.extras.bench.bench import evaluate, run
from circnav_mav.extras.bench.table import draw, line, markdown
from circnav_mav.guidance.estimators.interface import Fused
from circnav_mav.guidance.estimators.relative_motion import AutoEstimator
from circnav_mav.guidance.pending_turn import PendingTurn
from circnav_mav.guidance.step import Steering, holding
from circnav_mav.guidance.turn_response import Response
from circnav_mav.guidance.types import Direction, OwnMotion, RangeSample
from circnav_mav.mission.checks import check_mission
from circnav_mav.mission.load import load_mission
from circnav_mav.report import plots

WINDY = Situation("windy", wind=5.0, duration=30.0)
OUTAGE = Situation("outage", wind=5.0, ranging=Ranging(outage=10.0), duration=40.0)
QUICKSTART = Path(__file__).parents[3] / "config" / "quickstart.toml"


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


@pytest.mark.parametrize("law", sorted({law for law, _ in POLICIES.values()}))
def test_the_benchmark_flies_the_gain_that_the_check_of_the_quickstart_prints(law):
    (said,) = (
        line.text for line in check_mission(load_mission(QUICKSTART, [f"guidance.law={law}"])) if line.subject == "gain"
    )
    assert f"k = {tune(ORBIT, law, turn_lag=TURN_LAG).gain:.4g} " in said


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


def test_the_benchmark_tells_a_law_that_holds_from_one_that_does_not(tmp_path, monkeypatch):
    name = "wind 0.20 V"
    monkeypatch.setitem(SITUATIONS, name, replace(SITUATIONS[name], start=(80.0, 200.0), duration=140.0))
    full, feedforward = run([(name, "full information"), (name, "feedforward")], 6, 1, tmp_path)
    assert full.kept == feedforward.kept == 6
    assert full.rms_median < 0.05 < 1.0 < feedforward.rms_median
    assert (tmp_path / "table.png").stat().st_size > 10_000
    assert (tmp_path / "table.csv").read_text().count("\n") == 3
    table = (tmp_path / "table.md").read_text().splitlines()
    assert table[0] == "| situation | full information | feedforward |"
    assert table[2].startswith(f"| wind 0.20 V | {full.rms_median:.2f}, sd {full.turn_std_deg_s:.1f} | ")
    assert "at the limit 0 %" in line(full) and "limit cycles" not in line(full)
    assert "kept    6 of 6" in line(full)


@pytest.fixture(scope="module")
def cell():
    """Results of five synthetic flights from 200 m to their circle in 40 s, counter-clockwise. Three have 0, 1 and
    20 m of error, one flies in the wrong direction, and one is blown away."""
    time = np.arange(0.0, 400.0, 0.5)
    e = np.broadcast_to([0.0, 1.0, 20.0, 0.0, 300.0], (800, 5))
    r = np.where(time[:, None] < 40.0, 200.0, 100.0 + e)
    angle = np.outer(time, [0.15, 0.15, 0.15, -0.15, 0.001])
    start = Truth(np.array([[200.0], [0.0]]) * np.ones(5), np.zeros((2, 5)), np.full(5, np.pi), np.zeros(5))
    still, command = np.zeros((800, 5)), np.full((800, 5), 0.15)
    nees = np.broadcast_to([0.01, 1.0, 1.0, 1.0, np.nan], (800, 5))
    tracks = Tracks(time, r, still, angle, command, r + 0.1, still + 0.2, nees, np.ones(5), start)
    return evaluate(SITUATIONS["calm"], "auto", tracks, 0.0)


def test_what_a_cell_says_is_what_can_be_counted_by_hand(cell):
    """Kept: below 10 m and in the right direction. Straight on from 200 m, the tangent point is about 12 s away."""
    assert (cell.flights, cell.kept, cell.wrong_way, cell.limit_cycles) == (5, 2, 1, 0)
    assert (cell.rms_median, cell.rms_p95, cell.rms_max, cell.mean_error) == pytest.approx((1.0, 300.0, 300.0, 64.2))
    assert 40.0 / 15 < cell.settled10_median < 40.0 / 11 and cell.settled10_p95 == inf
    assert cell.settled2_median == cell.settled10_median
    assert (cell.closest_outside, cell.turn_std_deg_s, cell.turn_at_limit) == pytest.approx((100.0, 0.0, 0.0))
    assert (cell.range_rmse, cell.rate_rmse) == pytest.approx((0.1, 0.2))
    assert (cell.nees_mean, cell.nees_in_band) == pytest.approx((3.01 / 4, 0.75))
    assert "kept    2 of 5  wrong way 1  RMS   1.000 p95  300.000 (<= 0.12)" in line(cell)
    assert "| calm | 2 of 5 | **1.000** / 300.000 / 300.00;" in markdown([cell])


def test_the_picture_of_a_single_law_has_its_whole_title_and_says_lost_where_the_document_does(cell, monkeypatch):
    figures = []
    monkeypatch.setattr(plots, "save", lambda figure, path, dpi: figures.append(figure))
    kept = [replace(cell, situation=str(rms), rms_median=rms, kept=5) for rms in (299.0, 301.0)]
    draw(kept, Path("table.png"))
    (figure,) = figures
    figure.draw_without_rendering()
    title = figure.axes[0].title.get_window_extent()
    assert figure.bbox.x0 <= title.x0 < title.x1 <= figure.bbox.x1
    assert [text.get_text() for text in figure.axes[0].texts] == ["299.00", "lost"]
