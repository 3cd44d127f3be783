"""The emulated rover, with figures from flights of Rover 4.6.3. It obeys a speed and a turn rate in
any frame."""

import math

import pytest

from tests.sim.station import aboard


def rover(**tables):
    return aboard("ardurover", "GUIDED", **tables)


@pytest.mark.parametrize(
    ("speed", "rate", "radius", "frame"),
    [(2.0, 0.2, 10.11, 1), (3.0, -0.3, 10.13, 8), (1.0, 0.5, 2.01, 9)],
)
def test_rover_circle_is_slightly_larger_than_commanded(speed, rate, radius, frame):
    companion = rover()
    companion.fly(10.0, speed, rate, frame=frame, rate=10.0)
    truth = companion.truth
    assert truth.ground_speed / truth.turn_rate == pytest.approx(
        math.copysign(radius, rate), rel=0.012
    )
    assert truth.down == 0.0


def test_rover_limits_speed_forward_and_in_reverse():
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


def test_rover_stops_after_setpoint_timeout():
    companion = rover()
    companion.fly(5.0, 3.0, 0.1)
    companion.wait(5.2)
    assert companion.texts() == ["target not received last 3secs, stopping"]
    truth = companion.truth
    assert truth.ground_speed == 0.0 and truth.mode == 15 and truth.armed
    companion.fly(3.0, 3.0, 0.1)
    assert companion.truth.ground_speed == pytest.approx(3.0, abs=0.05)


def test_rover_without_gps_refuses_guided_in_hold():
    companion = rover(events=[{"at_s": 5.0, "action": "gps_off"}])
    companion.fly(12.9, 3.0, 0.1)
    assert companion.truth.mode == 15
    companion.fly(3.0, 3.0, 0.1)
    assert companion.truth.mode == 4 and companion.texts() == ["EKF variance", "EKF failsafe"]
    companion.forget()
    assert companion.set_mode(15) == [4] and companion.texts() == ["Flight mode change failed"]
