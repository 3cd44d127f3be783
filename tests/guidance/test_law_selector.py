"""Who steers in `auto`, when, and that nothing jumps as it changes."""

from math import cos, exp, pi, sin

import pytest

from circnav_mav.guidance import floats
from circnav_mav.guidance.law_selector import FADE, FIRST_GUESS, ONE_AT_START, PATIENCE, Flies, Handover, hand_over
from circnav_mav.guidance.step import LawChoice, steering
from circnav_mav.guidance.types import Direction, Orbit, RangeEstimate, RelativeMotion

STEP, LIMIT = 0.05, 0.35
BY_RANGE, BY_BANK = 0.1, -0.05


def go_on(before: Handover, seconds: float, *, trusted: bool = False, favourite: int = -1, by_bank: float = BY_BANK):
    """The handovers of some seconds, the first one a step later."""
    found = []
    for _ in range(round(seconds / STEP)):
        before = hand_over(
            before, STEP, trusted=trusted, favourite=favourite, by_range=BY_RANGE, by_bank=by_bank, limit=LIMIT,
            r=200.0, r_d=100.0, xp=floats,
        )  # fmt: skip
        found.append(before)
    return found


def test_a_guess_is_tried_once_the_search_has_had_its_second():
    steps = go_on(ONE_AT_START, 2.0, favourite=3)
    first = round(FIRST_GUESS / STEP) - 1
    assert {step.flies for step in steps[:first]} == {Flies.FEEDFORWARD}
    assert {step.flies for step in steps[first:]} == {Flies.TRIAL}
    assert {step.command for step in steps[:first]} == {BY_RANGE}
    assert steps[-1].command == pytest.approx(BY_BANK, abs=0.15 * exp(-0.95 / FADE))


def test_without_a_guess_nothing_is_tried():
    assert {step.flies for step in go_on(ONE_AT_START, 20.0)} == {Flies.FEEDFORWARD}


def test_a_trial_that_tells_nothing_apart_weaves_to_either_side_every_six_seconds():
    """Seven tenths of the limit about what the guess asks for, from the sixth second on: by hand."""
    steps = go_on(ONE_AT_START, 24.0, favourite=3)
    for n, step in enumerate(steps, 1):
        if 3.0 <= n * STEP <= PATIENCE:
            assert step.command == pytest.approx(BY_BANK, abs=1e-4)
        elif n * STEP > PATIENCE:
            weave = 0.7 * LIMIT * sin(2 * pi * n * STEP / 6.0)
            assert step.command == pytest.approx(max(min(BY_BANK + weave, LIMIT), -LIMIT), abs=1e-4)


def test_the_target_found_ends_the_weaving_and_the_next_search_has_its_time_again():
    searched = go_on(ONE_AT_START, 9.0, favourite=3)
    found = go_on(searched[-1], 2.0, trusted=True)
    assert {(step.flies, step.untrusted) for step in found} == {(Flies.DRIFT, 0.0)}
    assert found[-1].command == pytest.approx(BY_BANK, abs=1e-4)
    assert go_on(found[-1], 0.5, favourite=3)[-1].flies is Flies.FEEDFORWARD


@pytest.mark.parametrize(("trusted", "favourite"), [(True, -1), (False, 5)])
def test_a_change_of_who_steers_or_of_the_guess_is_no_jump_and_fades_in_a_fifth_of_a_second(trusted, favourite):
    before = go_on(ONE_AT_START, 5.0, favourite=3)[-1]
    wanted = 0.25
    after = go_on(before, 1.0, trusted=trusted, favourite=favourite, by_bank=wanted)
    for n, step in enumerate(after):
        assert step.command == pytest.approx(wanted + (before.command - wanted) * exp(-n * STEP / FADE), abs=1e-9)


def test_nothing_goes_beyond_the_limit():
    before = go_on(ONE_AT_START, 5.0, trusted=True, by_bank=-9.0)[-1]
    assert before.command == -LIMIT
    assert {abs(step.command) <= LIMIT for step in go_on(before, 3.0, favourite=1, by_bank=9.0)} == {True}


def test_a_drift_that_swings_once_a_second_moves_the_turn_far_less_than_one_that_swings_once_a_minute():
    """A first-order lag of .5 s lets 1/sqrt(1 + pi^2) = .30 of the quick one through. A few unlucky ranges move the
    estimated drift by 1 m/s for a moment; felt at once, it contains how the course lags the nose, too."""
    V, R = 22.0, 150.0
    orbit = Orbit(radius=R, direction=Direction.COUNTERCLOCKWISE, speed=V, max_turn_rate=0.44)

    def swing(frequency: float) -> float:
        steer, turns = steering(orbit, LawChoice("auto", 0.01)), []
        for tick in range(round(3 / frequency / 0.05)):
            drift = cos(2 * pi * frequency * tick * 0.05)
            here = RelativeMotion(R, 0.0, 1.0, drift, 0.0, pi / 2, V / R, V, 1.0, trusted=True)
            turns.append(steer(RangeEstimate(tick * 0.05, R, 0.0, 0.5, 0.5, relative=here)).turn_rate)
        late = turns[len(turns) // 2 :]
        return max(late) - min(late)

    assert swing(1.0) < 0.35 * swing(1 / 60)
