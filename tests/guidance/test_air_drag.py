"""Airspeed and side-slip from the accelerometer: against flights of ArduCopter's simulated
quadrotor, and against a point mass with drag."""

from cmath import rect
from math import atan2, degrees, hypot, inf

import pytest

from circnav_mav.guidance.air_drag import (
    AirspeedHold,
    AirVelocity,
    MeanWind,
    ScaleFit,
    coefficient_at,
    drag_force,
    speed_of_drag,
)
from circnav_mav.guidance.types import IntegratedAcceleration, OwnMotion

FLOWN = ((2.68, -0.88), (4.81, -1.89), (6.37, -2.74), (7.68, -3.48))
"""Airspeed, m/s, and forward specific force, m/s^2, of ArduCopter 4.6.3 in SITL at pitch angles of
5 to 20 deg without GPS."""
STEP = 0.05


@pytest.mark.parametrize(("airspeed", "force"), FLOWN)
def test_drag_model_agrees_with_flown_airspeeds(airspeed: float, force: float) -> None:
    coefficient = coefficient_at(1.89 / 4.81, 4.81)
    assert speed_of_drag(-force, coefficient) == pytest.approx(airspeed, rel=0.04)


@pytest.mark.parametrize("speed", [-12.0, -0.3, 0.0, 4.0, 20.0])
def test_speed_of_drag_inverts_drag_force(speed: float) -> None:
    assert speed_of_drag(drag_force(speed, 0.25), 0.25) == pytest.approx(speed, abs=1e-9)


def test_air_velocity_corrects_heading_by_side_slip() -> None:
    """The copter moves through the air forward and to the right of its nose, so its drag points
    backward and to the left."""
    drag = -drag_force(5.0, 0.25), drag_force(0.5, 0.25)
    air = AirVelocity()
    for tick in range(200):
        own = OwnMotion(tick * STEP, heading=1.0, turn_rate=0.0, airspeed=9.0, drag=drag)
        air = air.follow(own, 0.25)
    moved = air.motion(own)
    assert degrees(moved.heading - 1.0) == pytest.approx(-degrees(atan2(0.5, 5.0)), abs=0.01)
    assert moved.airspeed == pytest.approx(hypot(5.0, 0.5))


def test_air_velocity_keeps_state_without_measurement() -> None:
    air = AirVelocity(1.0, 5.0, 0.5)
    assert air.follow(OwnMotion(1.05, 0.0, 0.0, 5.0), 0.25) == air


def circle(seconds: float, true_scale: float, wind: complex) -> tuple[ScaleFit, MeanWind]:
    """Fly a circle of 30 m at a ground speed of 5 m/s. The true airspeed is `true_scale` times the
    airspeed that the drag of the mission gives."""
    fit = ScaleFit()
    mean = MeanWind()
    air = AirVelocity()
    speed = 5.0
    rate = 5.0 / 30.0
    for tick in range(round(seconds / STEP)):
        time = tick * STEP
        heading = tick * STEP * rate
        ground = rect(speed, heading)
        body = (ground - wind) * rect(1.0, -heading) / true_scale
        drag = -drag_force(body.real, 0.25), -drag_force(body.imag, 0.25)
        acceleration = IntegratedAcceleration(ground.real, ground.imag, 0.0)
        own = OwnMotion(time, heading, rate, speed, drag=drag, acceleration=acceleration)
        air = air.follow(own, 0.25)
        fit.follow(own, air)
        mean = mean.follow(own, air, fit.scale)
    return fit, mean


@pytest.mark.parametrize("true_scale", [0.7, 1.0, 1.5])
def test_airspeed_scale_and_mean_wind_converge_in_two_laps(true_scale: float) -> None:
    fit, mean = circle(76.0, true_scale, wind=2.0 - 1.0j)
    assert fit.scale == pytest.approx(true_scale, rel=0.06)
    assert complex(mean.x, mean.y) == pytest.approx(2.0 - 1.0j, abs=0.5)
    assert mean.sigma < 0.5
    assert fit.sigma < 0.06


def test_airspeed_scale_is_not_learned_from_steady_wind() -> None:
    """A copter that hovers in wind measures a constant airspeed. Without a change of airspeed, drag
    and wind cannot be separated."""
    fit = ScaleFit()
    for tick in range(1000):
        own = OwnMotion(
            tick * STEP, 0.0, 0.0, 0.0, acceleration=IntegratedAcceleration(0.0, 0.0, 0.0)
        )
        fit.follow(own, AirVelocity(tick * STEP, 4.0, 1.0))
    assert fit.scale == pytest.approx(1.0)


@pytest.mark.parametrize("attitude_error", [-0.5, 0.0, 0.7])
def test_airspeed_hold_reaches_speed_despite_wrong_attitude(
    attitude_error: float,
) -> None:
    """The copter is a point mass with drag. An error of its attitude adds `attitude_error` (m/s^2)
    to the commanded push, forward and to the left."""
    hold = AirspeedHold(0.25)
    air = AirVelocity()
    forward = left = 0.0
    for tick in range(1200):
        own = OwnMotion(
            tick * STEP, 0.0, 0.0, 0.0, drag=(-drag_force(forward, 0.25), -drag_force(left, 0.25))
        )
        air = air.follow(own, 0.25)
        hold.follow(air, 5.0, None)
        push = hold.push(5.0)
        forward += (push[0] + attitude_error - drag_force(forward, 0.25)) * STEP
        left += (push[1] + attitude_error - drag_force(left, 0.25)) * STEP
    assert forward == pytest.approx(5.0, abs=0.1)
    assert left == pytest.approx(0.0, abs=0.1)


def test_airspeed_hold_uses_estimated_scale() -> None:
    """The copter has less drag than the mission assumes, so its true airspeed is 1.25 times the
    measured airspeed."""
    hold = AirspeedHold(0.25)
    speed = 0.0
    for tick in range(2000):
        hold.follow(AirVelocity(tick * STEP, speed / 1.25, 0.0), 5.0, 1.25)
        speed += (hold.push(5.0)[0] - drag_force(speed / 1.25, 0.25)) * STEP
    assert speed == pytest.approx(5.0, abs=0.05)


def test_airspeed_hold_does_not_push_at_speed_0() -> None:
    assert AirspeedHold(0.25).push(0.0) == (0.0, 0.0)


def test_mean_wind_is_unknown_before_first_report() -> None:
    assert MeanWind().sigma > 3.0
    assert MeanWind().time == -inf
