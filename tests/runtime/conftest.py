"""Statuses of lockstep flights, with and without faults."""

from collections.abc import Callable
from functools import cache
from typing import Any

import pytest

from circnav_mav.runtime.listeners import Listeners
from circnav_mav.runtime.status import Status, StatusSource
from tests.flight.lockstep import Flight, flight

EVENTS = {
    "outage": '{at_s=6.0, action="mute_ranging"}',
    "takeover": '{at_s=6.0, action="mode", mode="LOITER"}',
    "silence": '{at_s=6.0, action="mute_autopilot"}',
    "gone": '{at_s=6.0, action="mute_autopilot"}, {at_s=6.0, action="mute_ranging"}',
    None: "",
}


@pytest.fixture(scope="session")
def statuses() -> Callable[..., list[Status]]:
    """Return the statuses of some seconds of the quickstart, 4 per second. The flight has overrides
    and an event at 6 s. how: law and output mode."""

    @cache
    def fly(seconds: float, *overrides: str, event: str | None = None, **how: Any) -> list[Status]:
        under_way = flight("quickstart", f"sim.events=[{EVENTS[event]}]", *overrides, **how)
        found = list[Status]()
        watch = StatusSource(under_way.pilot, Listeners())

        def look(flown: Flight) -> None:
            if flown.ticks and (
                flown.pilot.done or not found or flown.now - found[-1].time >= 0.25
            ):
                found.append(watch.status(flown.ticks[-1], flown.now))

        under_way.fly(seconds, look)
        return found

    return fly
