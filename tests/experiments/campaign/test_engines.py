"""A batch flies the flights of the real pilot and vehicle: same seed, same figures."""

import numpy as np
import pytest

from circnav_mav.experiments.campaign.batchable import obstacle
from circnav_mav.experiments.campaign.draws import BLOCK, Uniforms, gauss
from circnav_mav.experiments.campaign.figures import row
from circnav_mav.experiments.campaign.file import load_campaign
from circnav_mav.experiments.campaign.flights import fly_batch
from circnav_mav.experiments.campaign.lockstep import fly_lockstep
from circnav_mav.experiments.campaign.plan import prepare
from circnav_mav.experiments.campaign.surroundings import Targets
from circnav_mav.experiments.campaign.turn_gains import TurnGains
from circnav_mav.guidance.turn_gain import TurnGain, TurnGainSettings, learn
from sim.config import Ranging, Wind
from sim.sensor import RangeSensor
from sim.world import Air, TargetMotion

SHORT = '"limits.duration_s" = [60.0]\n'
WORLDS = {
    "calm": '"sim.wind.speed_mps" = [0.0]',
    "wind": '"sim.wind.speed_mps" = [4.0]\n"sim.wind.from_deg" = {uniform = [0, 360]}',
    "gusts and a moving target": (
        '"sim.wind.gust_rms_mps" = [1.0]\n"sim.target.velocity_east_mps" = [1.5]\n"sim.target.turn_rate_deg_s" = [2.0]'
    ),
    "other lags, radii, speeds": (
        '"sim.vehicle.turn_lag_s" = {uniform = [0.2, 0.8]}\n"orbit.radius_m" = {uniform = [80, 140]}\n'
        '"vehicle.speed_mps" = {uniform = [10, 18]}\n"orbit.direction" = {choice = ["clockwise", "counterclockwise"]}'
    ),
    "a slow radio that loses half": (
        '"ranging.rate_hz" = [5.0]\n"sim.ranging.rate_hz" = [5.0]\n"sim.ranging.dropout_fraction" = [0.5]'
    ),
    "a radio that fails": (
        '"sim.ranging.preset" = ["lora"]\n"sim.ranging.dropout_fraction" = [0.3]\n"ranging.sigma_m" = [2.0]'
    ),
}


def both(path, number, runs):
    """The row of a run from either engine; the batch flies it among others."""
    prepared = [prepare(load_campaign(path), n) for n in range(runs)]
    assert obstacle(prepared[number]) is None
    tracks = fly_batch(prepared)
    return row(prepared[number], tracks[number]), row(prepared[number], fly_lockstep(prepared[number]))


@pytest.mark.parametrize("law", ["smooth", "bounded", "relay", "pd", "pi", "feedforward"])
@pytest.mark.parametrize("world", WORLDS)
def test_batch_and_lockstep_give_the_same_figures_for_the_same_seed(write, world, law):
    path = write(f'{SHORT}{WORLDS[world]}\n"guidance.law" = ["{law}"]')
    batch, real = both(path, sum(map(ord, law + world)) % 5, 5)
    assert batch["engine"] == "batch"
    assert real["engine"] == "lockstep"
    assert batch["rms_m"] == pytest.approx(real["rms_m"], abs=0.001)
    assert batch["closest_m"] == pytest.approx(real["closest_m"], abs=0.002)
    turn = ("turn_std_deg_s", "turn_at_limit", "turn_variation_rad_s2", "turn_limit_cycle")
    assert [batch[name] for name in turn] == pytest.approx([real[name] for name in turn], rel=0.02, abs=0.01)
    assert (batch["settled_s"] is None) == (real["settled_s"] is None)
    if real["settled_s"] is not None:
        assert batch["settled_s"] == pytest.approx(real["settled_s"], abs=0.06)
    same = ("outcome", "engaged_s", "kept", "sense", "start_range_m", "start_bearing_deg", "start_heading_deg")
    assert {name: batch[name] for name in same} == pytest.approx({name: real[name] for name in same})


@pytest.mark.parametrize(
    ("vary", "says"),
    [
        ('"ranging.message" = ["ranging_beacon"]\n"ranging.endpoint" = ["sim"]\n"ranging.beacon_id" = [1]\n'
         '"sim.ranging.message" = ["ranging_beacon"]\n"sim.ranging.via" = ["direct"]', None),
        ('"ranging.message" = ["named_value_float"]\n"sim.ranging.message" = ["named_value_float"]', None),
        ('"ranging.rate_hz" = [20.0]\n"sim.ranging.rate_hz" = [20.0]\n"limits.tick_hz" = [10.0]', None),
        ('"sim.ranging.dropout_fraction" = [0.97]\n"limits.hold_s" = [1.0]', "no range for"),
        ('"sim.ranging.dropout_fraction" = [1.0]\n"link.wait_s" = [5.0]', "no ranging"),
    ],
)  # fmt: skip
def test_batch_and_lockstep_end_in_the_same_way(write, vary, says):
    batch, real = both(write(f"{SHORT}{vary}"), 1, 3)
    if says is None:
        assert batch["outcome"] == real["outcome"] == "completed"
        assert batch["rms_m"] == pytest.approx(real["rms_m"], rel=0.01, abs=0.01)
    else:
        assert batch["outcome"].startswith(says)
        assert real["outcome"].startswith(says)
        assert batch["kept"] is real["kept"] is False


