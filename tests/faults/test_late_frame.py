"""A frame that comes late by another way."""

from sim.faults.frames import message_id
from tests.faults.course import on_the_circle


def test_one_late_frame_is_no_reboot() -> None:
    course = on_the_circle("arducopter", ('guidance.law="smooth"',))
    late: list[bytes] = []

    def tamper(way, data, now):
        if message_id(data) == 30 and not late:
            late.append(data)
        return [(way, data)]

    course.link.tampers.append(tamper)
    course.fly(course.now + 1.5)
    course.pilot.receive(late[0], course.now, "sim")
    course.fly(course.now + 1.0)
    assert course.pilot.outcome is None, course.pilot.outcome
