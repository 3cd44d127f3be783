"""The estimated motion of a copter with a velocity loop, against the transfer function of the
loop."""

from cmath import phase
from math import cos, degrees, remainder, sin, tau

import pytest

from circnav_mav.guidance.copter_air import CopterAir, coefficient_at
from circnav_mav.guidance.types import OwnMotion
from circnav_mav.guidance.velocity_loop import AT_REST, VelocityLoop

LOOP = VelocityLoop(proportional=1.8, integral=0.4, derivative=0.2)
V = 5.0
LEAN = 0.25  # lag of the copter's lean behind its command, s
STEP = 0.04


def update(air, own, thrust_acceleration=0j, steering=True):
    """Return the motion over the ground after a report without accelerations."""
    return air.over_ground(own, thrust_acceleration, None, steering=steering, settled=True)


def flown(turn_rate, drag, wind=(0.0, 0.0), seconds=150.0):
    """Return the estimated motion after a steady turn that the tilt of the thrust maintains, and
    the true response.

    With the acceleration 1.2 u' + c u fed forward, the loop turns the setpoint u into the velocity
    v by ((1 + lean s)(s + c) + 0.2 s + 1.8 + 0.4/s) v = (1.8 + 0.4/s + 1.2 s + c) u.
    """
    motion = CopterAir(coefficient_at(0.3, V), V, LOOP)
    own = None
    s = 1j * turn_rate
    response = (1.8 + 0.4 / s + 1.2 * s + drag) / (
        (1 + LEAN * s) * (s + drag) + 0.2 * s + 1.8 + 0.4 / s
    )
    for i in range(round(seconds / STEP)):
        psi = turn_rate * i * STEP
        velocity = response * V * complex(cos(psi), sin(psi))
        acceleration = s * velocity + drag * (velocity - complex(*wind))
        thrust_acceleration = acceleration * complex(cos(psi), -sin(psi))
        own = update(motion, OwnMotion(i * STEP, psi, turn_rate, V), thrust_acceleration)
    return motion, own, response


@pytest.mark.parametrize("drag", [0.4, 1.0])
@pytest.mark.parametrize("turn_rate", [0.1, -0.3, 0.5])
def test_copter_motion_matches_velocity_loop_response_in_steady_turn(drag, turn_rate):
    _, own, response = flown(turn_rate, drag)
    # the learned drag has an error of some percent
    assert own.airspeed == pytest.approx(abs(response) * V, rel=0.025)
    lag = degrees(remainder(turn_rate * own.time - own.heading, tau))
    assert lag == pytest.approx(-degrees(phase(response)), abs=1.0)
    assert own.turn_rate == pytest.approx(turn_rate, rel=0.02)


def test_copter_motion_compensates_px4_drag():
    """PX4 in SIH has a drag of 1/s. At 0.1 rad/s it flew 4.92 m/s with a crab angle near 0. Without
    acceleration setpoints it flew 4.57 m/s with a crab angle of 11 deg."""
    motion, own, _ = flown(0.1, 1.0)
    assert motion.drag.real == pytest.approx(1.0, abs=0.05)
    assert own.airspeed == pytest.approx(5.0, abs=0.1)
    assert LOOP.fed(5.0, 0.1, 0.9) == pytest.approx((4.5, 0.6))


def test_copter_motion_separates_drag_from_wind():
    air, _, _ = flown(0.15, 0.5, wind=(3.0, -2.0))
    assert air.drag.real == pytest.approx(0.5, abs=0.08)
    assert air.wind == pytest.approx(3 - 2j, abs=0.5)


def test_copter_motion_starts_from_low_speed_after_handover():
    """In straight flight without drag and feedforward, the loop 1.8 + 0.4/s takes at least 1/1.8 ln
    5 = 0.9 s to reach 0.8 V. Below 0.3 V the estimated course is not used, and the report stays
    unchanged."""
    motion = AT_REST
    speeds = []
    for i in range(100):
        own, motion = LOOP.update(motion, OwnMotion(i * STEP, 0.5, 0.0, V), 0.0, STEP)
        speeds.append(own.airspeed)
    slow = speeds.index(min(speeds))
    assert speeds[:slow] == [V] * slow
    assert speeds[slow] == pytest.approx(0.3 * V, abs=0.1 * V)
    reached = STEP * next(i + 1 for i in range(slow, 100) if speeds[i] > 0.8 * V)
    assert 0.9 < reached < 1.8


def test_copter_motion_restarts_at_rest_after_handover():
    air, own, _ = flown(0.3, 1.0)
    update(air, own._replace(time=own.time + STEP), steering=False)
    later = OwnMotion(own.time + 2 * STEP, 0.5, 0.0, V)
    assert update(air, later) == later


def test_copter_motion_restarts_along_nose_after_gap():
    motion, before, _ = flown(0.3, 1.0)
    drag = motion.drag
    own = update(motion, OwnMotion(before.time + 3.0, 1.0, 0.3, V))
    assert (own.heading, own.airspeed) == pytest.approx((1.0, V))
    assert motion.drag == drag
