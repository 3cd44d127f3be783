"""The law on relative motion, and who steers under `auto`."""

from dataclasses import replace
from math import inf, nan, pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.guidance.air_path import chord
from circnav_mav.guidance.law_selector import Flies, at_start, hand_over
from circnav_mav.guidance.step import LawChoice, holding, steering
from circnav_mav.guidance.turn_response import Pending, PendingTurn, Response
from circnav_mav.guidance.types import Direction, Orbit, RangeEstimate, RelativeMotion
from circnav_mav.guidance.vector_field import (
    drift,
    drift_gains,
    field_heading,
    inward_angle,
    mirrored,
    orbit_turn_rate,
)

V, R_D, LIMIT = 15.0, 100.0, 0.35
LAG = 0.4
GAINS = drift_gains(V, LAG, 1 / LAG)
UNDER_WAY = Pending(-0.04, LAG)
angles = st.floats(-pi, pi)


def turn(p, d, psi, omega):
    """With the turn rate of before still under way."""
    return drift(
        np.array(p), np.array(d), psi, Pending(LAG * omega, LAG), V=V, r_d=R_D, max_turn_rate=LIMIT, gains=GAINS
    )


def test_on_the_circle_in_still_air_it_asks_for_the_circles_own_turn():
    assert turn([R_D, 0.0], [0.0, 0.0], pi / 2, V / R_D) == pytest.approx(V / R_D, abs=1e-6)


@given(r=st.floats(5, 900), at=angles, psi=angles, wind=st.floats(0, 10), blows=angles, omega=st.floats(-0.35, 0.35))
def test_turning_the_compass_changes_nothing(r, at, psi, wind, blows, omega):
    commands = []
    for turned in (0.0, 1.1):
        p = r * np.array([np.cos(at + turned), np.sin(at + turned)])
        d = wind * np.array([np.cos(blows + turned), np.sin(blows + turned)])
        commands.append(float(turn(p, d, psi + turned, omega)))
    first, command = commands
    # next to the cut of the heading error at pi both ways round are right
    assert command == pytest.approx(first, abs=1e-6) or abs(abs(command - first) - 2 * pi * GAINS.heading) < 1e-3


@given(at=angles, wind=st.floats(0, 13), blows=angles, r=st.floats(30, 900))
def test_the_field_is_followed_over_the_ground_whatever_the_wind(at, wind, blows, r):
    p, d = (s * np.array([np.cos(a), np.sin(a)]) for s, a in ((r, at), (wind, blows)))
    psi = field_heading(p, d, V=V, r_d=R_D, k=GAINS.radial, max_turn_rate=LIMIT)
    v = V * np.array([np.cos(psi), np.sin(psi)]) + d
    n = p / r
    inward = inward_angle(r, r_d=R_D, k=GAINS.radial, sharpest=0.7 * LIMIT / (V + wind))
    assert np.arctan2(-(n @ v), n[0] * v[1] - n[1] * v[0]) == pytest.approx(inward, abs=1e-6)


@pytest.mark.parametrize(
    ("r", "sharpest", "outward"), [(50.0, 0.02, 1.0), (98.0, 0.02, 0.2), (50.0, 0.01, sqrt(0.1)), (1.0, 0.05, pi / 2)]
)
def test_far_inside_the_course_leads_out_no_steeper_than_the_tightest_turn_can_follow(r, sharpest, outward):
    """sqrt(2 e (sharpest - 1/r_d)), by hand: sqrt(2 50 .01) = 1; as for .1/r_d at least, straight out at most."""
    assert inward_angle(r, r_d=R_D, k=1e4, sharpest=sharpest) == pytest.approx(-outward, rel=1e-4)


def test_far_outside_the_course_touches_the_circle():
    assert inward_angle(400.0, r_d=R_D, k=1.0, sharpest=0.02) == pytest.approx(np.arccos(0.25), abs=1e-3)


