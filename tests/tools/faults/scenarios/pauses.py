"""F24: the vehicle, its radio, circnav, or the computer that runs all three pauses and
continues."""

from collections.abc import Callable

from tests.frames import output, read, rewritten
from tests.tools.faults.cell import Scenario, Want
from tests.tools.faults.course import Course
from tests.tools.faults.tampering import on

RANGE = 132
STEP = 0.01
Pause = Callable[[Course, float], None]
"""Callback(flight, seconds): pauses a component for this time, from now on."""


def vehicle_pauses(course: Course, seconds: float) -> None:
    """Stop the vehicle and its clock. Frames sent to it wait. circnav's time continues."""
    before = course.clock
    since = course.clock(course.now)
    for n in range(1, round(seconds / STEP)):
        course.vehicle.receive(output(course.pilot, since + n * STEP))
    course.clock = lambda now: before(now) + seconds


def radio_pauses(course: Course, seconds: float) -> None:
    """Stop the radio and its clock. The vehicle and its link continue."""
    until = course.now + seconds

    def change(frame: bytes, now: float) -> list[bytes]:
        return (
            []
            if now < until
            else [rewritten(frame, time_boot_ms=read(frame).time_boot_ms - round(1000 * seconds))]
        )

    course.link.tampers.append(on(RANGE, change))
    course.fly(until)


def radio_buffers(at_once: int) -> Pause:
    """Let the radio buffer its ranges for some time. It then sends up to `at_once` buffered ranges
    with each new range."""

    def pauses(course: Course, seconds: float) -> None:
        until = course.now + seconds
        waiting = list[bytes]()

        def change(frame: bytes, now: float) -> list[bytes]:
            waiting.append(frame)
            out = waiting[:at_once] if now >= until else []
            del waiting[: len(out)]
            return out

        course.link.tampers.append(on(RANGE, change))
        course.fly(until)
        while waiting:
            course.fly(course.now + 0.1)

    return pauses


def we_pause(course: Course, seconds: float) -> None:
    """Stop circnav. Frames of the vehicle wait in circnav's socket."""
    course.stall(seconds)


def companion_sleeps(course: Course, seconds: float) -> None:
    """Suspend circnav's computer. The vehicle continues, and its frames are lost. circnav's clock
    includes the suspended time, as on Linux."""
    course.stall(seconds, lost=True)


def computer_pauses(course: Course, seconds: float) -> None:
    """Stop vehicle, radio and circnav, which run on one computer. The computer's clock
    continues."""
    before = course.clock
    course.clock = lambda now: before(now) + seconds
    course.stood_still(seconds)


PAUSES: dict[str, Pause] = {
    "vehicle": vehicle_pauses,
    "radio": radio_pauses,
    "radio buffers": radio_buffers(100),
    "radio buffers and drains": radio_buffers(2),
    "we": we_pause,
    "companion computer sleeps": companion_sleeps,
    "whole computer": computer_pauses,
}


def paused(who: str, seconds: float) -> Scenario:
    def arrange(course: Course, seed: int) -> None:
        PAUSES[who](course, seconds)

    return Scenario(
        "F24",
        f"{who} {seconds:g} s",
        arrange=arrange,
        lasts=seconds + 5.0,
        after=50.0,
        want=Want.REGAIN,
        clocks=True,
        quick=(who, seconds) == ("whole computer", 3.0),
    )


STANDSTILLS = [
    # pauses of circnav alone: F20
    *(paused(who, seconds) for who in PAUSES if who != "we" for seconds in (0.5, 3.0)),
    paused("companion computer sleeps", 30.0),
    paused("whole computer", 30.0),
]
