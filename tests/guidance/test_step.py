"""From an estimate to a limited turn: direction, correction, saturation, and the circle's turn rate
without ranges."""

from math import inf, nan, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance.maths import chord
from circnav_mav.guidance.step import (
    LOST,
    LawChoice,
    Steering,
    coasting,
    compensate_turn_gain,
    limited,
)
from circnav_mav.guidance.turn_response import Pending
from circnav_mav.guidance.types import Direction, Orbit, RangeEstimate
from circnav_mav.guidance.vector_field import drift, drift_gains
from tests.guidance.relative import known, untrusted

PAPER = Orbit(radius=10.0, direction=Direction.CLOCKWISE, speed=1.0, max_turn_rate=10.0)
V = 15.0
R_D = 100.0
LIMIT = 0.35
ORBIT = Orbit(R_D, Direction.CLOCKWISE, V, LIMIT)
AT_REST = Pending(0.0, 0.0)


def estimate(r, r_dot=0.0, time=0.0, relative=None):
    return RangeEstimate(time, r, r_dot, 0.1, 0.1, relative=relative)


@pytest.mark.parametrize(
    ("choice", "r", "demanded"),
    [
        # example 2: commanded radius 8.66025404, settled radius 10
        (LawChoice("smooth", 0.01), 10.0, -0.1),
        (LawChoice("smooth", 0.01), 8.6602, 0.0),
        (LawChoice("switching", 0.12), 10.9, -0.12),  # example 3
    ],
)
def test_steering_turns_at_v_over_r_on_settled_radius(choice, r, demanded):
    """In the paper's frame, counter-clockwise is positive."""
    other = Orbit(PAPER.radius, Direction.COUNTERCLOCKWISE, PAPER.speed, PAPER.max_turn_rate)
    assert Steering(PAPER, choice)(estimate(r)).demanded == pytest.approx(demanded, rel=1e-8)
    assert Steering(other, choice)(estimate(r)).demanded == pytest.approx(-demanded, rel=1e-8)


@pytest.mark.parametrize(
    ("lowered", "same"),
    [
        (LawChoice("feedforward", 0.02), LawChoice("feedforward", 0.01)),
        # law 1 keeps 1.2 times its bound of 1/(2 r_d^2)
        (LawChoice("smooth", 1e-4), LawChoice("smooth", 6e-5)),
        (LawChoice("smooth", 5.5e-5), LawChoice("smooth", 5.5e-5)),
    ],
)
def test_limit_cycle_lowers_gain_of_laws_on_range(lowered, same):
    now = estimate(1.2 * R_D, -2.0)
    halved = Steering(ORBIT, lowered)(now, share=0.5)
    assert halved.demanded == pytest.approx(Steering(ORBIT, same)(now).demanded)


@pytest.mark.parametrize("gain", [0.005, 0.0025])
def test_steering_rejects_gain_without_radius_correction(gain):
    with pytest.raises(ValueError, match=r"must be above 1/\(2 r_d\^2\) = 0\.005"):
        Steering(PAPER, LawChoice("smooth", gain))


@given(
    gain=st.floats(0.5, 1.5),
    demanded=st.one_of(st.floats(-1e6, 1e6), st.sampled_from([-inf, inf])),
    first=st.floats(1e-3, 10),
    bound=st.floats(1e-3, 10),
)
def test_turn_limit_bounds_command_after_gain_compensation(gain, demanded, first, bound):
    """For a turn rate w the command is w/gain. The turn limit applies to the command, not to w."""
    wanted = limited(demanded, first)
    assert wanted.saturated == (abs(demanded) > first)
    assert wanted.turn_rate == (np.copysign(first, demanded) if wanted.saturated else demanded)
    compensated = compensate_turn_gain(wanted, bound, gain)
    assert compensated.saturated == (wanted.saturated or abs(wanted.turn_rate / gain) > bound)
    assert compensated.turn_rate == pytest.approx(max(-bound, min(wanted.turn_rate / gain, bound)))
    assert compensated.demanded == wanted.demanded == demanded


def test_steering_applies_vehicle_limit_after_law():
    """The equation of law 1 has no bound. In tangential flight 200 m outside the circle, the law
    demands 40 times the turn limit."""
    command = Steering(Orbit(10.0, Direction.CLOCKWISE, 1.0, 0.1), LawChoice("smooth", 0.01))(
        estimate(200.0)
    )
    assert (command.turn_rate, command.saturated) == (-0.1, True)
    assert command.demanded == pytest.approx(-4.0, rel=0.01)


