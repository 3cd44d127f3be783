"""A batch flies like the real pilot and vehicle: the same circles in the emulator's world, with the emulator's
radio."""

import numpy as np
import pytest
from circnav_sim.sensor import RangeSensor
from circnav_sim.world import Air, target_at

from circnav_mav.extras.campaign.figures import row
from circnav_mav.extras.campaign.flights import emulated_radio, emulated_world, fly_batch
from circnav_mav.extras.campaign.fly import lockstep_reason
from circnav_mav.extras.campaign.lockstep import fly_lockstep
from circnav_mav.extras.campaign.plan import load_campaign, prepare

CELLS = {
    "pi, gusts, a moving target, other lags, radii, speeds, senses": (
        '"guidance.law" = ["pi"]\n"sim.wind.gust_rms_mps" = [0.3]\n"sim.target.velocity_east_mps" = [1.5]\n'
        '"sim.target.turn_rate_deg_s" = [2.0]\n"sim.vehicle.turn_lag_s" = {uniform = [0.2, 0.8]}\n'
        '"orbit.radius_m" = {uniform = [80, 140]}\n"vehicle.speed_mps" = {uniform = [10, 18]}\n'
        '"orbit.direction" = {choice = ["clockwise", "counterclockwise"]}'
    ),
    "auto, wind, outliers, a slow radio that loses half": (
        '"guidance.law" = ["auto"]\n"sim.ranging.outlier_fraction" = [0.1]\n"sim.wind.speed_mps" = [4.0]\n'
        '"sim.wind.from_deg" = {uniform = [0, 360]}\n"ranging.rate_hz" = [5.0]\n"sim.ranging.rate_hz" = [5.0]\n'
        '"sim.ranging.dropout_fraction" = [0.5]'
    ),
}


def both(path, runs):
    """Return the rows of the runs from each engine."""
    prepared = [prepare(load_campaign(path), n) for n in range(runs)]
    assert [lockstep_reason(run) for run in prepared] == [None] * runs
    batch = [row(run, track) for run, track in zip(prepared, fly_batch(prepared), strict=True)]
    return batch, [row(run, fly_lockstep(run)) for run in prepared]


@pytest.mark.parametrize("cell", CELLS)
def test_batch_and_lockstep_fly_the_same_circles(write, cell):
    """Same start and world, other noise: errors from wind and law are equal, errors from noise are similar."""
    batch, real = both(write(f'"limits.duration_s" = [75.0]\n{CELLS[cell]}'), 4)
    assert {(one["engine"], other["engine"]) for one, other in zip(batch, real, strict=True)} == {("batch", "lockstep")}
    for one, other in zip(batch, real, strict=True):
        same = ("outcome", "sense", "start_range_m", "start_bearing_deg", "start_heading_deg")
        assert {name: one[name] for name in same} == pytest.approx({name: other[name] for name in same})
        assert one["engaged_s"] == pytest.approx(other["engaged_s"], abs=3.0)
    for name, least in (("rms_m", 0.5), ("closest_m", 2.0), ("turn_std_deg_s", 0.5)):
        mean, expected = (np.mean([one[name] for one in engine]) for engine in (batch, real))
        assert mean == pytest.approx(expected, rel=0.2, abs=least), name


@pytest.mark.parametrize(
    ("vary", "says"),
    [
        ('"ranging.message" = ["ranging_beacon"]\n"ranging.endpoint" = ["sim"]\n"ranging.beacon_id" = [1]\n'
         '"sim.ranging.message" = ["ranging_beacon"]\n"sim.ranging.via" = ["direct"]', "completed"),
        ('"ranging.rate_hz" = [7.0]\n"sim.ranging.rate_hz" = [7.0]\n"limits.tick_hz" = [10.0]', "completed"),
        ('"sim.ranging.dropout_fraction" = [0.97]\n"limits.hold_s" = [1.0]', "no range for"),
        ('"sim.ranging.dropout_fraction" = [1.0]\n"link.wait_s" = [5.0]', "no ranging"),
    ],
)  # fmt: skip
def test_batch_and_lockstep_end_in_the_same_way(write, vary, says):
    for engine in both(write(f'"limits.duration_s" = [30.0]\n{vary}'), 1):
        assert engine[0]["outcome"].startswith(says)


@pytest.mark.parametrize(
    ("vary", "reason"),
    [
        ('"sim.vehicle.dynamics" = ["realistic"]', "ideal copter"),
        ('"sim.ranging.latency_s" = [0.1]', "latency"),
        ('"bounds.max_range_m" = [400.0]', "bounds"),
        ('"guidance.radius_trim_per_s" = [0.05]', "trim"),
        ('"sim.ranging.noise_m" = [1.0]', "range noise is larger"),
        ('"sim.ranging.outlier_fraction" = [0.15]', "outliers as noise"),
    ],
)
def test_what_a_batch_cannot_fly_has_a_reason(write, vary, reason):
    assert reason in lockstep_reason(prepare(load_campaign(write(vary)), 0))


