"""Flights of the bundled vehicle in lockstep, with the locator beside the pilot, as in the loop of
a flight."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import atan2, pi
from pathlib import Path

import numpy as np
from circnav_sim.vehicle import Truth
from circnav_sim.world import to_degrees
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.extras.locate.estimator import NotLocated, locate
from circnav_mav.extras.locate.locator import Locator
from circnav_mav.extras.locate.place import Place
from circnav_mav.pilot.loop_step import LoopStep
from tests.flight.lockstep import Flight, flight

COMPONENT = 194


@dataclass
class LocatingFlight(Flight):
    """A flight with its locator. locator_frames: (time, frame) sent by the locator. solve_from:
    time at which the locator may compute its first solution, s."""

    locator: Locator | None = None
    locator_frames: list[tuple[float, bytes]] = field(default_factory=list)
    solve_from: float = 0.0
    solve_every: float = 1.0
    _solve_at: float = 0.0

    def _keep(self, step: LoopStep) -> None:
        super()._keep(step)
        locator = self.locator
        assert locator is not None
        for link, source, frames in step.received:
            locator.on_frames(link, source, frames, self.now)
        if (
            self.now >= max(self.solve_from, self._solve_at)
            and (job := locator.job(self.now)) is not None
        ):
            self._solve_at = self.now + self.solve_every
            locator.found(locate(*job))
        for frame in locator.step(self.now):
            self.locator_frames.append((self.now, frame))
            self.vehicle.receive(frame)

    def solve(self) -> Place | NotLocated:
        """Return the locator's solution from all frames received."""
        assert self.locator is not None
        self.locator._solve_at = 0.0
        job = self.locator.job(self.now)
        assert job is not None
        return locate(*job)

    def solve_since(self, since: float) -> Place | NotLocated:
        """Return the locator's solution from the frames received since a time, s."""
        assert self.locator is not None
        for received in (self.locator._track, self.locator._ranges):
            while received and received[0][0] < since:
                received.popleft()
        return self.solve()

    @property
    def messages(self) -> list[tuple[float, mavlink.MAVLink_message]]:
        """Messages of the locator with their times, decoded by pymavlink."""
        parser = mavlink.MAVLink(None)
        return [
            (time, message)
            for time, frame in self.locator_frames
            for message in parser.parse_buffer(frame) or ()
        ]

    def error(self, place: Place) -> np.ndarray:
        """Return the error of the estimated target position, east and north, m."""
        truth = self.vehicle.truth
        latitude, longitude = to_degrees(truth.target_north, truth.target_east)
        east, north = place.plane.to_metres(latitude, longitude)
        there = place.at(self.now)
        return np.array([there.east - east, there.north - north])


def locating_flight(mission: str, *overrides: str, law: str | None = None) -> LocatingFlight:
    """Return a flight of a file in config/ with its locator."""
    flown = flight(mission, *overrides, law=law)
    locator = Locator(COMPONENT, flown.pilot)
    return LocatingFlight(flown.pilot, flown.vehicle, locator=locator)


@dataclass
class Taped(LocatingFlight):
    """A flight that keeps the received frames. Its locator requests positions, but computes no
    place."""

    solve_from: float = 1e9
    tape: list[tuple[float, bytes]] = field(default_factory=list)

    def _keep(self, step: LoopStep) -> None:
        super()._keep(step)
        self.tape += [(self.now, frame) for frame in step.received_frames]

    def write(self, file: Path) -> None:
        """Write a tlog."""
        with file.open("wb") as log:
            for time, frame in self.tape:
                log.write(round((1.75e9 + time) * 1e6).to_bytes(8, "big") + frame)


def taped(mission: str, *overrides: str, law: str | None = None) -> Taped:
    """Return a flight of a file in config/ that can be written as a log."""
    flown = locating_flight(mission, *overrides, law=law)
    return Taped(flown.pilot, flown.vehicle, locator=flown.locator)


def laps(truths: Sequence[Truth]) -> float:
    """Return the number of laps flown around the true target."""
    angles = [atan2(one.north - one.target_north, one.east - one.target_east) for one in truths]
    return abs(float(np.unwrap(angles)[-1]) - angles[0]) / (2 * pi) if angles else 0.0


def nees(flown: LocatingFlight, place: Place) -> float:
    """Return the squared error of a place in units of its covariance (NEES)."""
    error = flown.error(place)
    return float(error @ np.linalg.solve(place.at(flown.now).covariance, error))