def test_steering_reports_command_just_below_limit_as_saturated():
    """After a handover the difference between the two laws fades exponentially and never reaches 0,
    so the command stays slightly below the limit."""
    steer = Steering(ORBIT, LawChoice("auto", 0.06))
    assert not any(steer(estimate(100.0, 0.0, 0.05 * i)).saturated for i in range(5))
    tight = Orbit(V / (0.95 * LIMIT), Direction.CLOCKWISE, V, LIMIT)
    assert not Steering(tight, LawChoice("auto", 0.06))(estimate(tight.radius, 0.0)).saturated
    close = known(x=20.0, heading=pi)
    last = [steer(estimate(20.0, -15.0, 0.25 + 0.05 * i, close)) for i in range(60)][-1]
    assert abs(last.demanded) > LIMIT
    assert abs(last.turn_rate) >= 0.99 * LIMIT
    assert last.saturated


def test_gap_between_estimates_does_not_count_as_search_time():
    steer = Steering(ORBIT, LawChoice("auto", 0.02))
    flown = [
        steer(estimate(300.0, -15.0, time, untrusted(x=300.0, heading=pi))).flies
        for time in (0.0, 60.0, 60.4, 60.6)
    ]
    assert flown == ["feedforward", "feedforward", "feedforward", "trial"]


def test_steering_reports_active_law_of_auto_and_drift():
    auto, feedforward, drift = (
        Steering(ORBIT, LawChoice(name, 0.06)) for name in ("auto", "feedforward", "drift")
    )
    command = auto(estimate(150.0, -3.0))
    assert command.turn_rate == feedforward(estimate(150.0, -3.0)).turn_rate < 0
    assert (command.flies, bool(command.why)) == ("feedforward", True)
    assert auto(estimate(150.0, -3.0, 0.05, known(x=150.0))).flies == "drift"
    assert auto(estimate(150.0, -3.0, 0.1)).why == LOST
    assert {drift(estimate(150.0, -3.0, 0.1 * i, untrusted())).flies for i in range(60)} == {
        "feedforward"
    }


@pytest.mark.parametrize(
    ("r", "r_dot", "remembered", "flies"),
    [
        (105.0, 1.0, True, "feedforward"),  # turning on the circle is sufficient excitation
        (105.0, 1.0, False, "trial"),
        (129.0, 5.9, True, "feedforward"),  # within 0.3 of the radius and 0.4 of V
        (71.0, -5.9, True, "feedforward"),
        (131.0, 0.0, True, "trial"),
        (69.0, 0.0, True, "trial"),
        (100.0, 6.1, True, "trial"),
        (100.0, -6.1, True, "trial"),
    ],
)
def test_auto_law_delays_hypothesis_trial_while_drift_is_remembered(r, r_dot, remembered, flies):
    steer = Steering(ORBIT, LawChoice("auto", 0.06))
    candidate = untrusted(x=r, drift_remembered=remembered)
    flown = [steer(estimate(r, r_dot, t, candidate)).flies for t in np.arange(0.0, 15.0, 0.5)]
    assert flown[4] == flown[19] == flies  # the active law at 2 s and at 9.5 s
    assert flown[-1] == "trial"


def test_search_time_begins_after_outage_of_uplink():
    """A copter hovers during an outage of its uplink. Its path is then unknown, so no search runs.
    The search time begins when the path is known again."""
    steer = Steering(ORBIT, LawChoice("auto", 0.06))
    for t in np.arange(0.0, 60.0, 0.5):
        steer(estimate(105.0, 0.0, t))
    candidate = untrusted(x=105.0, drift_remembered=True)
    flown = [
        steer(estimate(105.0, 0.0, 60.0 + t, candidate)).flies for t in np.arange(0.0, 15.0, 0.5)
    ]
    assert 9.0 <= 0.5 * flown.index("trial") <= 10.0


def test_drift_law_uses_gains_of_given_response():
    at = known(x=130.0, y=20.0, drift_x=1.0, drift_y=-2.0, heading=1.2, turn_rate=0.1)
    steer = Steering(
        Orbit(R_D, Direction.COUNTERCLOCKWISE, V, LIMIT), LawChoice("auto", 0.06, lag=0.5)
    )
    for time, pending in enumerate((Pending(0.0, 0.5), Pending(0.1, 0.9, 1.2), Pending(-0.1, 0.3))):
        gains = drift_gains(V, pending.ahead, pending.settles, 0.7)
        wanted = drift(
            (130.0, 20.0), (1.0, -2.0), 1.2, pending, V=V, r_d=R_D, max_turn_rate=LIMIT, gains=gains
        )
        assert steer(
            estimate(150.0, -3.0, float(time), at), pending, 0.7
        ).demanded == pytest.approx(float(wanted))


