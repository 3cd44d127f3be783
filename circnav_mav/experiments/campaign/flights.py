"""Many flights of a campaign at once: the emulator's ideal copter in the emulator's world, without the messages."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from circnav_mav.experiments.campaign.engage import Opening, opening
from circnav_mav.experiments.campaign.lockstep import COMPLETED
from circnav_mav.experiments.campaign.plan import Run
from circnav_mav.experiments.campaign.radio import Radio
from circnav_mav.experiments.campaign.steering import Steering
from circnav_mav.experiments.campaign.surroundings import GUST_EVERY, Targets, Vehicles, Winds
from circnav_mav.experiments.campaign.track import Track
from circnav_mav.experiments.campaign.turn_gains import ATTITUDE_EVERY, TurnGains
from circnav_mav.guidance.step import AT_LIMIT
from circnav_mav.guidance.types import SAME_TIME
from circnav_mav.mav.frames import course_from_yaw

Array = Any
NEVER = 1 << 40
GUIDED = "GUIDED"
"""The mode that the copter is flown in."""
MODE_SHOWN_EVERY = 0.25
"""Time, s, between the heartbeats in which the vehicle shows its mode."""


class Batch:
    """B flights under way. They share what `batchable.group` names; everything else is each flight's own."""

    def __init__(self, runs: Sequence[Run], begins: Opening) -> None:
        file = runs[0].mission.file
        rate = runs[0].vehicle.ranging.rate_hz
        self.dt = time_step(runs[0])
        self._every = round(1 / rate / self.dt)
        self._gust_every = round(GUST_EVERY / self.dt)
        self._stale, self._hold = file.limits.stale_s, file.limits.hold_s
        self._length = round(file.limits.duration_s / self.dt)
        self._patience = round(file.link.wait_s / self.dt)
        self._first, self._heard = (round(time / self.dt) for time in (begins.steered, begins.heard))
        self._shown_every = max(1, round(MODE_SHOWN_EVERY / self.dt))
        self._asks = runs[0].vehicle.start.mode != GUIDED
        self._shown = np.full(len(runs), NEVER)
        self._vehicles, self._targets, self._winds = Vehicles(runs, self.dt), Targets(runs), Winds(runs)
        self._radio = Radio(runs)
        self._steering = Steering(runs)
        self._attitude_every = max(1, round(ATTITUDE_EVERY / self.dt))
        self._gains = TurnGains(runs, self._attitude_every * self.dt)
        self._told, self._cut = np.zeros(len(runs)), np.zeros(len(runs), bool)
        self._limit = np.array([run.mission.orbit.max_turn_rate for run in runs])
        self._tick = round(1 / file.limits.tick_hz / self.dt)
        self._due = np.zeros(len(runs), int)
        self.headings = self._vehicles.yaw
        self._z = self._sigma = np.zeros(len(runs))
        self.engaged, self.ended = np.full(len(runs), NEVER), np.full(len(runs), NEVER)
        self._holds_since = np.full(len(runs), NEVER)
        self.stopped = np.zeros(len(runs), bool)
        self.path: list[Array] = []
        self.turns: list[Array] = []
        self.cuts: list[Array] = []

    def fly(self) -> None:
        """All flights to their ends."""
        step = 0
        while (self.ended > step).any():
            self._step(step)
            step += 1

    def _step(self, step: int) -> None:
        now, steering = step * self.dt, self._steering
        target = self._targets.at(now)
        if step % self._gust_every == 0:
            self._winds.gust()
        if step % self._every == 0:
            self._z, self._sigma, arrived = self._radio.measure(self._vehicles.slant(target), now)
        else:
            arrived = np.zeros(len(self._due), bool)
        arrived &= (step >= self._heard) & (step < self.ended)
        steering.see(now, self.dt if step else 0.0, self._z, self._sigma, arrived)
        acts = (steering.sure_at == now) | (step >= self._due)  # a fresh range, or a tick after the last step
        self._due = np.where(acts, step + self._tick, self._due)
        holding = ~steering.ready | (now - steering.sure_at > self._stale + SAME_TIME)
        self._engage(step, acts, holding)
        flies = acts & (self.engaged <= step) & (step < self.ended)
        begins = flies & holding & (self._holds_since == NEVER)
        self._holds_since = np.where(begins, step, np.where(flies & ~holding, NEVER, self._holds_since))
        lost = flies & ((step - self._holds_since) * self.dt > self._hold + SAME_TIME)
        over = flies & (step - self.engaged >= self._length)
        self.stopped |= lost & ~over
        self.ended = np.where(lost | over, step, self.ended)
        self.path.append((self._vehicles.position - target).astype(np.float32))
        ours, alive = self.engaged <= step, step < self.ended
        if step % self._attitude_every == 0:
            flown = (self.engaged < step) & alive
            heading = course_from_yaw(_single(self._vehicles.yaw))  # as an ATTITUDE tells it
            self._gains.feel(now, heading, self._told, flown)
        turn = steering.turn(now, holding, ours & acts & alive)
        wanted = steering.through_gain(turn, self._gains.now)
        cut = np.maximum(np.abs(turn), np.abs(wanted)) >= AT_LIMIT * self._limit
        self._told = np.where(ours & acts, wanted, self._told)
        self._cut = np.where(ours & acts, cut, self._cut)
        self.turns.append(self._told.astype(np.float32))
        self.cuts.append(self._cut)
        speed, wind = np.where(ours, steering.speed, 0.0), np.where(ours, self._winds.velocity, 0.0)
        self._vehicles.step(_single(speed), _single(self._told), wind)

    def _engage(self, step: int, acts: Array, holding: Array) -> None:
        """The vehicle becomes ours when there is a range to steer by and it shows the mode; it is asked for the mode as
        soon as there first is one."""
        next_heartbeat = step + 1 + (self._first - step - 1) % self._shown_every
        asked = acts & ~holding & (self._shown == NEVER)
        self._shown = np.where(asked, max(next_heartbeat, self._first) if self._asks else self._first, self._shown)
        ours = acts & ~holding & (step >= self._shown)
        self.engaged = np.where((self.engaged == NEVER) & ours & (self.ended == NEVER), step, self.engaged)
        if step >= self._patience:
            self.ended = np.where((self.engaged == NEVER) & (self.ended == NEVER), step, self.ended)


