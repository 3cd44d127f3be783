"""The learned response to turn commands: data from which it is learned, and data that are
rejected."""

from math import exp, inf, pi, sin, sqrt

import numpy as np
import pytest

from circnav_mav.guidance.turn_response import CandidateTurns, ResponseLearner, TurnBins
from circnav_mav.guidance.types import OwnMotion
from circnav_mav.guidance.vehicle_model import VehicleModel

STEP = 0.05
DEAD = 0.2
LAG = 0.15
GAIN = 0.9


class Vehicle:
    """A vehicle with a turn gain of 0.9, a dead time of 0.2 s and a lag of 0.15 s. Without uplink,
    the last turn continues for 3 s."""

    def __init__(self):
        self.model = VehicleModel(0.4, 0.5)
        self.now = 0.0
        self.heading = 0.0
        self.rate = 0.0
        self._on_the_way = [0.0] * round(DEAD / STEP)

    def fly(self, seconds, *, uplink_lost=False):
        last = self._on_the_way[-1]
        since = self.now
        for _ in range(round(seconds / STEP)):
            # The command of a circle with corrections. Without uplink the vehicle leaves the circle
            # and the command grows.
            command = (
                0.17
                + 0.1 * sin(0.9 * self.now)
                + (0.3 * min((self.now - since) / 3, 1.0) if uplink_lost else 0.0)
            )
            self.model.command(self.now, command)
            received = command if not uplink_lost else last if self.now - since < 3.0 else 0.0
            self._on_the_way.append(received)
            self.rate += (GAIN * self._on_the_way.pop(0) - self.rate) * STEP / LAG
            self.heading += self.rate * STEP
            self.now = round(self.now + STEP, 6)
            own = OwnMotion(self.now, self.heading, self.rate, 5.0)
            self.model.on_motion(own, own)
        return self.model


def test_turn_response_is_not_learned_from_lost_commands():
    """After a minute of lost commands, the learned delay of a copter was once 60 ms too short. The
    gains became so high that the copter oscillated for 45 s."""
    vehicle = Vehicle()
    before = vehicle.fly(90.0).response
    gain = vehicle.model.gain
    assert before.delay == pytest.approx(DEAD + LAG, abs=0.05)
    vehicle.fly(60.0, uplink_lost=True)
    assert vehicle.model.response.delay == pytest.approx(before.delay, abs=0.005)
    assert vehicle.model.gain == pytest.approx(gain, abs=0.005)
    vehicle.fly(20.0)
    assert vehicle.model.response.delay == pytest.approx(before.delay, abs=0.02)
    assert vehicle.model.gain == pytest.approx(gain, abs=0.02)


def turned(commands, dead, response, *, gain=0.9, most=inf, slew=inf):
    """Return the angle (rad) that a vehicle has turned at the start of each command.

    commands: turn rates, rad/s, each held for STEP.
    dead: dead time, s.
    response: (lag,) of first order, s, or (frequency, damping) of second order, rad/s.
    most: limit of the turn rate, rad/s.
    slew: limit of the change of the turn rate, rad/s^2.
    """
    dt = 0.01
    held = np.repeat(np.clip(commands, -most, most), round(STEP / dt))
    received = gain * np.concatenate((np.zeros(round(dead / dt)), held))[: held.size]
    angle = 0.0
    rate = 0.0
    acceleration = 0.0
    angles = []
    for wanted in received.tolist():
        angles.append(angle)
        if len(response) == 2:
            frequency, damping = response
            jerk = frequency**2 * (wanted - rate) - 2 * damping * frequency * acceleration
            acceleration += jerk * dt
        else:
            change = (wanted - rate) * (1 - exp(-dt / response[0])) / dt
            acceleration = min(max(change, -slew), slew)
        rate += acceleration * dt
        angle += rate * dt
    return np.array(angles[:: round(STEP / dt)])


