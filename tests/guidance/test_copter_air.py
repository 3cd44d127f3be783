"""Air of a copter: against flights of ArduCopter's simulated quadrotor, and against a point mass
with drag."""

from cmath import rect
from math import atan2, degrees, hypot, radians, tan

import pytest

from circnav_mav.guidance.copter_air import (
    CopterAir,
    coefficient_at,
    drag_force,
    speed_of_drag,
)
from circnav_mav.guidance.types import OwnMotion

FLOWN = ((2.68, -0.88), (4.81, -1.89), (6.37, -2.74), (7.68, -3.48))
"""Airspeed, m/s, and forward specific force, m/s^2, of ArduCopter 4.6.3 in SITL at pitch angles of
5 to 20 deg without GPS."""
STEP = 0.05
V = 5.0


@pytest.mark.parametrize(("airspeed", "force"), FLOWN)
def test_drag_model_agrees_with_flown_airspeeds(airspeed: float, force: float) -> None:
    coefficient = coefficient_at(1.89 / 4.81, 4.81)
    assert speed_of_drag(-force, coefficient) == pytest.approx(airspeed, rel=0.04)


@pytest.mark.parametrize("speed", [-12.0, -0.3, 0.0, 4.0, 20.0])
def test_speed_of_drag_inverts_drag_force(speed: float) -> None:
    assert speed_of_drag(drag_force(speed, 0.25), 0.25) == pytest.approx(speed, abs=1e-9)


def through_air(
    air: CopterAir, tick: int, velocity: complex, *, scale: float | None = None
) -> OwnMotion:
    """Return the measured motion at a tick of a copter with a heading of 1 rad and a drag
    coefficient of 0.25/s. velocity: through the air, forward + j left, m/s."""
    force = complex(-drag_force(velocity.real, 0.25), -drag_force(velocity.imag, 0.25))
    own = OwnMotion(tick * STEP, heading=1.0, turn_rate=0.0, airspeed=V)
    return air.through_air(own, force, steering=True, scale=scale)


def test_air_velocity_corrects_heading_by_side_slip() -> None:
    """The copter moves through the air forward and to the right of its nose, so its drag points
    backward and to the left."""
    air = CopterAir(0.25, V)
    for tick in range(200):
        moved = through_air(air, tick, 5 - 0.5j)
    assert degrees(moved.heading - 1.0) == pytest.approx(-degrees(atan2(0.5, 5.0)), abs=0.01)
    assert moved.airspeed == pytest.approx(hypot(5.0, 0.5))


def test_motion_is_unchanged_without_measured_drag() -> None:
    own = OwnMotion(1.05, 0.0, 0.0, V)
    assert CopterAir(0.25, V).through_air(own, None, steering=True, scale=None) == own


def drag_of(air: complex, heading: float, coefficient: float) -> complex:
    """Return the drag at an air velocity (east + j north), forward + j left, m/s^2."""
    body = air * rect(1.0, -heading)
    return complex(drag_force(body.real, coefficient), drag_force(body.imag, coefficient))


def circle(
    seconds: float,
    coefficient: float,
    wind: complex,
    error: complex = 0j,
    *,
    radius: float = 30.0,
    turned_after: float = 1e9,
) -> CopterAir:
    """Return the air after a circle at a ground speed of 5 m/s.

    coefficient: true drag coefficient; that of the mission is 0.25/s.
    error: of the accelerometer, forward + j left, m/s^2.
    turned_after: time after which the wind is opposite, s.
    """
    air = CopterAir(0.25, V)
    rate = V / radius
    for tick in range(round(seconds / STEP)):
        heading = tick * STEP * rate
        blows = wind if tick * STEP < turned_after else -wind
        drag = drag_of(rect(V, heading) - blows, heading, coefficient)
        own = OwnMotion(tick * STEP, heading, rate, V)
        air.over_ground(own, drag + 1j * rate * V, error - drag, steering=True, settled=True)
    return air


