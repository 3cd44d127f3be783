"""Rover 4.6.3 as flown: a speed and a turn rate, whatever the frame says."""

import math
from typing import Any

import pytest

from tests.sim.station import Station, build


def rover(**tables: Any) -> Any:
    tables.setdefault("start", {"mode": "GUIDED"})
    return Station(build(vehicle={"profile": "ardurover"}, truth={"rate_hz": 0}, ranging={"rate_hz": 0.0}, **tables))


@pytest.mark.parametrize("frame", [1, 8, 9])
@pytest.mark.parametrize(
    ("speed", "rate", "radius"), [(2.0, 0.2, 10.11), (2.0, 0.5, 4.07), (3.0, -0.3, 10.13), (1.0, 0.5, 2.01)]
)
def test_circles_are_a_percent_wide_in_any_frame(speed: float, rate: float, radius: float, frame: int) -> None:
    companion = rover()
    companion.fly(10.0, speed, rate, frame=frame, rate=10.0)
    truth = companion.vehicle.truth
    assert truth.ground_speed / abs(truth.turn_rate) == pytest.approx(radius, rel=0.012)
    assert math.copysign(1, truth.turn_rate) == math.copysign(1, rate) and truth.down == 0.0


def test_the_speed_is_clipped_and_reverse_works() -> None:
    companion = rover()
    companion.fly(8.0, 9.0, 0.0)
    assert companion.vehicle.truth.ground_speed == pytest.approx(5.0, abs=0.01)
    companion.fly(8.0, -2.0, 0.0)
    assert companion.vehicle.truth.ground_speed == pytest.approx(2.0, abs=0.01)
    assert abs(companion.vehicle.truth.course) == pytest.approx(math.pi, abs=0.01)


def test_it_does_not_turn_on_the_spot() -> None:
    companion = rover()
    companion.fly(5.0, 0.0, 0.5, mask=0x5FF)
    assert abs(companion.vehicle.truth.heading) < 0.1 and companion.vehicle.truth.ground_speed < 0.01


def test_silence_of_three_seconds_stops_it_and_it_says_so() -> None:
    companion = rover()
    companion.fly(5.0, 3.0, 0.1)
    companion.wait(5.2)
    assert companion.texts() == ["target not received last 3secs, stopping"]
    truth = companion.vehicle.truth
    assert truth.ground_speed == 0.0 and truth.mode == 15 and truth.armed
    companion.fly(3.0, 3.0, 0.1)
    assert companion.vehicle.truth.ground_speed == pytest.approx(3.0, abs=0.05)


def test_an_acceleration_is_not_taken() -> None:
    companion = rover()
    companion.velocity(3.0, 0.1, mask=0x407)
    assert companion.vehicle.setpoint_log == []


@pytest.mark.parametrize("mask", [0x83, 0x80, 0x03, 0x00])
def test_thrust_is_a_share_of_the_speed_and_the_yaw_rate_counts(mask: int) -> None:
    companion = rover()
    companion.repeat(10.0, lambda: companion.attitude(mask, rates=(0.0, 0.0, 0.3), thrust=0.6))
    truth = companion.vehicle.truth
    assert truth.ground_speed == pytest.approx(3.0, abs=0.02) and truth.turn_rate == pytest.approx(0.3, rel=0.02)


def test_without_gps_it_holds_and_guided_is_refused() -> None:
    companion = rover(events=[{"at_s": 5.0, "action": "gps_off"}])
    companion.fly(12.9, 3.0, 0.1)
    assert companion.vehicle.truth.mode == 15
    companion.fly(3.0, 3.0, 0.1)
    assert companion.vehicle.truth.mode == 4 and companion.texts() == ["EKF variance", "EKF failsafe"]
    companion.forget()
    assert companion.command(176, 1, 15) == [4] and companion.texts() == ["Flight mode change failed"]
