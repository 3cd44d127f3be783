"""The phase table: forbidden transitions in any order of events."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.pilot.mission_state import STEERING, TRANSITIONS, Event, Phase

OURS = {Phase.WAIT_RANGING, Phase.READY, *STEERING}
"""Phases in which the vehicle may be in the guided mode after the engagement."""


def advance(phase, event):
    return TRANSITIONS.get((phase, event), phase)


def reachable(start, allowed):
    """Return the phases that some order of the allowed events reaches."""
    found = {start}
    edge = [start]
    while edge:
        phase = edge.pop()
        for event in allowed:
            after = advance(phase, event)
            if after not in found:
                found.add(after)
                edge.append(after)
    return found


@pytest.mark.parametrize(
    ("phases", "event", "after"),
    [
        (OURS, Event.MODE_LEFT, Phase.YIELDED),
        (STEERING, Event.FINISH, Phase.LEAVING),
        (
            set(Phase) - {Phase.WAIT_LINK, Phase.LEAVING, Phase.ENDED},
            Event.LINK_LOST,
            Phase.WAIT_LINK,
        ),
        (OURS, Event.FINISH_OURS, Phase.LEAVING),
        ({Phase.WAIT_LINK, Phase.YIELDED}, Event.FINISH_OURS, Phase.ENDED),
        ({Phase.LEAVING}, Event.SAFE_SENT, Phase.ENDED),
        ({Phase.LEAVING}, Event.MODE_LEFT, Phase.ENDED),
        ({Phase.LEAVING}, Event.LINK_LOST, Phase.ENDED),
        ({Phase.ENGAGED}, Event.RANGE_LOST, Phase.COASTING),
        ({Phase.COASTING}, Event.RANGE_GOOD, Phase.ENGAGED),
        *(({Phase.ENDED}, event, Phase.ENDED) for event in Event),
    ],
)
def test_phase_after_each_event_matches_transition_rules(phases, event, after):
    assert {advance(phase, event) for phase in phases} == {after}


@pytest.mark.parametrize(
    ("start", "events"),
    [
        *((phase, set(Event) - {Event.MODE_OURS}) for phase in Phase if phase not in STEERING),
        (Phase.WAIT_LINK, {Event.MODE_OURS, Event.RANGE_GOOD}),
        (Phase.WAIT_RANGING, {Event.MODE_OURS, Event.LINK_UP}),
        (Phase.YIELDED, {Event.MODE_OURS, Event.LINK_UP}),
    ],
)
def test_steering_phases_require_guided_mode_link_and_range(start, events):
    assert not reachable(start, events) & STEERING


@given(events=st.lists(st.sampled_from(Event), max_size=40))
def test_no_steering_phase_after_finish(events):
    for start in Phase:
        phase = advance(start, Event.FINISH)
        for event in events:
            phase = advance(phase, event)
            assert phase not in STEERING


def test_each_phase_is_reachable_and_can_end():
    assert reachable(Phase.WAIT_LINK, list(Event)) == set(Phase)
    for phase in Phase:
        assert Phase.ENDED in reachable(phase, [Event.FINISH, Event.SAFE_SENT])
