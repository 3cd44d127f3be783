"""Pauses of the vehicle, its radio or circnav: ranges are used within 1 s after they are fresh
again."""

from itertools import pairwise

import pytest

from circnav_mav.pilot.mission_state import Phase
from circnav_mav.runtime.listeners import Listeners
from circnav_mav.runtime.status import StatusSource
from tests.frames import read
from tests.rig import Rig, distance
from tests.tools.fault_link import UP, Impairment
from tests.tools.faults.course import on_the_circle
from tests.tools.faults.scenarios.pauses import PAUSES, radio_pauses
from tests.tools.faults.tampering import on

AUTO = ('guidance.law="auto"',)


@pytest.mark.parametrize("seconds", [0.5, 3.0])
@pytest.mark.parametrize("who", PAUSES)
def test_ranges_are_used_within_1_s_after_clock_pause(who: str, seconds: float) -> None:
    course = on_the_circle("arducopter", AUTO, seconds=60.0)
    PAUSES[who](course, seconds)
    course.fly(course.now + 1.0)
    taken = course.pilot.tracker.accepted
    refused = course.pilot.tracker.ranging.refused
    before = len(course.ticks)
    course.fly(course.now + 5.0)
    assert course.pilot.tracker.accepted - taken >= 49
    assert course.pilot.tracker.ranging.refused == refused
    assert {record.phase for record in course.ticks[before:]} == {Phase.ENGAGED}
    assert max(record.range_age or 0.0 for record in course.ticks[before:]) < 0.25
    assert course.broken == []


def test_stopped_sensor_clock_is_reported() -> None:
    course = on_the_circle("arducopter", AUTO, seconds=60.0)
    texts = list[bytes]()
    radio_pauses(course, 2.0)
    course.fly(course.now + 0.4)
    assert any(
        "SENSOR CLOCK" in alarm
        for alarm in StatusSource(course.pilot, Listeners())
        .status(course.ticks[-1], course.now)
        .alarms
    )
    course.link.tampers.append(
        on(253, lambda frame, now: texts.append(frame) or [frame], direction=UP)
    )
    course.fly(course.now + 6.0)
    assert StatusSource(course.pilot, Listeners()).status(course.ticks[-1], course.now).alarms == ()
    reported = [
        read(text).text.removeprefix("circnav: sensor clock ") for text in texts if b"clock" in text
    ]
    assert reported == ["stalled 2.0 s", "steady again"]


def test_slow_link_after_silence_is_not_a_clock_stop() -> None:
    """No frame arrives for 0.8 s, and afterwards every frame is 0.8 s late. The true age of the
    ranges must limit their use."""
    course = on_the_circle("arducopter", AUTO, seconds=60.0)
    course.link.impair(down=Impairment(delay=0.8))
    course.fly(course.now + 9.0)
    assert course.worst_age <= 0.5 + 0.06
    rejected = course.pilot.tracker.ranging.rejected
    assert rejected["too_old"] > 60 and rejected["clock"] <= 10


@pytest.mark.parametrize(("lag", "most"), [(0.35, 1), (0.45, 2), (0.48, 2)])
def test_steering_does_not_toggle_when_ranges_are_nearly_stale(lag: float, most: int) -> None:
    """The vehicle's link has become slow. The newest range is slightly younger than the stale age
    when it arrives, and slightly older before the next range."""
    rig = Rig().run(15.0)
    phases = list[Phase]()
    assert rig.pilot.mission.phase is Phase.ENGAGED
    rig.ranges = False
    rig.round_trip = 2 * lag
    for _ in range(180):
        rig.run(0.05)
        if rig.tick % 2 == 0:
            rig.receive(distance(15000, 1_000_000 + round((rig.now - lag) * 1000)))
        phases.append(rig.pilot.mission.phase)
    assert sum(a is not b for a, b in pairwise(phases)) <= most
