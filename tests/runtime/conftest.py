"""Statuses of a real flight in lockstep, and of what can go wrong in it."""

from collections.abc import Callable
from functools import cache

import pytest

from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import OutputMode, Pilot
from circnav_mav.runtime.status import Status, Watch
from sim.config import parse_vehicle
from sim.vehicle import Vehicle
from tests.flight.lockstep import CONFIG, Flight

EVENTS = {
    "outage": [{"at_s": 6.0, "action": "mute_ranging"}],
    "takeover": [{"at_s": 6.0, "action": "mode", "mode": "LOITER"}],
    "silence": [{"at_s": 6.0, "action": "mute_autopilot"}],
    "gone": [{"at_s": 6.0, "action": "mute_autopilot"}, {"at_s": 6.0, "action": "mute_ranging"}],
    None: [],
}


@pytest.fixture(scope="session")
def statuses() -> Callable[..., list[Status]]:
    """The statuses, four a second, of some seconds of the quickstart under overrides, and what happens at second 6."""

    @cache
    def fly(
        seconds: float, *overrides: str, event: str | None = None, output_mode: OutputMode = OutputMode.FLY
    ) -> list[Status]:
        mission = load_mission(CONFIG / "quickstart.toml", ('guidance.law="smooth"', *overrides))
        vehicle = Vehicle(parse_vehicle({**mission.file.sim, "events": EVENTS[event]}, "quickstart"))
        flight, found = Flight(Pilot(mission.pilot_settings(output_mode)), vehicle), []
        watch = Watch(flight.pilot)

        def look(flown: Flight) -> None:
            if flown.ticks and (flown.pilot.done or not found or flown.now - found[-1].time >= 0.25):
                found.append(watch.status(flown.ticks[-1], flown.now))

        flight.fly(seconds, look)
        return found

    return fly
