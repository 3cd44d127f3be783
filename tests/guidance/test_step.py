"""From an estimate to a limited turn: direction, correction, saturation."""

from math import inf, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance.law_selector import Flies
from circnav_mav.guidance.laws import pi as pi_law
from circnav_mav.guidance.step import LawChoice, compensate_turn_gain, limit, steering
from circnav_mav.guidance.types import Direction, Orbit, RangeEstimate, RelativeMotion, TurnRate

PAPER = Orbit(radius=10.0, direction=Direction.CLOCKWISE, speed=1.0, max_turn_rate=10.0)


def estimate(r, r_dot=0.0):
    return RangeEstimate(time=0.0, r=r, r_dot=r_dot, r_sigma=0.1, r_dot_sigma=0.1)


def orbit(direction, max_turn_rate=10.0):
    return Orbit(10.0, direction, 1.0, max_turn_rate)


@pytest.mark.parametrize(("law", "gain"), [("smooth", 0.01), ("switching", 0.12)])
def test_on_the_circle_each_direction_turns_its_own_way(law, gain):
    """Counter-clockwise is positive in the paper's frame; 10.9 m and r' = 0 is just outside the circle."""
    choice = LawChoice(law, gain)
    assert steering(orbit(Direction.CLOCKWISE), choice)(estimate(10.9), 0.0).demanded < 0
    assert steering(orbit(Direction.COUNTERCLOCKWISE), choice)(estimate(10.9), 0.0).demanded > 0


def test_the_corrected_law_turns_at_v_over_r_on_the_radius_asked_for():
    """Example 2: fed 8.66025404 the law settles on 10, so at r = 10, r' = 0 it asks for V/10."""
    steer = steering(PAPER, LawChoice("smooth", 0.01, correct_radius=True))
    assert steer(estimate(10.0), 0.0).demanded == pytest.approx(-0.1, rel=1e-9)
    assert steer(estimate(8.6602), 0.0).demanded == 0.0
    assert steer(estimate(8.6603), 0.0).demanded < 0.0


def test_the_law_as_it_stands_settles_outside():
    """Example 1: without the correction nothing turns below 10, and V/10.98684113 is asked for at 10.98684113."""
    steer = steering(PAPER, LawChoice("smooth", 0.01, correct_radius=False))
    assert steer(estimate(9.99), 0.0).demanded == 0.0
    assert steer(estimate(10.98684113), 0.0).demanded == pytest.approx(-1 / 10.98684113, rel=1e-8)


def test_a_gain_without_a_correction_is_refused_at_once():
    with pytest.raises(ValueError, match="must be above"):
        steering(PAPER, LawChoice("smooth", 0.005, correct_radius=True))


@given(gain=st.floats(0.5, 1.5), demanded=st.floats(-10, 10), bound=st.floats(1e-3, 10))
def test_a_vehicle_that_turns_less_than_it_is_told_is_told_more(gain, demanded, bound):
    """Told w/gain, it turns at w; the limit is that of what it is told."""
    command = compensate_turn_gain(limit(TurnRate(demanded), 20.0), bound, gain)
    assert abs(command.turn_rate) <= bound
    assert command.demanded == demanded
    if not command.saturated:
        assert command.turn_rate * gain == pytest.approx(demanded)


@given(demanded=st.floats(-1e6, 1e6), bound=st.floats(1e-3, 10))
def test_the_limit_cuts_what_is_beyond_it_and_says_so(demanded, bound):
    command = limit(TurnRate(demanded), bound)
    assert abs(command.turn_rate) <= bound
    assert command.demanded == demanded
    assert command.saturated == (abs(demanded) > bound)
    if not command.saturated:
        assert command.turn_rate == demanded
    else:
        assert command.turn_rate * demanded > 0


@pytest.mark.parametrize("bound", [0.3, 1.0])
def test_an_infinite_demand_is_cut_to_the_limit(bound):
    assert limit(TurnRate(-inf), bound).turn_rate == -bound
    assert limit(TurnRate(inf), bound).turn_rate == bound


