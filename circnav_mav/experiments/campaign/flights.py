"""Many flights of a campaign at once: the emulator's ideal copter under the batch's guidance, without the messages."""

from collections.abc import Sequence
from dataclasses import replace
from math import ceil
from typing import Any

import numpy as np

from circnav_mav.emulator.config import RandomStart
from circnav_mav.emulator.starting import starting_body
from circnav_mav.experiments.batch.loop import fly
from circnav_mav.experiments.batch.sensors import NO_NOISE, OwnSenses
from circnav_mav.experiments.batch.world import Truth
from circnav_mav.experiments.campaign import emulated
from circnav_mav.experiments.campaign.lockstep import COMPLETED, Flight, Track
from circnav_mav.experiments.campaign.plan import Run
from circnav_mav.guidance.types import SAME_TIME

Array = Any
NEVER = 1 << 40


def opening(run: Run) -> tuple[float, float] | None:
    """Times, s, of the first range that reaches the pilot and of the first setpoint: asked of one real flight beside
    its target, in perfect weather and with a perfect radio, for a batch has no modes and no heartbeats. None if it
    would never be engaged."""
    vehicle, target = run.vehicle, run.vehicle.target
    beside = target.north_m + run.mission.orbit.radius
    clean = vehicle.changed(
        start=vehicle.start.changed(random=RandomStart(), north_m=beside, east_m=target.east_m),
        target=target.changed(velocity_north_mps=0.0, velocity_east_mps=0.0, acceleration_mps2=0.0),
        ranging=vehicle.ranging.changed(preset="gaussian", noise_m=0.0, outlier_fraction=0.0, dropout_fraction=0.0),
    )
    flight = Flight(replace(run, vehicle=clean))
    patience = 2 * run.mission.file.link.wait_s
    heard = None
    while flight.pilot.engaged_at is None and not flight.pilot.done and flight.now < patience:
        flight.step(patience)
        if heard is None and flight.pilot.tracker.accepted:
            heard = flight.now
    steered = flight.pilot.engaged_at
    return None if heard is None or steered is None else (heard, steered)


class Engagement:
    """Which flights are ours: from the first good estimate after the opening, until the mission's time is over or there
    was no good estimate for too long. engaged, ended (B,): steps. stopped (B,): whether it ended for want of ranges."""

    def __init__(self, runs: Sequence[Run], begins: tuple[float, float], dt: float) -> None:
        limits = runs[0].mission.file.limits
        self._heard, self._first = (round(time / dt) for time in begins)
        self._length, self._patience = round(limits.duration_s / dt), round(runs[0].mission.file.link.wait_s / dt)
        self._hold = (limits.hold_s + SAME_TIME) / dt
        self.engaged, self.ended = np.full(len(runs), NEVER), np.full(len(runs), NEVER)
        self._good_at = np.full(len(runs), NEVER)
        self.stopped = np.zeros(len(runs), bool)

    def hears(self, step: int) -> Array:
        """Those that have not ended, from the first range on that reached the pilot."""
        return (step >= self._heard) & (step < self.ended)

    def flies(self, step: int, good: Array) -> Array:
        """Engage, end, and tell who flies."""
        waits = self.engaged == NEVER
        self.engaged = np.where(waits & good & (step >= self._first) & (self.ended == NEVER), step, self.engaged)
        ours = (self.engaged <= step) & (step < self.ended)
        self._good_at = np.where(good, step, self._good_at)
        lost = ours & (step - self._good_at > self._hold)
        over = ours & (step - self.engaged >= self._length)
        given_up = (self.engaged == NEVER) & (self.ended == NEVER) & (step >= self._patience)
        self.stopped |= lost & ~over
        self.ended = np.where(lost | over | given_up, step, self.ended)
        return ours & (step < self.ended)

    def over(self, step: int) -> bool:
        """Whether all have ended."""
        return not (self.ended > step).any()


def time_step(run: Run) -> float:
    """Of the batch that a run is flown in, s: as many to a range as bring it to the pilot's ticks at least."""
    period = 1 / run.vehicle.ranging.rate_hz
    return period / ceil(period * run.mission.file.limits.tick_hz - 1e-9)


def fly_batch(runs: Sequence[Run]) -> list[Track] | None:
    """Fly runs of one group; tracks in their order. None where a real flight shows that they would not be engaged."""
    begins = opening(runs[0])
    if begins is None:
        return None
    dt = time_step(runs[0])
    world, engagement = emulated.world(runs), Engagement(runs, begins, dt)
    radio = emulated.radio(runs, round(1 / runs[0].vehicle.ranging.rate_hz / dt))
    path, turns, cuts = [], [], []

    def record(step: int, true: Truth, command: Array, cut: Array) -> None:
        path.append(true.p.astype(np.float32))
        turns.append(command.astype(np.float32))
        cuts.append(cut)

    fly(world, radio, OwnSenses(NO_NOISE, []), emulated.guidance(runs), engagement, dt, record)
    kept = np.stack(path), np.stack(turns), np.stack(cuts)
    return [_track(run, flight, engagement, dt, *kept) for flight, run in enumerate(runs)]


def _track(run: Run, flight: int, engagement: Engagement, dt: float, path: Array, turns: Array, cuts: Array) -> Track:
    engaged, ended = int(engagement.engaged[flight]), int(engagement.ended[flight])
    if engaged == NEVER:
        outcome, ours = "no ranging: no usable range", slice(0, 0)
    else:
        stopped = engagement.stopped[flight]
        outcome = f"no range for {run.mission.file.limits.hold_s:.1f} s" if stopped else COMPLETED
        ours = slice(engaged, ended)
    time = dt * np.arange(len(path[ours]), dtype=float)
    return Track(
        engine="batch",
        start=(float(path[0, 0, flight]), float(path[0, 1, flight]), starting_body(run.vehicle, (0.0, 0.0)).heading),
        engaged=engaged * dt if engaged != NEVER else None,
        time=time,
        east=path[ours, 0, flight].astype(float),
        north=path[ours, 1, flight].astype(float),
        outcome=outcome,
        turn_time=time,
        turn=turns[ours, flight].astype(float),
        turn_cut=cuts[ours, flight],
    )
