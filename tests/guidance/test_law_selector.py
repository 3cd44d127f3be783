"""The steering law of `auto`: its selection, its timing, and changes without a jump."""

from math import exp, pi, sin

import pytest

from circnav_mav.guidance.step import FADE, WHY, ActiveLaw, Handover, next_handover

STEP = 0.05
LIMIT = 0.35
BY_RANGE = 0.1
BY_BANK = -0.05


def go_on(
    before: Handover,
    seconds: float,
    *,
    trusted=False,
    most_likely=None,
    by_range=BY_RANGE,
    drift_turn=BY_BANK,
    leaves=0.0,
):
    """Return the state of the handover after each step during some seconds."""
    found = []
    for _ in range(round(seconds / STEP)):
        before = next_handover(
            before,
            STEP,
            trusted=trusted,
            most_likely=most_likely,
            by_range=by_range,
            drift_turn=drift_turn,
            limit=LIMIT,
            leaves=leaves,
        )
        found.append(before)
    return found


def test_handover_tries_hypothesis_after_one_second_of_search():
    steps = go_on(Handover(), 2.0, most_likely=3)
    assert {(step.flies, step.command) for step in steps[:19]} == {
        (ActiveLaw.FEEDFORWARD, BY_RANGE)
    }
    assert {step.flies for step in steps[19:]} == {ActiveLaw.TRIAL}
    assert steps[-1].command == pytest.approx(BY_BANK, abs=0.15 * exp(-0.95 / FADE))
    without = go_on(Handover(), 20.0)
    assert {step.flies for step in without} == {ActiveLaw.FEEDFORWARD}


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("most_likely", [None, 3])
def test_departure_turns_at_limit_to_commanded_side(most_likely, way):
    inputs = {"most_likely": most_likely, "by_range": 0.02 * way, "drift_turn": 0.02 * way}
    turns = [
        go_on(Handover(), 2.0, leaves=leaves, **inputs)[-1].command for leaves in (0.0, 0.5, 1.0)
    ]
    assert turns == pytest.approx([0.02 * way, (0.02 + LIMIT) / 2 * way, LIMIT * way], abs=1e-3)
    known = go_on(Handover(), 2.0, trusted=True, leaves=1.0, **inputs)[-1]
    assert known.command == pytest.approx(0.02 * way), "a trusted position ends the departure"


def test_departure_keeps_its_turn_side_during_excitation():
    """With long-range radios the most likely hypothesis kept changing. Turns to alternating sides
    once led the vehicle 1.3 km away from the target."""
    step = Handover()
    commands = []
    for n in range(20):
        step = go_on(step, 1.0, most_likely=n, drift_turn=-0.2 if n % 2 else 0.2, leaves=1.0)[-1]
        commands.append(round(step.command, 1))
    assert commands == pytest.approx(
        [-LIMIT if n > 5 or n % 2 else LIMIT for n in range(20)], abs=0.06
    )
    at_last = go_on(go_on(step, 1.0)[-1], 1.0, by_range=0.1, leaves=1.0)[-1]
    assert at_last.command == pytest.approx(LIMIT, abs=1e-2), (
        "the next departure selects a new turn side"
    )


def test_inconclusive_trial_adds_excitation_with_period_of_6_s():
    """After 6 s an excitation is added to the command of the most likely hypothesis: amplitude 0.7
    times the turn limit, period 6 s."""
    for n, step in enumerate(go_on(Handover(), 24.0, most_likely=3), 1):
        weave = 0.7 * LIMIT * sin(2 * pi * n * STEP / 6.0) if n * STEP > 6.0 + 1e-9 else 0.0
        if n * STEP >= 3.0:
            assert step.command == pytest.approx(max(min(BY_BANK + weave, LIMIT), -LIMIT), abs=1e-4)


def test_found_target_ends_search():
    searched = go_on(Handover(), 9.0, most_likely=3)
    found = go_on(searched[-1], 2.0, trusted=True)
    assert {(step.flies, step.untrusted) for step in found} == {(ActiveLaw.DRIFT, 0.0)}
    assert found[-1].command == pytest.approx(BY_BANK, abs=1e-4)
    assert go_on(found[-1], 0.5, most_likely=3)[-1].flies is ActiveLaw.FEEDFORWARD


@pytest.mark.parametrize(("trusted", "most_likely"), [(True, None), (False, 5)])
def test_handover_fades_command_when_law_or_hypothesis_changes(trusted, most_likely):
    before = go_on(Handover(), 5.0, most_likely=3)[-1]
    wanted = 0.25
    after = go_on(before, 1.0, trusted=trusted, most_likely=most_likely, drift_turn=wanted)
    for n, step in enumerate(after):
        assert step.command == pytest.approx(
            wanted + (before.command - wanted) * exp(-n * STEP / FADE), abs=1e-9
        )


def test_handover_command_stays_within_limit():
    before = go_on(Handover(), 5.0, trusted=True, drift_turn=-9.0)[-1]
    assert before.command == -LIMIT
    assert {
        abs(step.command) <= LIMIT for step in go_on(before, 3.0, most_likely=1, drift_turn=9.0)
    } == {True}


def test_text_of_each_active_law_fits_statustext():
    assert all(len(f"circnav: {WHY[flies]}") <= 50 for flies in ActiveLaw)