def flown(sense, start, psi, d, seconds=200.0, dt=0.05, lag=LAG, ranges=None):
    """A point mass with a turn lag under the law with full information. ranges: all, for who wants them."""
    p, omega, d, under_way = np.array(start, float), 0.0, np.array(d, float), PendingTurn()
    for i in range(round(seconds / dt)):
        pending = under_way.at(i * dt, Response(0.0, lag, 1 / lag), omega)
        here = mirrored(p, d, np.asarray(psi), pending, np.asarray(sense))
        command = sense * np.clip(drift(*here, V=V, r_d=R_D, max_turn_rate=LIMIT, gains=GAINS), -LIMIT, LIMIT)
        under_way.command(i * dt, command)
        after = command + (omega - command) * np.exp(-dt / lag)
        turned = command * dt + (omega - command) * lag * (1 - np.exp(-dt / lag))
        p = p + chord(V, psi, turned, dt) + d * dt
        psi, omega = psi + turned, after
        if ranges is not None:
            ranges.append(np.hypot(*p))
    return p, psi


@pytest.mark.parametrize("d", [(0.0, 0.0), (-3.0, 2.0), (-3.0, -2.0)])
@pytest.mark.parametrize("r", [115.0, 130.0, 160.0, 190.0, 230.0])
@pytest.mark.parametrize("heading", [-1.7, -1.3, -0.6])
def test_outside_and_going_the_wrong_way_round_it_turns_away_from_the_target_and_not_past_it(r, heading, d):
    """The half turn to the inside is the shorter one, and leads within .3 .. .7 r_d of the target."""
    ranges = []
    flown(1.0, (r, 0.0), heading, d, seconds=60.0, ranges=ranges)
    assert min(ranges) > 0.9 * R_D and max(ranges) < r + R_D
    assert ranges[-1] == pytest.approx(R_D, abs=2.0)


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("start", [(300.0, 0.0), (10.0, 5.0)])
def test_it_reaches_the_circle_in_strong_wind_in_the_right_sense(sense, start):
    p, psi = flown(sense, start, 2.0, (6.0, -3.0))
    v = V * np.array([np.cos(psi), np.sin(psi)]) + np.array([6.0, -3.0])
    assert np.hypot(*p) == pytest.approx(R_D, abs=0.1)
    assert np.sign(p[0] * v[1] - p[1] * v[0]) == sense


def test_clockwise_is_the_exact_mirror_image_of_counterclockwise():
    left, _ = flown(1.0, (250.0, 40.0), 0.7, (4.0, 2.0), seconds=30)
    right, _ = flown(-1.0, (250.0, -40.0), -0.7, (4.0, -2.0), seconds=30)
    assert right == pytest.approx([left[0], -left[1]], abs=1e-9)


def step(before, trusted=False, favourite=-1, by_range=0.1, by_bank=-0.3, dt=0.05, r=300.0):
    return hand_over(
        before, dt, trusted=np.array([trusted]), favourite=np.array([favourite]), by_range=np.array([by_range]),
        by_bank=np.array([by_bank]), limit=LIMIT, r=np.array([r]), r_d=R_D,
    )  # fmt: skip


def test_a_trial_that_leads_away_ends_and_the_next_one_waits_until_the_way_is_made_good():
    state, seen = at_start(), []
    for r in (*np.linspace(300, 340, 100), *np.linspace(340, 360, 50), *np.linspace(360, 305, 100)):
        state = step(state, favourite=3, r=r)
        seen.append((float(r), int(state.flies[0])))
    away = [r for r, flies in seen[20:150] if flies != Flies.TRIAL]
    assert min(away) == pytest.approx(350.0, abs=1.0)  # half a radius
    back = [r for r, flies in seen[150:] if flies == Flies.TRIAL]
    assert max(back) == pytest.approx(310.0, abs=1.0)  # a tenth of one


ORBIT = Orbit(R_D, Direction.CLOCKWISE, V, LIMIT)


def estimate(time, relative=None):
    return RangeEstimate(time, 150.0, -3.0, 0.3, 0.3, relative=relative)


def test_auto_says_who_flies_and_why_and_needs_no_heading():
    steer, feedforward = (steering(ORBIT, LawChoice(name, 0.06)) for name in ("auto", "feedforward"))
    command = steer(estimate(0.0))
    assert command.turn_rate == feedforward(estimate(0.0)).turn_rate < 0
    assert (command.flies, bool(command.why)) == ("feedforward", True)
    known = RelativeMotion(150, 0, 1.0, 0, 0, 0.0, 0.0, V, 1.0, trusted=True)
    assert steer(estimate(0.05, known)).flies == "drift"


