"""One flight of a campaign in lockstep, as in `circnav fly`: pilot and emulated vehicle exchange
MAVLink bytes."""

from dataclasses import dataclass

import numpy as np
from circnav_sim.vehicle import Truth, Vehicle
from numpy.typing import NDArray

from circnav_mav.extras.campaign.plan import Run
from circnav_mav.pilot import Ending, Pilot, TickRecord
from circnav_mav.runlog.metrics import Column
from circnav_mav.runtime.lockstep import Lockstep
from circnav_mav.runtime.runner import run_step

COMPLETED = "completed"
EXIT_TIME = 60.0
"""Time allowed for the exit, s, after the mission's duration and its waiting times."""


@dataclass(frozen=True, slots=True)
class FlightResult:
    """Result of a flight: the true path under control, relative to the target, and the outcome.

    start: position east and north (m) of the target and heading (rad, clockwise from north) at time
        zero.
    engaged: time of the engagement, s, or None.
    time: time since the engagement for each point of the path, s.
    east, north: path relative to the target, m.
    outcome: "completed", or the reason of another end.
    turn_time: time since the engagement for each turn command, s.
    turn: commanded turn rate, rad/s.
    turn_cut: True for each command that the turn-rate limit cut.
    """

    start: tuple[float, float, float]
    engaged: float | None
    time: Column
    east: Column
    north: Column
    outcome: str
    turn_time: Column
    turn: Column
    turn_cut: NDArray[np.bool_]


class Flight:
    """A running flight. ticks: ticks with a turn command."""

    def __init__(self, run: Run) -> None:
        self.pilot = Pilot(run.mission)
        self.vehicle = Vehicle(run.vehicle)
        self.ticks = list[TickRecord]()
        self._clock = Lockstep(self.vehicle)
        self._links = self._clock.links(ranging_apart=self.pilot.settings.ranging_apart)

    @property
    def now(self) -> float:
        """Simulated time, s."""
        return self._clock.now()

    def step(self, until: float) -> None:
        """Advance to the next action of the pilot, at most to `until`."""
        self._clock.advance(min(self.pilot.scheduler.due, until))
        run_step(self.pilot, self._links, self._clock, self.now)
        self.ticks += (tick for tick in self.pilot.take_records() if tick.turn_rate is not None)


def fly_lockstep(run: Run) -> FlightResult:
    """Fly one run to its end."""
    flight = Flight(run)
    pilot = flight.pilot
    mission = flight.pilot.mission
    limits = run.mission.file.limits
    start = flight.vehicle.truth
    truths = list[Truth]()
    due = 0.0
    waits = 2 * run.mission.file.link.wait_s
    until = limits.duration_s + waits + limits.outage + EXIT_TIME
    while not pilot.done and flight.now < until:
        flight.step(until)
        ours = mission.engaged_at is not None and mission.outcome is None
        if (
            ours
            and flight.now >= due - 1e-9
            and flight.now - (mission.engaged_at or 0.0) < limits.duration_s - 1e-6
        ):
            truths.append(flight.vehicle.truth)
            due = flight.now + limits.tick
    ended = mission.outcome
    outcome = (
        COMPLETED
        if ended and ended.ending is Ending.COMPLETED
        else ended.reason
        if ended
        else "no end"
    )
    turns = np.array(
        [(tick.time, tick.turn_rate, tick.saturated) for tick in flight.ticks], float
    ).reshape(-1, 3)
    path = np.array(
        [(t.time, t.east - t.target_east, t.north - t.target_north) for t in truths]
    ).reshape(-1, 3)
    return FlightResult(
        start=(start.east - start.target_east, start.north - start.target_north, start.heading),
        engaged=mission.engaged_at,
        time=path[:, 0] - (mission.engaged_at or 0.0),
        east=path[:, 1],
        north=path[:, 2],
        outcome=outcome,
        turn_time=turns[:, 0] - (mission.engaged_at or 0.0),
        turn=turns[:, 1],
        turn_cut=turns[:, 2] > 0,
    )
