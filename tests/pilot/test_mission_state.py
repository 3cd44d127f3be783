"""The phase table: what no order of events may ever do."""

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.pilot.mission_state import STEERING, TRANSITIONS, Event, Phase, advance

event_lists = st.lists(st.sampled_from(Event), max_size=40)


def reachable(start, allowed):
    """Phases that some order of the allowed events reaches."""
    found, edge = {start}, [start]
    while edge:
        phase = edge.pop()
        for event in allowed:
            after = advance(phase, event)
            if after not in found:
                found.add(after)
                edge.append(after)
    return found


def test_the_vehicle_is_ours_while_engaged_or_holding_and_never_else():
    assert {Phase.ENGAGED, Phase.HOLDING} == STEERING


@pytest.mark.parametrize("phase", sorted(STEERING, key=str))
def test_the_operator_leaving_the_mode_always_ends_the_steering(phase):
    assert advance(phase, Event.MODE_LEFT) is Phase.YIELDED


@pytest.mark.parametrize("event", [Event.LINK_LOST, Event.FINISH, Event.MODE_LEFT])
@pytest.mark.parametrize("phase", sorted(STEERING, key=str))
def test_a_lost_link_an_end_and_a_takeover_all_stop_the_steering(phase, event):
    assert advance(phase, event) not in STEERING


def test_having_yielded_nothing_but_the_guided_mode_brings_the_steering_back():
    others = [event for event in Event if event is not Event.MODE_OURS]
    assert not reachable(Phase.YIELDED, others) & STEERING


def test_no_phase_before_engagement_steers_without_the_guided_mode():
    others = [event for event in Event if event is not Event.MODE_OURS]
    for phase in (Phase.WAIT_LINK, Phase.WAIT_RANGING, Phase.READY):
        assert not reachable(phase, others) & STEERING


def test_engaging_needs_link_and_range_whatever_the_mode():
    assert not reachable(Phase.WAIT_LINK, [Event.MODE_OURS, Event.RANGE_GOOD]) & STEERING
    assert not reachable(Phase.WAIT_RANGING, [Event.MODE_OURS, Event.LINK_UP]) & STEERING
    assert not reachable(Phase.YIELDED, [Event.MODE_OURS, Event.LINK_UP]) & STEERING


@pytest.mark.parametrize("event", Event)
def test_the_end_is_final(event):
    assert advance(Phase.ENDED, event) is Phase.ENDED


@given(events=event_lists)
def test_after_finish_nothing_steers_again(events):
    for start in Phase:
        phase = advance(start, Event.FINISH)
        for event in events:
            phase = advance(phase, event)
            assert phase not in STEERING


def test_every_phase_can_end():
    for phase in Phase:
        assert Phase.ENDED in reachable(phase, [Event.FINISH, Event.SAFE_SENT])


def test_finishing_while_steering_leaves_through_the_safe_setpoint():
    for phase in STEERING:
        assert advance(phase, Event.FINISH) is Phase.LEAVING
    assert advance(Phase.LEAVING, Event.SAFE_SENT) is Phase.ENDED


@pytest.mark.parametrize("event", [Event.MODE_LEFT, Event.LINK_LOST])
def test_leaving_without_a_vehicle_of_ours_is_over(event):
    assert advance(Phase.LEAVING, event) is Phase.ENDED


def test_a_lost_link_is_noticed_in_every_phase_that_has_one():
    for phase in set(Phase) - {Phase.WAIT_LINK, Phase.LEAVING, Phase.ENDED}:
        assert advance(phase, Event.LINK_LOST) is Phase.WAIT_LINK


def test_range_comes_and_goes_while_steering_without_a_new_consent():
    assert advance(Phase.ENGAGED, Event.RANGE_LOST) is Phase.HOLDING
    assert advance(Phase.HOLDING, Event.RANGE_GOOD) is Phase.ENGAGED


def test_a_pair_that_is_not_listed_changes_nothing():
    for phase, event in product(Phase, Event):
        assert advance(phase, event) is TRANSITIONS.get((phase, event), phase)


def test_every_phase_can_be_reached():
    assert reachable(Phase.WAIT_LINK, list(Event)) == set(Phase)


def test_a_mission_that_was_begun_leaves_a_vehicle_in_our_mode_with_the_safe_setpoint_and_no_other():
    ours = {Phase.WAIT_RANGING, Phase.READY, *STEERING}
    for phase in ours:
        assert advance(phase, Event.FINISH_OURS) is Phase.LEAVING
    for phase in (Phase.WAIT_LINK, Phase.YIELDED):
        assert advance(phase, Event.FINISH_OURS) is Phase.ENDED