def test_a_range_that_never_comes_engages_nothing_and_flies_alone(write):
    """The pilot waits for another beacon than the emulator's. Batches have no beacon ids, so no batch is flown."""
    vary = ('"ranging.message" = ["ranging_beacon"]\n"ranging.endpoint" = ["sim"]\n"ranging.beacon_id" = [9]\n'
            '"sim.ranging.message" = ["ranging_beacon"]\n"sim.ranging.via" = ["direct"]\n'
            '"link.wait_s" = [3.0]')  # fmt: skip
    assert fly_batch([prepare(load_campaign(write(vary)), 0)]) is None


def test_targets_are_where_the_emulator_has_them(write):
    vary = ("velocity_north_mps = {uniform = [-3, 3]}", "velocity_east_mps = {uniform = [-3, 3]}",
            "acceleration_mps2 = {uniform = [0, 0.1]}", "turn_rate_deg_s = [0.0, 3.0]")  # fmt: skip
    runs = [prepare(load_campaign(write("\n".join(f"sim.target.{line}" for line in vary))), n) for n in range(4)]
    world = emulated_world(runs)
    start = world.p
    for _ in range(800):
        world.step(0.05, np.zeros(4), np.zeros(4))
    moved = [target_at(run.vehicle.target, 40.0)[1::-1] for run in runs]
    first = [target_at(run.vehicle.target, 0.0)[1::-1] for run in runs]
    assert start - world.p == pytest.approx(np.array(moved).T - np.array(first).T, abs=0.02)


def test_the_wind_blows_to_where_the_emulators_does_and_carries_what_flies_through_the_air(write):
    """In 2 s of straight flight the vehicle moves at V through the air. Airborne dynamics add the wind."""
    vary = ('"sim.wind.speed_mps" = [6.0]\n"sim.wind.from_deg" = {uniform = [0, 360]}\n'
            '"sim.vehicle.dynamics" = ["airborne", "unicycle"]')  # fmt: skip
    runs = [prepare(load_campaign(write(vary)), n) for n in range(4)]
    world, airborne = emulated_world(runs), np.array([1.0, 0.0, 1.0, 0.0])
    blows = np.array([Air(run.vehicle.wind, 0).velocity[::-1] for run in runs]).T
    nose = np.array(
        [(np.sin(h), np.cos(h)) for h in np.radians([run.vehicle.start.random.heading_deg[0] for run in runs])]
    ).T
    before = world.p
    for _ in range(40):
        world.step(0.05, np.zeros(4), np.ones(4))
    assert world.p - before == pytest.approx(2.0 * (15.0 * nose + airborne * blows))


@pytest.mark.parametrize("preset", ["gaussian", "uwb", "lora"])
def test_radios_err_as_the_emulators_do(write, preset):
    """40 radios for 100 s at 25 m, where the near bias counts: same mean, same scatter, same loss."""
    vary = (f'"sim.ranging.preset" = ["{preset}"]\n"sim.ranging.bias_m" = [1.0]\n"sim.ranging.noise_m" = [0.4]\n'
            '"sim.ranging.dropout_fraction" = [0.2]\n"sim.ranging.outlier_fraction" = [0.1]\n'
            '"sim.ranging.outlier_m" = [6.0]\n"orbit.height_above_target_m" = [0.0]\n'
            '"sim.start.altitude_m" = [20.0]')  # fmt: skip
    runs = [prepare(load_campaign(write(vary)), n) for n in range(40)]
    radio, ours, theirs = emulated_radio(runs, 1), [], []
    sensors = [RangeSensor(run.vehicle.ranging, run.vehicle.seed) for run in runs]
    for step in range(1000):
        z, _, arrived = radio.measure(np.full(40, 15.0), step, 0.1)
        ours.append(np.where(arrived, z, np.nan))
        samples = [sensor.measure(25.0, step * 100_000) for sensor in sensors]
        theirs.append([np.nan if sample is None else sample.distance for sample in samples])
    assert np.nanmean(ours) == pytest.approx(np.nanmean(theirs), abs=0.35)
    assert np.nanstd(ours) == pytest.approx(np.nanstd(theirs), rel=0.08)
    assert np.isnan(ours).mean() == pytest.approx(np.isnan(theirs).mean(), abs=0.02)


@pytest.mark.parametrize(
    ("message", "noise", "sigma"),
    [("distance_sensor", 0.1, 0.1), ("distance_sensor", 0.4, 0.5), ("named_value_float", 0.1, 0.5)],
)
def test_a_range_comes_with_the_deviation_that_its_message_can_tell(write, message, noise, sigma):
    """DISTANCE_SENSOR carries variances up to 254 cm^2. Otherwise the mission's value counts."""
    vary = (f'"ranging.message" = ["{message}"]\n"sim.ranging.message" = ["{message}"]\n'
            f'"sim.ranging.noise_m" = [{noise}]\n"sim.ranging.report_accuracy" = [true]')  # fmt: skip
    radio = emulated_radio([prepare(load_campaign(write(vary)), 0)], 1)
    _, said, _ = radio.measure(np.array([4000.0]), 0, 0.1)
    assert said == pytest.approx(sigma, rel=1e-3)
