"""A copter whose velocity follows its nose by a velocity loop: against the transfer function of that loop, by hand."""

from cmath import phase
from math import cos, degrees, hypot, remainder, sin, tau

import pytest

from circnav_mav.guidance.types import OwnMotion
from circnav_mav.guidance.velocity_loop import FIRST_DRAG, CopterMotion, VelocityLoop

LOOP, V = VelocityLoop(proportional=1.8, integral=0.4), 5.0
STEP = 0.04


def flown(turn_rate, drag, wind=(0.0, 0.0), seconds=150.0, tilts=True):
    """The motion after a steady turn, the tilt of the thrust being what holds it there; and what it was taken for."""
    motion, own = CopterMotion(), None
    s = 1j * turn_rate
    response = (1.8 * s + 0.4) / (s * s + (1.8 + drag) * s + 0.4)
    for i in range(round(seconds / STEP)):
        psi = turn_rate * i * STEP
        velocity = response * V * complex(cos(psi), sin(psi))
        acceleration = s * velocity + drag * (velocity - complex(*wind))
        push = (acceleration.real, acceleration.imag) if tilts else None
        motion, own = motion.follow(OwnMotion(i * STEP, psi, turn_rate, V, push=push), LOOP)
    return motion, own, response


@pytest.mark.parametrize("drag", [0.4, 1.0])
@pytest.mark.parametrize("turn_rate", [0.1, -0.3])
def test_a_turning_copter_is_slower_and_crabs_as_its_velocity_loop_says(drag, turn_rate):
    motion, own, response = flown(turn_rate, drag)
    assert own.airspeed == pytest.approx(abs(response) * V, rel=0.025)  # with a drag that is learnt to some percent
    lag = degrees(remainder(turn_rate * (motion.time) - own.heading, tau))
    assert lag == pytest.approx(-degrees(phase(response)), abs=1.0)
    assert own.turn_rate == pytest.approx(turn_rate, rel=0.02)


def test_px4_in_simulation_droops_by_9_percent_and_crabs_by_11_degrees():
    """PX4 SIH at 5 m/s round 50 m: 4.55 .. 4.59 m/s and 11 deg were measured, its drag is 1/s."""
    motion, own, _ = flown(0.1, 1.0)
    assert motion.drag == pytest.approx(1.0, abs=0.1)
    assert own.airspeed == pytest.approx(4.57, abs=0.05)


def test_wind_is_not_taken_for_drag():
    assert flown(0.15, 0.5, wind=(3.0, -2.0))[0].drag == pytest.approx(0.5, abs=0.08)


def test_without_a_tilt_the_drag_stays_a_bare_quadrotors():
    assert flown(0.1, 1.0, tilts=False)[0].drag == FIRST_DRAG


def test_after_a_gap_the_velocity_begins_along_the_nose():
    motion, _, _ = flown(0.3, 1.0)
    after, own = motion.follow(OwnMotion(motion.time + 3.0, 1.0, 0.3, V), LOOP)
    assert (own.heading, own.airspeed) == pytest.approx((1.0, V))
    assert hypot(after.vx, after.vy) == pytest.approx(V)
    assert after.drag == motion.drag