def answer(response):
    """Return mean delay (s) and settling rate (1/s) of a response as in `turned`."""
    if len(response) == 1:
        return response[0], 1 / response[0]
    frequency, damping = response
    return 2 * damping / frequency, damping * frequency


def disturbance(seed, size, sigma, time):
    """Return a random turn rate of gusts, rad/s, with a correlation time (s)."""
    rng = np.random.default_rng(seed)
    keep = exp(-STEP / time)
    rates = [0.0]
    for kick in rng.normal(0, sigma * sqrt(1 - keep**2), size - 1).tolist():
        rates.append(keep * rates[-1] + kick)
    return np.array(rates)


def learned(commands, angles, *, expected=0.5, noise=0.005, seed=0, link=0.0):
    """Return the times (s) at which the learner has received a bin, and the learned response at
    each of them.

    expected: delay of the mission, s.
    noise: standard deviation of the reported headings, rad.
    link: known round-trip delay of the link, s.
    """
    candidates = CandidateTurns()
    bins = TurnBins(candidates)
    learner = ResponseLearner(expected)
    measured = angles + np.random.default_rng(seed).normal(0, noise, angles.size)
    times = []
    responses = []
    for n, (rate, angle) in enumerate(zip(commands.tolist(), measured.tolist(), strict=True)):
        candidates.command(n * STEP, rate)
        new = bins.add(n * STEP, angle, link)
        if new is not None:
            learner.learn(new)
            times.append(n * STEP)
            responses.append(learner.response(0.0))
    return np.array(times), responses


def delays(responses):
    return np.array([one.delay for one in responses])


def seconds(duration):
    return STEP * np.arange(round(duration / STEP))


def approach(time):
    """Return the commands of an approach with turns to both sides, and of the circle after it."""
    return np.where(time < 14.0, 0.3 * np.sign(np.sin(0.7 * time)), 0.15)


def windy_circle(time):
    """Return the commands on a circle of 100 m radius at 15 m/s, in 4.5 m/s of wind."""
    return 0.15 * (1 + 0.3 * np.sin(0.15 * time)) ** 2


@pytest.mark.parametrize(
    "response",
    [
        *((0.1,), (0.2,), (0.35,), (0.6,), (0.9,), (1.3,)),
        *((3.0, 0.3), (3.0, 0.6), (5.0, 0.3), (5.0, 0.6), (8.0, 0.4)),
    ],
    ids=str,
)
def test_response_learner_finds_response_of_real_vehicles(response):
    """The range of measured firmware: dead time 0 to 0.9 s, lag of 0.1 to 1.3 s, or poorly damped
    response. An error of 0.04 s is a tenth of a typical delay."""
    commands = approach(seconds(25.0))
    lag, settles = answer(response)
    for dead in (0.0, 0.1, 0.3, 0.7, 0.9):
        _, responses = learned(commands, turned(commands, dead, response))
        assert responses[-1].delay == pytest.approx(dead + lag, abs=0.04)
        assert responses[-1].settles == pytest.approx(settles, rel=0.2)


def test_response_is_learned_within_4_s_of_alternating_turns():
    """The circle after the approach adds little information. A delay learned from only 5 bins is
    wrong by up to 0.24 s."""
    commands = 0.3 * np.sign(np.sin(2 * pi * seconds(12.0) / 2.4 + 0.01))
    angles = turned(commands, 0.3, (0.3,))
    for seed in range(20):
        time, responses = learned(commands, angles, expected=0.4, seed=seed)
        delay = delays(responses)
        assert (delay[time > 4.0] != 0.4).all()
        assert delay[delay != 0.4] == pytest.approx(0.6, abs=0.15)