def time_step(run: Run) -> float:
    """Of the batch that a run is flown in, s: from range to range and tick to tick."""
    return 1 / max(run.vehicle.ranging.rate_hz, run.mission.file.limits.tick_hz)


def fly_batch(runs: Sequence[Run]) -> list[Track] | None:
    """Fly runs of one group; tracks in their order. None where a real flight shows that they would not be engaged."""
    begins = opening(runs[0])
    if begins is None:
        return None
    batch = Batch(runs, begins)
    batch.fly()
    path, turns, cuts = (np.stack(kept) for kept in (batch.path, batch.turns, batch.cuts))
    return [
        _track(batch, path[:, :, flight], turns[:, flight], cuts[:, flight], flight, run)
        for flight, run in enumerate(runs)
    ]


def _single(value: Array) -> Array:
    """What the single precision of a message leaves of a number."""
    return value.astype(np.float32).astype(float)


def _track(batch: Batch, path: Array, turn: Array, cut: Array, flight: int, run: Run) -> Track:
    engaged, ended = int(batch.engaged[flight]), int(batch.ended[flight])
    if engaged == NEVER:
        outcome = "no ranging: no usable range"
    else:
        hold = run.mission.file.limits.hold_s
        outcome = f"no range for {hold:.1f} s" if batch.stopped[flight] else COMPLETED
    flown = path[engaged:ended].astype(float) if engaged != NEVER else np.empty((0, 2))
    time = batch.dt * np.arange(len(flown), dtype=float)
    return Track(
        engine="batch",
        start=(float(path[0, 0]), float(path[0, 1]), float(batch.headings[flight])),
        engaged=engaged * batch.dt if engaged != NEVER else None,
        time=time,
        east=flown[:, 0],
        north=flown[:, 1],
        outcome=outcome,
        turn_time=time,
        turn=turn[engaged : engaged + len(flown)].astype(float),
        turn_cut=cut[engaged : engaged + len(flown)],
    )
