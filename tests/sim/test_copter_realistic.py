"""The realistic copter against what ArduCopter 4.6.3 did when flown."""

import math
from typing import Any

import pytest

from sim.vehicle import Truth
from tests.sim.station import Station, build

REAL = {"dynamics": "realistic", "max_turn_rate_deg_s": 200.0}


def flying(speed: float) -> Any:
    return Station(
        build(
            vehicle=REAL, start={"mode": "GUIDED", "speed_mps": speed}, truth={"rate_hz": 0}, ranging={"rate_hz": 0.0}
        )
    )


def slip(truth: Truth) -> float:
    """Degrees by which the nose is ahead of the course, positive when it leads the turn."""
    lead = math.degrees(math.remainder(truth.heading - truth.course, math.tau))
    return math.copysign(1.0, truth.turn_rate) * lead


@pytest.mark.parametrize(
    ("speed", "rate", "turned", "slipped"),
    [(3.0, 0.2, 0.2018, 5.0), (5.0, 0.3, 0.311, 10.0), (5.0, -0.5, -0.528, 24.0)],
)
def test_a_velocity_alone_turns_faster_than_asked_and_slips(
    speed: float, rate: float, turned: float, slipped: float
) -> None:
    companion = flying(speed)
    companion.fly(20.0, speed, rate)
    truth = companion.vehicle.truth
    assert truth.turn_rate == pytest.approx(turned, rel=0.015)
    assert slip(truth) == pytest.approx(slipped, abs=2.5)
    assert truth.ground_speed == pytest.approx(speed, rel=0.03)


def test_with_the_acceleration_fed_forward_it_hardly_slips() -> None:
    companion = flying(5.0)
    companion.repeat(20.0, lambda: companion.turn(5.0, 0.3))
    assert slip(companion.vehicle.truth) == pytest.approx(2.0, abs=1.0)


def test_slow_setpoints_slip_more_because_they_are_rotated_once() -> None:
    slips = []
    for rate in (20.0, 2.0):
        companion = flying(5.0)
        companion.fly(20.0, 5.0, 0.3, rate=rate)
        lags = []
        for _ in range(50):
            companion.fly(1 / rate, 5.0, 0.3, rate=rate)
            lags.append(slip(companion.vehicle.truth))
        slips.append(sum(lags) / len(lags))
    assert slips[1] - slips[0] == pytest.approx(4.5, abs=2.0)  # flown: 10 and 16 deg


def test_attitude_setpoints_turn_the_course_only_if_the_yaw_is_led_round() -> None:
    for leads, course_turns in ((True, True), (False, False)):
        companion = flying(5.0)
        heading = [0.0]

        def send(companion: Any = companion, heading: list[float] = heading, leads: bool = leads) -> None:
            heading[0] += 0.3 / 20
            bank, pitch = math.atan(5 * 0.3 / 9.8), math.radians(-4)
            if leads:
                companion.attitude(7, bank, pitch, heading[0])
            else:
                companion.attitude(128, rates=(0.0, 0.0, 0.3))

        companion.repeat(10.0, send)
        before = companion.vehicle.truth.course
        companion.repeat(2.0, send)
        turned = math.remainder(companion.vehicle.truth.course - before, math.tau) / 2
        assert companion.vehicle.truth.turn_rate == pytest.approx(0.3, abs=0.02)
        assert (turned == pytest.approx(0.3, abs=0.03)) == course_turns


def test_half_thrust_holds_the_height_and_more_climbs() -> None:
    companion = flying(0.0)
    companion.repeat(5.0, lambda: companion.attitude(7))
    assert companion.vehicle.truth.down == pytest.approx(-50.0, abs=0.01)
    companion.repeat(4.0, lambda: companion.attitude(7, thrust=1.0))
    assert companion.vehicle.truth.down == pytest.approx(-59.3, abs=0.5)  # 2.5 m/s


def test_rates_in_part_are_ill_defined_and_no_throttle_is_dropped() -> None:
    companion = flying(5.0)
    companion.fly(1.0, 5.0, 0.0)
    companion.attitude(64 | 7)
    assert len(companion.vehicle.setpoint_log) == 20  # dropped without a trace
    companion.wait(1.0)
    assert companion.vehicle.truth.ground_speed > 4.5
    companion.attitude(3)
    companion.wait(3.0)
    assert companion.vehicle.truth.ground_speed < 0.1


class TestGuidedNoGps:
    def at(self) -> Any:
        companion = Station(build(vehicle={"profile": "arducopter_nogps"}, start={"speed_mps": 5.0}))
        assert companion.command(176, 1, 4) == [4]
        assert companion.command(176, 1, 20) == [0]
        return companion

    def test_it_leans_and_drags(self) -> None:
        companion = self.at()
        companion.repeat(40.0, lambda: companion.attitude(7, 0.0, math.radians(-4)))
        assert companion.vehicle.truth.ground_speed == pytest.approx(3.7, abs=0.1)

    def test_three_seconds_of_silence_level_it_and_it_drifts(self) -> None:
        companion = self.at()
        companion.repeat(5.0, lambda: companion.attitude(7, 0.3, 0.0, 0.0))
        companion.wait(3.5)
        assert abs(companion.vehicle.truth.roll) < 0.02 and companion.vehicle.truth.mode == 20
        assert companion.vehicle.truth.ground_speed > 1.0

    def test_a_position_target_stops_it_and_makes_it_sink(self) -> None:
        companion = self.at()
        companion.repeat(8.0, lambda: companion.velocity(5.0, 0.2))
        assert companion.vehicle.truth.down == pytest.approx(-45.0, abs=0.5)
        assert companion.vehicle.setpoint_log == [] and companion.vehicle.truth.mode == 20
