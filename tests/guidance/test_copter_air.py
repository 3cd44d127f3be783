"""Air of a copter: against flights of ArduCopter's simulated quadrotor, and against a point mass
with drag."""

from cmath import rect
from collections.abc import Callable
from math import atan2, cos, degrees, hypot, radians, sqrt, tan
from random import Random

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


def test_side_slip_near_standstill_turns_path_by_45_deg_at_most() -> None:
    air = CopterAir(0.25, V)
    for tick in range(200):
        moved = through_air(air, tick, 0.1 + 2j)
    assert degrees(moved.heading - 1.0) == pytest.approx(45.0)


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
    error: Callable[[float], complex] = lambda time: 0j,
    *,
    radius: float = 30.0,
    turned_after: float = 1e9,
    gusts: int | None = None,
) -> CopterAir:
    """Return the air after a circle at a ground speed of 5 m/s.

    coefficient: true drag coefficient; that of the mission is 0.25/s.
    error: of the accelerometer at a time (s), forward + j left, m/s^2.
    turned_after: time after which the wind is opposite, s.
    gusts: seed of gusts of 1 m/s with a correlation time of 5 s. None: no gusts.
    """
    air = CopterAir(0.25, V)
    rate = V / radius
    random = Random(gusts)
    gust = 0j
    for tick in range(round(seconds / STEP)):
        time = tick * STEP
        heading = time * rate
        if gusts is not None:
            new = complex(random.gauss(0, 1), random.gauss(0, 1))
            gust += new * sqrt(2 * STEP / 5.0) - gust * STEP / 5.0
        blows = (wind if time < turned_after else -wind) + gust
        drag = drag_of(rect(V, heading) - blows, heading, coefficient)
        own = OwnMotion(time, heading, rate, V)
        thrust = drag + 1j * rate * V
        air.over_ground(own, thrust, error(time) - drag, steering=True, settled=True)
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


def test_drag_is_mostly_learned_in_8_seconds() -> None:
    """The mission's drag coefficient is 0.25/s, the true one 0.4/s."""
    assert circle(8.0, 0.4, wind=0j).coefficient > 0.35


def test_first_seconds_in_gusts_hardly_change_drag() -> None:
    errors = [circle(6.0, 0.25, 2.0 - 1.0j, gusts=seed).coefficient - 0.25 for seed in range(30)]
    assert sqrt(sum(error**2 for error in errors) / 30) < 0.032


def test_learned_drag_varies_by_9_percent_in_gusts() -> None:
    learned = [circle(120.0, 0.25, 2.0 - 1.0j, gusts=seed).coefficient for seed in range(10)]
    assert sqrt(sum((one / 0.25 - 1) ** 2 for one in learned) / 10) < 0.09


def test_wind_estimate_follows_opposite_wind_within_three_laps() -> None:
    air = circle(190.0, 0.25, wind=2.0 - 1.0j, turned_after=76.0)
    assert air.wind == pytest.approx(-2.0 + 1.0j, abs=0.5)


def test_accelerometer_error_is_learned_before_loss_of_gps() -> None:
    """Without the learned error, the airspeed would be 0.8 m/s too low."""
    air = circle(76.0, 0.25, wind=2.0 - 1.0j, error=lambda time: 0.4 - 0.3j)
    force = 0.4 - 0.3j - drag_of(5 + 0j, 0.0, 0.25)
    air.lose_ground_speed()
    for tick in range(100):
        own = OwnMotion(76.0 + tick * STEP, 1.0, 0.0, V)
        own = air.through_air(own, force, steering=True, scale=None)
    assert own.airspeed == pytest.approx(V, abs=0.15)
    assert own.heading == pytest.approx(1.0, abs=0.03)


def test_learned_accelerometer_error_follows_change_within_30_seconds() -> None:
    air = circle(90.0, 0.25, wind=2.0 - 1.0j, error=lambda time: 0.3 if time < 60 else -0.3)
    assert air.error.real < -0.12


def test_accelerometer_error_once_a_lap_is_hardly_learned() -> None:
    """Such an error comes from a tilted attitude estimate."""
    air = circle(76.0, 0.25, wind=2.0 - 1.0j, error=lambda time: 0.3 * cos(V / 30 * time))
    assert abs(air.error) < 0.1