def test_the_law_drift_tries_no_guesses():
    steer = steering(ORBIT, LawChoice("drift", 0.06))
    guess = RelativeMotion(150, 0, 150.0, 0, 0, 0.0, 0.0, V, 1.0, trusted=False, trial=4)
    assert {steer(estimate(0.1 * i, guess)).flies for i in range(60)} == {"feedforward"}


def swing(dead, known):
    """Largest radius error of the last 60 s of 200, m, in calm air, of a vehicle with a dead time of which `known` is
    the part that the law knows of."""
    dt, p, psi, rate, worst = 0.02, np.array([1.15 * R_D, 0.0]), pi / 2, 0.0, 0.0
    response, under_way, told = Response(known * dead, LAG, 1 / LAG), PendingTurn(), [0.0] * (round(dead / dt) + 1)
    gains = drift_gains(V, response.delay, response.settles)
    for i in range(10_000):
        pending = under_way.at(i * dt, response, rate)
        command = drift(p, np.zeros(2), np.asarray(psi), pending, V=V, r_d=R_D, max_turn_rate=LIMIT, gains=gains)
        told.append(float(np.clip(command, -LIMIT, LIMIT)))
        under_way.command(i * dt, told[-1])
        rate += (told[-1 - round(dead / dt)] - rate) * dt / LAG
        p, psi = p + chord(V, psi, rate * dt, dt), psi + rate * dt
        worst = max(worst, abs(np.hypot(*p) - R_D)) if i > 7000 else 0.0
    return worst


@pytest.mark.parametrize("dead", [0.3, 0.6, 1.0])
def test_a_dead_time_that_is_known_does_not_swing(dead):
    assert swing(dead, 1.0) < 0.05


def test_a_dead_time_that_nobody_knows_of_swings():
    assert swing(1.5, 0.0) > 2.0


def test_the_law_flies_with_the_gains_for_the_answer_that_it_is_told():
    orbit, known = Orbit(R_D, Direction.COUNTERCLOCKWISE, V, LIMIT), RelativeMotion(
        130.0, 20.0, 1.0, 1.0, -2.0, 1.2, 0.1, V, 1.0, trusted=True
    )  # fmt: skip
    steer = steering(orbit, LawChoice("auto", 0.06, lag=0.5))
    for time, pending in enumerate((Pending(0.0, 0.5), Pending(0.1, 0.9, 1.2), Pending(-0.1, 0.3))):
        gains = drift_gains(V, pending.ahead, pending.settles, 0.7)
        wanted = drift(
            np.array([130.0, 20.0]), np.array([1.0, -2.0]), 1.2, pending, V=V, r_d=R_D, max_turn_rate=LIMIT, gains=gains
        )
        assert steer(estimate(float(time), known), 0.0, pending, 0.7).demanded == pytest.approx(float(wanted))


@pytest.mark.parametrize(
    ("r", "r_dot", "remembered", "flies"),
    [
        (105.0, 1.0, True, "feedforward"),  # the circle itself will tell
        (105.0, 1.0, False, "trial"),
        (150.0, 1.0, True, "trial"),
        (105.0, -10.0, True, "trial"),
        (129.0, 5.9, True, "feedforward"),  # .3 of the radius, and .4 of V
        (71.0, -5.9, True, "feedforward"),
        (131.0, 0.0, True, "trial"),
        (69.0, 0.0, True, "trial"),
        (100.0, 6.1, True, "trial"),
        (100.0, -6.1, True, "trial"),
    ],
)
def test_no_guess_is_tried_on_the_circle_while_the_drift_is_known_from_before(r, r_dot, remembered, flies):
    steer = steering(ORBIT, LawChoice("auto", 0.06))
    guess = RelativeMotion(r, 0, r, 0, 0, 0.0, 0.0, V, 1.0, trusted=False, trial=4, drift_remembered=remembered)
    at = [RangeEstimate(t, r, r_dot, 0.3, 0.3, relative=guess) for t in np.arange(0.0, 15.0, 0.5)]
    flown = [steer(one).flies for one in at]
    assert flown[4] == flown[19] == flies  # at 2 s and at 9.5 s
    assert flown[-1] == "trial"