@pytest.mark.parametrize(
    ("vary", "reason"),
    [
        ('"guidance.law" = ["auto"]', "learns how its vehicle answers"),
        ('"guidance.law" = ["drift"]', "learns how its vehicle answers"),
        ('"guidance.law" = ["smooth"]\n"guidance.estimator" = ["auto"]', "guidance.estimator"),
        ('"guidance.law" = ["switching"]', "switches"),
        ('"sim.vehicle.dynamics" = ["realistic"]', "ideal copter"),
        ('"sim.ranging.latency_s" = [0.1]', "latency"),
        ('"sim.ranging.rate_hz" = [7.0]', "multiples"),
        ('"bounds.max_range_m" = [400.0]', "bounds"),
        ('"guidance.radius_trim_per_s" = [0.05]', "trim"),
        ('"sim.ranging.outlier_fraction" = [0.15]', "outliers for noise"),
        ('"sim.ranging.outlier_fraction" = [0.25]', "outliers for noise"),
        ('"sim.ranging.outlier_fraction" = [1.0]', "outliers for noise"),
    ],
)
def test_what_a_batch_cannot_fly_has_a_reason(write, vary, reason):
    assert reason in obstacle(prepare(load_campaign(write(vary)), 0))


@pytest.mark.parametrize(
    "vary",
    [
        '"sim.ranging.outlier_fraction" = [0.1]',
        '"sim.ranging.outlier_fraction" = [0.3]\n"ranging.sigma_m" = [2.0]',
        '"sim.ranging.outlier_fraction" = [0.3]\n"sim.ranging.outlier_m" = [0.3]',
    ],
)
def test_outliers_that_the_pilot_takes_for_what_they_are_fly_in_a_batch(write, vary):
    assert obstacle(prepare(load_campaign(write(vary)), 0)) is None


def test_flights_with_as_many_outliers_as_a_batch_may_have_agree(write):
    """Of 30 m, at the share from which on they fly in lockstep."""
    world = '"sim.ranging.outlier_fraction" = [0.1]\n"sim.ranging.outlier_m" = [30.0]'
    batch, real = both(write(f'{SHORT}{world}\n"guidance.law" = ["smooth"]'), 1, 3)
    assert batch["rms_m"] == pytest.approx(real["rms_m"], rel=0.02)


def test_uniforms_and_normals_are_those_of_the_emulators_sensor():
    """The sensor's own draws, read off its samples: noise 1 m, an outlier always, no loss."""
    config = Ranging(noise_m=1.0, outlier_fraction=1.0, outlier_m=1000.0, max_range_m=1e6)
    uniforms = Uniforms([5, 6], "ranging", 6)
    _, sine = gauss(*uniforms.first(2))
    sensors = [RangeSensor(config, seed) for seed in (5, 6)]
    for _ in range(BLOCK + 3):
        _, _, spread, _, turn, size = uniforms.next()
        expected = [sensor.measure(5000.0, 0).distance for sensor in sensors]
        assert 5000 + sine + 1000 * (2 * spread - 1) == pytest.approx(expected, abs=1e-9)
        _, sine = gauss(turn, size)


def test_gusts_are_those_of_the_emulator():
    uniforms, kept = Uniforms([9], "gusts", 2), np.exp(-0.1 / 3.0)
    air, north = Air(Wind(gust_rms_mps=2.0), 9), 0.0
    for _ in range(5):
        air.gust()
        north = kept * north + 2.0 * np.sqrt(1 - kept**2) * gauss(*uniforms.next())[0][0]
        assert north == pytest.approx(air.velocity[0])


@pytest.mark.parametrize("turn", [0.0, 3.0])
def test_targets_are_where_the_emulator_has_them(write, turn):
    vary = ("velocity_north_mps = {uniform = [-3, 3]}", "velocity_east_mps = {uniform = [-3, 3]}",
            "acceleration_mps2 = {uniform = [0, 0.1]}", f"turn_rate_deg_s = [{turn}]")  # fmt: skip
    campaign = load_campaign(write("\n".join(f"sim.target.{line}" for line in vary)))
    runs = [prepare(campaign, n) for n in range(4)]
    for t in (0.0, 0.4, 77.0):
        theirs = np.array([TargetMotion(run.vehicle.target).at(t)[1::-1] for run in runs]).T
        assert Targets(runs).at(t) == pytest.approx(theirs, abs=1e-6)


def test_turn_gains_are_learnt_as_in_flight(write):
    runs = [prepare(load_campaign(write('"vehicle.turn_lag_s" = [0.3]')), n) for n in range(2)]
    many, one, rng, heading = TurnGains(runs, 0.05), TurnGain(), np.random.default_rng(0), 0.0
    for step in range(600):
        told = 0.2 * np.sin(step / 40) + 0.1
        heading += 0.85 * told * 0.05 + rng.normal(0, 1e-3)
        one = learn(one, TurnGainSettings(lag=0.3), time=0.05 * step, heading=heading, command=told)
        many.feel(0.05 * step, np.full(2, heading), np.full(2, told), np.full(2, True))
        assert many.now == pytest.approx(np.full(2, one.gain), abs=1e-9)
    assert one.gain == pytest.approx(0.85, abs=0.05)
