"""The ideal airframe, compared with closed-form solutions and with other step sizes."""

import math

import pytest
from circnav_sim.airframes.copter import copter_airframe
from circnav_sim.airframes.unicycle import Unicycle
from circnav_sim.body import Body
from circnav_sim.config import Airframe
from circnav_sim.demands import BodyVelocity, Brake
from hypothesis import given
from hypothesis import strategies as st

IDEAL = Unicycle(max_turn_rate=1.0, turn_lag=0.0, speed_lag=0.0)
LAGGED = Unicycle(max_turn_rate=1.0, turn_lag=0.4, speed_lag=0.8)
NORTHBOUND = Body(0.0, 0.0, -50.0, 0.0)


@given(
    speed=st.floats(1.0, 40.0),
    rate=st.floats(-1.0, 1.0),
    heading=st.floats(-3.0, 3.0),
    dt=st.floats(0.001, 30.0),
)
def test_steady_turn_of_unicycle_is_exact_arc(speed, rate, heading, dt):
    start = Body(0.0, 0.0, -50.0, heading)
    end = IDEAL.step(start, BodyVelocity(speed, yaw_rate=rate), dt)
    if abs(rate) > 1e-3:
        radius = speed / rate
        north = radius * (math.sin(heading + rate * dt) - math.sin(heading))
        east = radius * (math.cos(heading) - math.cos(heading + rate * dt))
        assert (end.north, end.east) == pytest.approx((north, east), rel=1e-9, abs=1e-6)
    assert math.remainder(end.heading - heading - rate * dt, math.tau) == pytest.approx(
        0.0, abs=1e-9
    )
    assert end.ground_speed == pytest.approx(speed)


@given(st.lists(st.floats(0.001, 0.7), min_size=1, max_size=12), st.floats(-1.0, 1.0))
def test_path_of_unicycle_is_independent_of_step_size(steps, rate):
    demand = BodyVelocity(15.0, right=1.0, yaw_rate=rate)
    body = Body(0.0, 0.0, -50.0, 0.3, turn_rate=-0.4, velocity_north=5.0)
    stepped = body
    for dt in steps:
        stepped = LAGGED.step(stepped, demand, dt)
    whole = LAGGED.step(body, demand, sum(steps))
    assert (stepped.north, stepped.east, stepped.heading) == pytest.approx(
        (whole.north, whole.east, whole.heading), abs=1e-6
    )


def test_unicycle_motion_matches_closed_form_of_lag_and_braking():
    after = LAGGED.step(NORTHBOUND, BodyVelocity(10.0, yaw_rate=0.5), 0.4)
    assert after.turn_rate == pytest.approx(0.5 * (1 - math.exp(-1)))
    assert after.heading == pytest.approx(0.5 * 0.4 - 0.5 * 0.4 * (1 - math.exp(-1)))
    for sense in (1, -1):
        assert (
            IDEAL.step(NORTHBOUND, BodyVelocity(10.0, yaw_rate=sense * 100.0), 0.1).turn_rate
            == sense
        )
    moving = Body(0.0, 0.0, -50.0, 1.0, velocity_north=3.0, velocity_east=4.0)
    stopped = IDEAL.step(moving, Brake(2.0), 60.0)
    assert stopped.ground_speed == 0.0
    # braking distance v^2/(2 a)
    assert math.hypot(stopped.north, stopped.east) == pytest.approx(25 / 4)


def test_wind_carries_airborne_copter():
    airborne, ideal = (
        copter_airframe(Airframe(dynamics=name, turn_lag_s=0.4))
        for name in ("airborne", "unicycle")
    )
    demand = BodyVelocity(15.0, yaw_rate=0.2)
    wind = (3.0, -2.0)
    carried = NORTHBOUND
    still = NORTHBOUND
    for _ in range(40):
        carried = airborne.step(carried, demand, 0.25, wind)
        still = ideal.step(still, demand, 0.25, wind)
    assert (carried.north, carried.east) == pytest.approx((still.north + 30.0, still.east - 20.0))
    assert carried.heading == pytest.approx(still.heading)
    assert carried.airspeed(wind) == pytest.approx(15.0)
    assert airborne.step(NORTHBOUND, Brake(), 5.0, wind).ground_speed == 0.0, (
        "the vehicle brakes to zero ground speed"
    )
