"""Flights of the bundled vehicle in lockstep, with survey and hand-back beside the pilot."""

from dataclasses import dataclass, field

from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.extras.handback.companion import Companion
from circnav_mav.extras.handback.settings import HandBackSettings
from circnav_mav.pilot.loop_step import LoopStep
from tests.extras.locate.flown import Surveyed, surveyed

COMPONENT = 193
GPS_LOST = (
    'sim.events=[{at_s=40.0, action="gps_off"}]',
    "sim.sensors.dead_reckoning_mps=1",
    "sim.sensors.gps_error_m=1",
    "sim.sensors.gps_error_time_s=600",
    "sim.wind.speed_mps=5",
    "sim.start.north_m=150",
    "sim.start.east_m=-100",
    "limits.duration_s=60",
)
"""A plane that circles and loses its GPS after 40 s. Guidance ends 20 s later."""


@dataclass
class HandedBack(Surveyed):
    """A flight with survey and hand-back. given: (time, frame) sent by the hand-back."""

    companion: Companion | None = None
    given: list[tuple[float, bytes]] = field(default_factory=list)

    def _keep(self, step: LoopStep) -> None:
        super()._keep(step)
        assert self.companion is not None
        for link, source, frames in step.received:
            self.companion.on_frames(link, source, frames, self.now)
        for frame in self.companion.step(self.now):
            self.given.append((self.now, frame))
            self.vehicle.receive(frame)

    def fly(self, until, watch=None):  # type: ignore[no-untyped-def, override]
        """Fly until a time, and also after the end of guidance while the hand-back is busy."""
        assert self.companion is not None
        while self.now < until and (not self.pilot.done or self.companion.busy):
            self._step(until if self.pilot.done else min(self.pilot.scheduler.due, until))
            if watch is not None:
                watch(self)
        return self

    @property
    def given_messages(self) -> list[tuple[float, mavlink.MAVLink_message]]:
        """Messages of the hand-back with their times, decoded by pymavlink."""
        parser = mavlink.MAVLink(None)
        return [
            (time, message)
            for time, frame in self.given
            for message in parser.parse_buffer(frame) or ()
        ]


def handed_back(
    mission: str, *overrides: str, law: str | None = None, place: tuple[float, float] | None = None
) -> HandedBack:
    """Return a flight of a file in config/ with survey and hand-back. place: position of the
    target, given by the mission."""
    flown = surveyed(mission, *overrides, law=law)
    assert flown.locator is not None
    companion = Companion(HandBackSettings(COMPONENT, place), flown.pilot, flown.locator)
    return HandedBack(flown.pilot, flown.vehicle, locator=flown.locator, companion=companion)