def fed_drift(drifts):
    """Return the turn rates on a circle for a series of drifts across the nose, m/s, one each
    0.05 s."""
    orbit = Orbit(
        radius=150.0, direction=Direction.COUNTERCLOCKWISE, speed=22.0, max_turn_rate=0.44
    )
    steer = Steering(orbit, LawChoice("auto", 0.01))
    turns = []
    for tick, blows in enumerate(drifts):
        here = known(x=150.0, drift_x=blows, heading=pi / 2, turn_rate=22.0 / 150.0, airspeed=22.0)
        turns.append(steer(estimate(150.0, 0.0, tick * 0.05, here)).turn_rate)
    return turns


def test_steering_attenuates_drift_oscillation_of_1_hz():
    """A drift of 1 m/s across the nose is a crab angle of 1/V; at a frequency f it changes by up to
    2 pi f/V. A few false ranges can move the estimated drift by 1 m/s for a short time, and this
    must not turn the vehicle."""
    turns = fed_drift([np.cos(2 * pi * 0.05 * tick) for tick in range(60)])[30:]
    assert max(turns) - min(turns) < 0.5 * 2 * (2 * pi / 22.0)


def test_steering_follows_drift_ramp_within_half_a_second():
    """The drift grows by 0.5 m/s^2, as when a plane meets a gust front."""
    turns = fed_drift([0.0] * 100 + [0.5 * 0.05 * tick for tick in range(11)])
    assert turns[-1] - turns[99] > 0.028


@pytest.mark.parametrize(("r_dot", "turn"), [(0.18, None), (0.42, LIMIT)])
def test_departure_bends_command_from_fifth_of_speed(r_dot, turn):
    """From two fifths of the speed on, a vehicle that flies away turns at its limit."""
    auto, plain = (Steering(ORBIT, LawChoice(name, 0.01)) for name in ("auto", "feedforward"))
    leaving = estimate(120.0, r_dot * V)
    wanted = abs(plain(leaving).turn_rate)
    assert wanted < 0.9 * LIMIT
    assert abs(auto(leaving).turn_rate) == pytest.approx(turn or wanted)


@pytest.mark.parametrize("direction", Direction)
def test_coasting_flies_circle_in_wind_without_ranges(direction):
    """One lap of 40 s by heading alone in 6 m/s of wind. A constant turn rate V/r_d would let the
    wind carry the vehicle 240 m away."""
    s = direction.turn_sign
    dt = 0.02
    d = np.array([0.0, 6.0])
    orbit = Orbit(R_D, direction, V, LIMIT)
    p = np.array([R_D, 0.0])
    # nose and wind both point along the tangent
    psi = s * pi / 2
    swept = 0.0
    farthest = 0.0
    for _ in range(round(60 / dt)):
        turned = coasting(orbit, known(drift_y=6.0, heading=psi), AT_REST).turn_rate * dt
        before = p
        p = p + chord(V, psi, turned, dt) + d * dt
        psi = psi + turned
        swept += np.arctan2(before[0] * p[1] - before[1] * p[0], before @ p)
        farthest = max(farthest, abs(np.hypot(*p) - R_D))
    assert s * swept > 2 * pi
    assert farthest < 0.5


def test_coasting_adds_pending_turn_to_heading():
    ahead = coasting(ORBIT, known(drift_y=6.0, heading=0.7), Pending(0.3, 0.4))
    assert ahead == coasting(ORBIT, known(drift_y=6.0, heading=1.0), AT_REST)


@pytest.mark.parametrize("direction", Direction)
@pytest.mark.parametrize(
    "not_known",
    [
        {"trusted": False},
        {"trusted": False, "trial": 4},
        None,
        *(
            {one: number}
            for one in ("drift_x", "drift_y", "heading", "airspeed")
            for number in (nan, inf)
        ),
    ],
    ids=str,
)
def test_coasting_turns_at_v_over_r_without_trusted_motion(direction, not_known):
    orbit = Orbit(R_D, direction, V, LIMIT)
    motion = {"drift_y": 6.0, "heading": pi / 2}
    assert coasting(orbit, known(**motion), AT_REST).turn_rate != orbit.steady_turn_rate
    held = coasting(
        orbit, None if not_known is None else known(**motion | not_known), Pending(-0.04, 0.4)
    )
    assert (
        held.turn_rate == held.demanded == direction.turn_sign * V / R_D == orbit.steady_turn_rate
    )
    assert not held.saturated


# flight downwind: ground speed 24 m/s
@pytest.mark.parametrize("motion", [None, known(drift_y=-9.0, heading=-pi / 2)])
def test_coasting_saturates_at_turn_limit(motion):
    held = coasting(Orbit(R_D, Direction.CLOCKWISE, V, 0.1), motion, AT_REST)
    assert (held.turn_rate, held.saturated) == (-0.1, True)