def test_response_hardly_changes_in_noisy_weak_turns():
    """For 12 s, the turns are little larger than their disturbance by gusts. The vehicle has the
    delay of the mission, so each learned change is an error."""
    commands = 0.15 + 0.05 * np.sign(np.sin(seconds(12.0)))
    angles = turned(commands, 0.25, (0.25,))
    errors = []
    for seed in range(20):
        gusts = STEP * np.cumsum(disturbance(100 + seed, angles.size, 0.02, 1.0))
        _, responses = learned(commands, angles + gusts, noise=0.01, seed=seed)
        errors.append(np.abs(np.log(delays(responses) / 0.5)).max())
    assert max(errors) < 0.3
    assert np.median(errors) == 0.0


def test_response_follows_change_of_load_on_circle():
    """After 3 min on a circle in wind and gusts, the delay of the vehicle rises from 0.4 to 0.9 s.
    With half of the memory, gusts disturb the learned delay before the change. With twice the
    memory, the new delay is not learned within 4 min."""
    time = seconds(480.0)
    commands = np.where(time < 14.0, approach(time), windy_circle(time))
    commands = commands + disturbance(0, time.size, 0.02, 2.0)
    light = turned(commands, 0.2, (0.2,))
    heavy = turned(commands, 0.3, (0.6,))
    changes = round(180.0 / STEP)
    angles = np.where(time < 180.0, light, heavy - heavy[changes] + light[changes])
    angles += STEP * np.cumsum(disturbance(7, time.size, 0.01, 2.0))
    at, responses = learned(commands, angles, expected=0.4, seed=1)
    delay = delays(responses)
    assert delay[(at > 60.0) & (at < 180.0)] == pytest.approx(0.4, abs=0.05)
    assert delay[at > 420.0].min() > 0.6


def test_large_turn_at_roll_rate_limit_changes_response_little():
    """The roll rate is limited, so a large turn has a longer delay than the small turns on the
    circle. The gains must fit the small turns."""
    time = seconds(60.0)
    commands = np.where(time < 14.0, 0.5 * approach(time), windy_circle(time))
    commands = commands + disturbance(5, time.size, 0.02, 2.0)
    commands -= np.where((time > 30.0) & (time < 33.0), 0.5, 0.0)
    at, responses = learned(commands, turned(commands, 0.2, (0.25,), slew=0.25))
    delay = delays(responses)
    assert delay[at > 30.0].max() < delay[at < 30.0][-1] + 0.2


def test_response_is_not_learned_at_bank_limit():
    """The vehicle flies a quarter of its commands."""
    time = seconds(40.0)
    commands = 0.4 * np.sin(0.5 * time) + disturbance(5, time.size, 0.03, 2.0)
    angles = turned(commands, 0.25, (0.5,), gain=1.0, most=0.1)
    _, responses = learned(commands, angles)
    assert (delays(responses) == 0.5).all()


def test_response_is_not_learned_from_swing_under_other_controller():
    """Another controller swings the vehicle by 12 deg at 1.2 rad/s. The commands, which do not
    arrive, oppose the heading error with a gain of 0.6 1/s. A response of twice the commands after
    1.3 s would give the same turns."""
    angles = 0.2 * np.sin(1.2 * seconds(40.0))
    _, responses = learned(-0.6 * angles, angles)
    assert (delays(responses) == 0.5).all()


@pytest.mark.parametrize(("change", "known"), [(0.005, False), (0.01, True)])
def test_smallest_turn_change_that_reveals_response(change, known):
    """On a large circle, the commands alternate by 0.005 or 0.01 rad/s about their mean. Light
    gusts cause turns like the smaller ones."""
    commands = 0.06 + change * np.sign(np.sin(0.7 * seconds(40.0)))
    angles = turned(commands, 0.3, (0.3,))
    _, responses = learned(commands, angles, expected=0.4, noise=0.0005)
    assert (responses[-1].delay > 0.5) == known


def test_response_is_learned_over_slow_link():
    """The turn is reported 2.5 s later than without the link."""
    commands = approach(seconds(25.0))
    angles = turned(commands, 2.5 + 0.3, (0.35,))
    _, responses = learned(commands, angles, link=2.5)
    assert responses[-1].delay == pytest.approx(0.65, abs=0.04)