@pytest.mark.parametrize("coefficient", [0.15, 0.25, 0.4])
def test_drag_and_wind_converge_in_two_laps(coefficient: float) -> None:
    air = circle(76.0, coefficient, wind=2.0 - 1.0j)
    assert air.coefficient == pytest.approx(coefficient, rel=0.06)
    assert air.wind == pytest.approx(2.0 - 1.0j, abs=0.3)
    assert air.wind_sigma < 0.5
    # At 7.7 m/s the flown airspeed differs from the model by 4 %: two standard deviations.
    assert 0.02 < air.scale_sigma < 0.06


def test_drag_is_separated_from_wind_within_lap_of_2_minutes() -> None:
    air = circle(250.0, 0.4, wind=2.0 - 1.0j, radius=100.0)
    assert air.coefficient == pytest.approx(0.4, rel=0.04)


def test_wind_estimate_follows_opposite_wind_within_three_laps() -> None:
    air = circle(190.0, 0.25, wind=2.0 - 1.0j, turned_after=76.0)
    assert air.wind == pytest.approx(-2.0 + 1.0j, abs=0.5)


def test_accelerometer_error_is_learned_before_loss_of_gps() -> None:
    """Without the learned error, the airspeed would be 0.8 m/s too low."""
    air = circle(76.0, 0.25, wind=2.0 - 1.0j, error=0.4 - 0.3j)
    force = 0.4 - 0.3j - drag_of(5 + 0j, 0.0, 0.25)
    air.lose_ground_speed()
    for tick in range(100):
        own = OwnMotion(76.0 + tick * STEP, 1.0, 0.0, V)
        own = air.through_air(own, force, steering=True, scale=None)
    assert own.airspeed == pytest.approx(V, abs=0.15)
    assert own.heading == pytest.approx(1.0, abs=0.03)


def test_drag_is_not_learned_from_straight_flight() -> None:
    """Without a change of the velocity, drag and wind cannot be separated."""
    air = CopterAir(0.25, V)
    for tick in range(1000):
        own = OwnMotion(tick * STEP, 0.0, 0.0, V)
        air.over_ground(own, 4 + 1j, None, steering=True, settled=True)
    assert air.coefficient == pytest.approx(0.25, rel=0.01)
    assert air.wind_sigma > 3.0


@pytest.mark.parametrize("attitude_error", [-0.5, 0.0, 0.9])
def test_thrust_acceleration_reaches_speed_despite_wrong_attitude(attitude_error: float) -> None:
    """The copter is a point mass with drag. An error of its attitude adds `attitude_error` (m/s^2)
    to the commanded thrust acceleration, forward and to the left."""
    air = CopterAir(0.25, V)
    velocity = 0j
    for tick in range(1200):
        through_air(air, tick, velocity)
        thrust_acceleration = air.thrust_acceleration(V) + complex(attitude_error, attitude_error)
        velocity += (thrust_acceleration - drag_of(velocity, 0.0, 0.25)) * STEP
    assert velocity == pytest.approx(V, abs=0.1)


def test_lean_stays_below_15_deg_when_side_slip_does_not_change() -> None:
    """A lateral error of the accelerometer looks like side-slip for which no lean compensates."""
    air = CopterAir(0.25, V)
    for tick in range(2400):
        through_air(air, tick, 5 + 0.7j)
    assert abs(air.thrust_acceleration(V).imag) < 9.8 * tan(radians(15))


def test_thrust_acceleration_uses_estimated_scale() -> None:
    """The copter has less drag than the mission assumes, so its true airspeed is 1.25 times the
    measured airspeed."""
    air = CopterAir(0.25, V)
    speed = 0.0
    for tick in range(2000):
        through_air(air, tick, complex(speed / 1.25), scale=1.25)
        speed += (air.thrust_acceleration(V).real - drag_force(speed / 1.25, 0.25)) * STEP
    assert speed == pytest.approx(V, abs=0.05)


def test_thrust_acceleration_is_zero_at_speed_0() -> None:
    assert CopterAir(0.25, V).thrust_acceleration(0.0) == 0