@given(wind=st.floats(0, 8), blows=angles, at=angles)
def test_the_circles_own_turn_in_drift_is_the_turn_of_the_law_on_the_circle(wind, blows, at):
    """Two derivations: from the heading alone, and as the rotation of the field along the circle."""
    d = wind * np.array([np.cos(blows), np.sin(blows)])
    p = R_D * np.array([np.cos(at), np.sin(at)])
    psi = field_heading(p, d, V=V, r_d=R_D, k=GAINS.radial, max_turn_rate=LIMIT)
    alone = float(orbit_turn_rate(d, psi, V=V, r_d=R_D))
    asked = drift(p, d, psi, Pending(0.0, 0.0), V=V, r_d=R_D, max_turn_rate=LIMIT, gains=GAINS)
    assert float(asked) == pytest.approx(alone, abs=1e-4)


@pytest.mark.parametrize("direction", Direction)
def test_holding_in_drift_flies_the_circle_in_the_missions_sense_without_a_range(direction):
    """One lap by heading alone in 6 m/s of wind; V/r_d would be carried off by 6 m/s for 40 s."""
    s, dt, d = direction.turn_sign, 0.02, np.array([0.0, 6.0])
    orbit = Orbit(R_D, direction, V, LIMIT)
    p = np.array([R_D, 0.0])
    psi, swept, farthest = s * pi / 2, 0.0, 0.0  # the wind blows along the tangent here, so the nose does too
    for _ in range(round(60 / dt)):
        known = RelativeMotion(0.0, 0.0, 1.0, *d, psi, 0.0, V, 1.0, trusted=True)
        turned = holding(orbit, known, Pending(0.0, 0.0)).turn_rate * dt
        before, p, psi = p, p + chord(V, psi, turned, dt) + d * dt, psi + turned
        swept += np.arctan2(before[0] * p[1] - before[1] * p[0], before @ p)
        farthest = max(farthest, abs(np.hypot(*p) - R_D))
    assert s * swept > 2 * pi
    assert farthest < 0.5


def test_holding_without_a_known_drift_turns_at_v_over_r():
    orbit = Orbit(R_D, Direction.CLOCKWISE, V, LIMIT)
    guess = RelativeMotion(0.0, 0.0, 100.0, 0.0, 6.0, 0.0, 0.0, V, 1.0, trusted=False, trial=3)
    assert holding(orbit, None, UNDER_WAY).turn_rate == holding(orbit, guess, UNDER_WAY).turn_rate == -V / R_D
    assert (holding(orbit, None, UNDER_WAY).demanded, holding(orbit, None, UNDER_WAY).saturated) == (-V / R_D, False)


def test_holding_goes_no_further_than_the_limit():
    orbit = Orbit(R_D, Direction.CLOCKWISE, V, 0.1)
    assert (holding(orbit, None, UNDER_WAY).turn_rate, holding(orbit, None, UNDER_WAY).saturated) == (-0.1, True)
    downwind = RelativeMotion(R_D, 0.0, 1.0, 0.0, -9.0, -pi / 2, -0.1, V, 1.0, trusted=True)  # at 24 m/s
    assert (holding(orbit, downwind, UNDER_WAY).turn_rate, holding(orbit, downwind, UNDER_WAY).saturated) == (
        -0.1,
        True,
    )


@pytest.mark.parametrize("direction", Direction)
def test_holding_on_a_track_that_is_not_trusted_turns_at_v_over_r_in_the_missions_sense(direction):
    orbit = Orbit(R_D, direction, V, LIMIT)
    track = RelativeMotion(R_D, 0.0, 40.0, 0.0, 6.0, pi / 2, 0.1, V, 1.0, trusted=True)
    assert holding(orbit, track, UNDER_WAY).turn_rate != orbit.steady_turn_rate
    assert holding(orbit, replace(track, trusted=False), UNDER_WAY).turn_rate == direction.turn_sign * V / R_D


@pytest.mark.parametrize("field", ["drift_x", "drift_y", "heading", "turn_rate", "airspeed"])
@pytest.mark.parametrize("number", [nan, inf, -inf])
def test_holding_on_a_motion_that_is_no_number_turns_at_v_over_r(field, number):
    orbit = Orbit(R_D, Direction.CLOCKWISE, V, LIMIT)
    known = RelativeMotion(R_D, 0.0, 1.0, 0.0, 6.0, pi / 2, 0.1, V, 1.0, trusted=True)
    assert holding(orbit, replace(known, **{field: number}), UNDER_WAY).turn_rate == -V / R_D
