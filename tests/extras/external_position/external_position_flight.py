"""Flights of the bundled vehicle in lockstep, with locator and external position beside the
pilot."""

from dataclasses import dataclass, field

from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.extras.external_position.companion import Companion
from circnav_mav.extras.external_position.settings import ExternalPositionSettings
from circnav_mav.pilot.loop_step import LoopStep
from tests.extras.locate.flown import LocatingFlight, locating_flight

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
class ExternalPositionFlight(LocatingFlight):
    """A flight with locator and external position. given: (time, frame) sent by the external
    position."""

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
        """Fly until a time, and also after the end of guidance while the external position is
        busy."""
        assert self.companion is not None
        while self.now < until and (not self.pilot.done or self.companion.busy):
            self._step(until if self.pilot.done else min(self.pilot.scheduler.due, until))
            if watch is not None:
                watch(self)
        return self

    @property
    def given_messages(self) -> list[tuple[float, mavlink.MAVLink_message]]:
        """Messages of the external position with their times, decoded by pymavlink."""
        parser = mavlink.MAVLink(None)
        return [
            (time, message)
            for time, frame in self.given
            for message in parser.parse_buffer(frame) or ()
        ]


def external_position_flight(
    mission: str, *overrides: str, law: str | None = None, place: tuple[float, float] | None = None
) -> ExternalPositionFlight:
    """Return a flight of a file in config/ with locator and external position. place: position of
    the target, given by the mission."""
    flown = locating_flight(mission, *overrides, law=law)
    assert flown.locator is not None
    companion = Companion(ExternalPositionSettings(COMPONENT, place), flown.pilot, flown.locator)
    return ExternalPositionFlight(
        flown.pilot, flown.vehicle, locator=flown.locator, companion=companion
    )
