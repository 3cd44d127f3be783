"""The batch against a flight through MAVLink: the same law, start, wind and range noise must give the same path."""

from dataclasses import dataclass
from math import hypot, pi

import numpy as np
import pytest

from circnav_mav.experiments.batch.flight import Circle, Situation, Tracks, World, fly_in
from circnav_mav.experiments.batch.policies import POLICIES
from circnav_mav.experiments.batch.sensors import GAUSSIAN, NO_NOISE
from circnav_mav.experiments.batch.world import Air, Target, Targets, Wind
from circnav_mav.pilot.mission_state import Phase
from sim.vehicle import Truth
from tests.flight.lockstep import Flight, clockwise_turns, flight, last_third

DURATION, DT = 120.0, 0.05
VEHICLE = (
    "vehicle.max_turn_rate_deg_s=20.0",
    "guidance.radius_trim_per_s=0.0",
    'sim.vehicle.dynamics="airborne"',
    "ranging.rate_hz=20.0",
    "sim.ranging.rate_hz=20.0",
    f"limits.duration_s={DURATION}",
)


@dataclass
class Heard:
    """The radio of the MAVLink flight, once more: its errors, sample by sample."""

    errors: list[float]

    def measure(self, r, step, dt):
        """As `Radio`."""
        return r + self.errors[step], np.array([True])


def flown_through_mavlink(seed: int, wind: float) -> tuple[Flight, Truth, list[float], list[float]]:
    """A lockstep flight with the truth at its first steered tick, and the range errors and true ranges from there."""
    flown = flight("quickstart", *VEHICLE, f"sim.wind.speed_mps={wind}", f"sim.seed={seed}", law="auto")
    starts, errors, ranges = [], [], []
    observe = flown.pilot.tracker.estimator.observe

    def listen(sample):
        truth = flown.vehicle.truth
        ranges.append(hypot(truth.north - truth.target_north, truth.east - truth.target_east))
        errors.append(sample.r - ranges[-1])
        return observe(sample)

    def watch(now):
        if not starts and now.pilot.phase is Phase.ENGAGED:
            starts.append((now.vehicle.truth, len(errors) - 1))

    flown.pilot.tracker.estimator.observe = listen
    flown.fly(DURATION + 30, watch)
    truth, first = starts[0]
    return flown, truth, errors[first:], ranges[first:]


def flown_in_the_batch(truth: Truth, errors: list[float], wind: float, seconds: float) -> Tracks:
    """The same in the batch: paper frame, x to the east and y to the north."""
    rng = np.random.default_rng(0)
    situation = Situation(
        "as flown", circle=Circle(max_turn_rate=np.radians(20.0)), duration=seconds, dt=DT, noise=NO_NOISE
    )
    air, targets = Air(Wind(wind), 1, rng), Targets(Target(), 1, rng)
    air._mean = np.array([[truth.wind_east], [truth.wind_north]])
    world = World(
        sense=np.array([-1.0]),
        p=np.array([[truth.east - truth.target_east], [truth.north - truth.target_north]]),
        psi=np.array([pi / 2 - truth.heading]),
        turn_rate=np.array([-truth.turn_rate]),
        air=air,
        targets=targets,
        radio=Heard(errors),
        airspeed=np.array([15.0]),
        compass=np.zeros(1),
        compass_drift=np.zeros(1),
        sigma=np.array([GAUSSIAN.sigma]),
        noise=rng,
    )
    return fly_in(world, situation, POLICIES["auto"])


@pytest.mark.parametrize(("wind", "seed"), [(0.0, 7), (5.0, 8)])
def test_auto_flies_the_same_circle_in_the_batch_as_through_mavlink(wind: float, seed: int) -> None:
    """While it searches, the paths may differ: in the air the range has been heard since before the engagement."""
    flown, truth, errors, ranges = flown_through_mavlink(seed, wind)
    steps = len(errors) - 1
    batch = flown_in_the_batch(truth, errors, wind, steps * DT)
    late = slice(-round(40 / DT), None)
    by_batch, by_mavlink = batch.r[late, 0], np.array(ranges[:steps])[late]
    assert np.abs(by_batch - by_mavlink).max() < 0.4
    assert rms(by_batch) == pytest.approx(rms(by_mavlink), rel=0.1)
    assert clockwise_turns(last_third(flown)) > 0.8
    assert np.unwrap(batch.angle[late, 0])[-1] < np.unwrap(batch.angle[late, 0])[0]


def rms(ranges):
    return np.sqrt(np.mean((ranges - 100.0) ** 2))