def test_first_second_shows_half_of_accelerometer_error() -> None:
    air = circle(1.0, 0.25, wind=0j, error=lambda time: 0.4)
    assert air.error.real < 0.22


def test_drag_is_not_learned_from_straight_flight() -> None:
    """Without a change of the velocity, drag and wind cannot be separated."""
    air = CopterAir(0.25, V)
    for tick in range(1000):
        own = OwnMotion(tick * STEP, 0.0, 0.0, V)
        air.over_ground(own, 4 + 1j, None, steering=True, settled=True)
    assert air.coefficient == pytest.approx(0.25, rel=0.01)
    assert 3.0 < air.wind_sigma < 5.0


def velocities(seconds: float, start: complex = 0j, attitude_error: complex = 0j) -> list[complex]:
    """Return the velocities through the air, forward + j left, m/s, of a point mass with drag.

    start: velocity at the start, m/s.
    attitude_error: its effect on the thrust acceleration, m/s^2.
    """
    air = CopterAir(0.25, V)
    flown = [start]
    for tick in range(round(seconds / STEP)):
        through_air(air, tick, flown[-1])
        thrust_acceleration = air.thrust_acceleration(V) + attitude_error
        flown.append(flown[-1] + (thrust_acceleration - drag_of(flown[-1], 0.0, 0.25)) * STEP)
    return flown


@pytest.mark.parametrize("attitude_error", [-0.5, 0.0, 0.9])
def test_thrust_acceleration_reaches_speed_despite_wrong_attitude(attitude_error: float) -> None:
    flown = velocities(60.0, attitude_error=complex(attitude_error, attitude_error))
    assert flown[-1] == pytest.approx(V, abs=0.1)


def test_side_slip_by_wrong_attitude_ends_within_9_seconds() -> None:
    flown = velocities(30.0, V + 0j, 0.5 + 0.5j)
    assert all(abs(velocity.imag) < 0.1 for velocity in flown[round(8.4 / STEP) :])


def test_copter_overshoots_airspeed_by_8_percent_after_start() -> None:
    assert max(velocity.real for velocity in velocities(30.0)) < 1.08 * V


def test_copter_swings_back_little_after_side_gust() -> None:
    flown = velocities(30.0, V + 6j)
    assert min(velocity.imag for velocity in flown) > -1.7
    assert all(abs(velocity.imag) < 0.1 for velocity in flown[round(11.5 / STEP) :])


def test_airspeed_passes_little_vibration_and_follows_within_2_seconds() -> None:
    """Vibration with a standard deviation of 1 m/s^2 is 1.8 m/s of airspeed."""
    air = CopterAir(0.25, V)
    random = Random(1)
    measured = []
    for tick in range(2000):
        force = complex(random.gauss(0, 1) - drag_force(V, 0.25))
        own = OwnMotion(tick * STEP, 0.0, 0.0, V)
        measured.append(air.through_air(own, force, steering=False, scale=None).airspeed)
    assert sqrt(sum((one - V) ** 2 for one in measured) / 2000) < 0.6
    for tick in range(2000, 2040):
        slow = through_air(air, tick, 3 + 0j)
    assert slow.airspeed == pytest.approx(3.0, abs=0.1)


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


def test_held_airspeed_follows_estimated_scale_slowly() -> None:
    """A wrong scale for 3 s changes the airspeed by less than 8 %."""
    air = CopterAir(0.25, V)
    held = []
    for tick in range(600):
        through_air(air, tick, V, scale=1.25)
        held.append(air.scale)
    assert held[60] < 1.08
    assert held[-1] > 1.23


def test_lean_is_judged_after_half_a_circle() -> None:
    """A copter keeps its lean, although its commands require a fifth more speed. Until its velocity
    has turned, the cause may be the wind."""
    for turned, judged in ((150.0, False), (270.0, True)):
        air = CopterAir(0.25, V)
        rate = V / 30
        ticks = round(radians(turned) / rate / STEP)
        for tick in range(ticks + 40):
            heading = tick * STEP * rate
            own = OwnMotion(tick * STEP, heading, rate, V if tick < ticks else 1.2 * V)
            drag = complex(drag_force(V, 0.25))
            air.over_ground(own, drag + 1j * rate * V, None, steering=True, settled=True)
        assert air.lean.short is judged


def test_thrust_acceleration_is_zero_at_speed_0() -> None:
    assert CopterAir(0.25, V).thrust_acceleration(0.0) == 0
