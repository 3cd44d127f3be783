"""Rover 4.6.3 as flown: it obeys a speed and a turn rate in any frame."""

import math

import pytest

from tests.sim.station import aboard


def rover(**tables):
    return aboard("ardurover", "GUIDED", **tables)


@pytest.mark.parametrize(
    ("speed", "rate", "radius", "frame"),
    [(2.0, 0.2, 10.11, 1), (3.0, -0.3, 10.13, 8), (1.0, 0.5, 2.01, 9)],
)
def test_circles_are_a_percent_wide_in_any_frame(speed, rate, radius, frame):
    companion = rover()
    companion.fly(10.0, speed, rate, frame=frame, rate=10.0)
    truth = companion.truth
    assert truth.ground_speed / truth.turn_rate == pytest.approx(
        math.copysign(radius, rate), rel=0.012
    )
    assert truth.down == 0.0


def test_the_speed_is_clipped_reverse_works_and_it_neither_turns_on_the_spot_nor_takes_an_acceleration():
    companion = rover()
    companion.velocity(3.0, 0.1, mask=0x407)
    assert companion.vehicle.setpoint_log == []
    companion.fly(5.0, 0.0, 0.5, mask=0x5FF)
    assert abs(companion.truth.heading) < 0.1 and companion.truth.ground_speed < 0.01
    companion = rover()
    companion.fly(8.0, 9.0, 0.0)
    assert companion.truth.ground_speed == pytest.approx(5.0, abs=0.01)
    companion.fly(8.0, -2.0, 0.0)
    assert companion.truth.ground_speed == pytest.approx(2.0, abs=0.01)
    assert abs(companion.truth.course) == pytest.approx(math.pi, abs=0.01)


def test_silence_of_three_seconds_stops_it_and_it_says_so():
    companion = rover()
    companion.fly(5.0, 3.0, 0.1)
    companion.wait(5.2)
    assert companion.texts() == ["target not received last 3secs, stopping"]
    truth = companion.truth
    assert truth.ground_speed == 0.0 and truth.mode == 15 and truth.armed
    companion.fly(3.0, 3.0, 0.1)
    assert companion.truth.ground_speed == pytest.approx(3.0, abs=0.05)


@pytest.mark.parametrize("mask", [0x83, 0x80, 0x03, 0x00])
def test_thrust_is_a_share_of_the_speed_and_the_yaw_rate_counts(mask):
    companion = rover()
    companion.repeat(10.0, lambda: companion.attitude(mask, rates=(0.0, 0.0, 0.3), thrust=0.6))
    truth = companion.truth
    assert truth.ground_speed == pytest.approx(3.0, abs=0.02) and truth.turn_rate == pytest.approx(
        0.3, rel=0.02
    )


def test_without_gps_it_holds_and_guided_is_refused():
    companion = rover(events=[{"at_s": 5.0, "action": "gps_off"}])
    companion.fly(12.9, 3.0, 0.1)
    assert companion.truth.mode == 15
    companion.fly(3.0, 3.0, 0.1)
    assert companion.truth.mode == 4 and companion.texts() == ["EKF variance", "EKF failsafe"]
    companion.forget()
    assert companion.set_mode(15) == [4] and companion.texts() == ["Flight mode change failed"]