def test_the_vehicles_limit_is_applied_after_the_law():
    """Law 1 is unsaturated: 200 m out, flying across, it asks for 40 times the limit."""
    steer = steering(orbit(Direction.CLOCKWISE, max_turn_rate=0.1), LawChoice("smooth", 0.01))
    command = steer(estimate(200.0), 0.0)
    assert command.turn_rate == -0.1
    assert command.saturated
    assert command.demanded == pytest.approx(-4.0, rel=0.01)


@pytest.mark.parametrize(("direction", "sign"), [(Direction.CLOCKWISE, -1), (Direction.COUNTERCLOCKWISE, 1)])
def test_the_steady_turn_rate_is_v_over_r_in_the_missions_sense(direction, sign):
    assert Orbit(100.0, direction, 15.0, 0.35).steady_turn_rate == pytest.approx(sign * 0.15)


@pytest.mark.parametrize("flies", Flies)
def test_who_flies_is_told_in_a_line_that_a_ground_station_shows_whole(flies):
    assert len(f"circnav: {flies.why}") <= 50


def test_a_command_just_below_the_limit_counts_as_cut_by_it():
    """Handing over, the offset between two laws fades and is never quite nothing."""
    orbit = Orbit(100.0, Direction.CLOCKWISE, 15.0, 0.35)
    steer = steering(orbit, LawChoice("auto", 0.06))
    far = [steer(RangeEstimate(0.05 * i, 100.0, 0.0, 0.5, 0.1)) for i in range(5)]
    assert not any(command.saturated for command in far)
    close = RelativeMotion(
        x=20.0,
        y=0.0,
        sigma=1.0,
        drift_x=0.0,
        drift_y=0.0,
        heading=pi,
        turn_rate=0.0,
        airspeed=15.0,
        scale=1.0,
        trusted=True,
    )
    commands = [steer(RangeEstimate(0.25 + 0.05 * i, 20.0, -15.0, 0.5, 0.1, relative=close)) for i in range(60)]
    assert abs(commands[-1].demanded) > 0.35
    assert abs(commands[-1].turn_rate) >= 0.99 * 0.35
    assert commands[-1].saturated


@pytest.mark.parametrize(("direction", "sign"), [(Direction.CLOCKWISE, 1), (Direction.COUNTERCLOCKWISE, -1)])
def test_the_law_with_a_memory_integrates_over_the_time_between_estimates_and_no_gap(direction, sign):
    """The first has none before it, a gap counts half a second, and an estimate of before nothing. k < 0 flies
    counter-clockwise."""
    orbit, gain = Orbit(100.0, direction, 15.0, 0.35), 0.06
    steer, memory = steering(orbit, LawChoice("pi", gain)), 0.0
    for time, dt, r, trim in (
        (5.0, 0.0, 140.0, 0.0),
        (5.1, 0.1, 138.0, 0.0),
        (65.0, 0.5, 120.0, 3.0),
        (64.0, 0.0, 121.0, 0.0),
    ):
        turn, memory = pi_law(r, -1.0, memory, dt, V=15.0, r_d=100.0 + trim, k=sign * gain)
        command = steer(RangeEstimate(time, r, -1.0, 0.1, 0.1), trim)
        assert command.demanded == pytest.approx(float(turn))
        assert abs(command.turn_rate) <= 0.35
    assert memory > 0


def test_a_gap_between_estimates_is_no_patience_with_a_search():
    guess = RelativeMotion(300.0, 0.0, 300.0, 0.0, 0.0, pi, 0.0, 15.0, 1.0, trusted=False, trial=3)
    steer = steering(Orbit(100.0, Direction.CLOCKWISE, 15.0, 0.35), LawChoice("auto", 0.02))
    flown = [
        steer(RangeEstimate(time, 300.0, -15.0, 0.5, 0.1, relative=guess)).flies for time in (0.0, 60.0, 60.4, 60.6)
    ]
    assert flown == ["feedforward", "feedforward", "feedforward", "trial"]
