"""The learned response to turn commands: data from which it is learned, and data that are
rejected."""

from math import sin

import pytest

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
