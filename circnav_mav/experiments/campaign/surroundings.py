"""Target, wind and turning of many of the emulator's ideal copters at once. SI, the paper's frame: x east, y north."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from circnav_mav.experiments.batch.world import GAUSS_AT, GAUSS_WEIGHT
from circnav_mav.experiments.campaign.draws import Uniforms, gauss
from circnav_mav.experiments.campaign.plan import Run
from circnav_mav.guidance.air_path import wrap
from circnav_mav.mav.frames import course_from_yaw
from sim.starting import starting_body

Array = Any
GUST_EVERY = 0.1
"""Time, s, from gust to gust: the emulator's."""


class Targets:
    """Where each target is at a time: it keeps its turn rate and its acceleration along its course."""

    def __init__(self, runs: Sequence[Run]) -> None:
        targets = [run.vehicle.target for run in runs]
        self._from = np.array([[t.east_m, t.north_m] for t in targets]).T
        velocity = np.array([t.velocity_east_mps + 1j * t.velocity_north_mps for t in targets])
        self._speed, self._along = np.abs(velocity), np.exp(1j * np.angle(velocity))
        self._push = np.array([t.acceleration_mps2 for t in targets])
        self._turn = -np.radians([t.turn_rate_deg_s for t in targets])  # clockwise there
        self._resting = not (self._speed.any() or self._push.any())

    def at(self, t: float) -> Array:
        """(2, B): the integral of (speed + push t) along a course that turns."""
        if self._resting:
            return self._from
        a = 1j * self._turn
        turning = np.abs(self._turn) * max(t, 1.0) >= 1e-9
        safe = np.where(turning, a, 1.0)
        end = np.exp(a * t)
        curved = ((self._speed + self._push * t) * end - self._speed) / safe - self._push * (end - 1) / safe**2
        run = self._along * np.where(turning, curved, self._speed * t + self._push * t**2 / 2)
        return self._from + np.stack([run.real, run.imag])


class Winds:
    """What carries each vehicle: a steady wind and first-order gusts for the airborne ones, nothing for the others."""

    def __init__(self, runs: Sequence[Run]) -> None:
        winds = [run.vehicle.wind for run in runs]
        carried = np.array([run.vehicle.vehicle.dynamics == "airborne" for run in runs])
        towards = np.radians([w.from_deg for w in winds]) + np.pi
        speed = np.where(carried, [w.speed_mps for w in winds], 0.0)
        self._steady = speed * np.stack([np.sin(towards), np.cos(towards)])
        rms = np.where(carried, [w.gust_rms_mps for w in winds], 0.0)
        self._kept = np.exp(-GUST_EVERY / np.array([w.gust_time_s for w in winds]))
        self._fresh = rms * np.sqrt(1 - self._kept**2)
        self._gust = np.zeros_like(self._steady)
        self._uniforms = Uniforms([run.vehicle.seed for run in runs], "gusts", 2) if rms.any() else None

    @property
    def velocity(self) -> Array:
        """Now, (2, B)."""
        return self._steady + self._gust

    def gust(self) -> None:
        """Called every GUST_EVERY, from the first moment on."""
        if self._uniforms is not None:
            north, east = gauss(*self._uniforms.next())
            self._gust = self._kept * self._gust + self._fresh * np.stack([east, north])


class Vehicles:
    """Position (2, B), heading and turn rate (B,), in exact steps of dt under a held command."""

    def __init__(self, runs: Sequence[Run], dt: float) -> None:
        starts = [starting_body(run.vehicle, (0.0, 0.0)) for run in runs]
        self.position = np.array([[s.east, s.north] for s in starts]).T
        yaw: Array = np.array([s.heading for s in starts])
        self.psi: Array = course_from_yaw(yaw)
        self.turn_rate = np.zeros(len(runs))
        heights = [-s.down - run.vehicle.target.altitude_m for s, run in zip(starts, runs, strict=True)]
        self._height = np.array(heights)
        self._limit = np.radians([run.vehicle.vehicle.max_turn_rate_deg_s for run in runs])
        self._lag = np.array([run.vehicle.vehicle.turn_lag_s for run in runs])
        self._dt = dt
        self._times = (*(float(share) * dt for share in GAUSS_AT), dt)
        late = np.maximum(self._lag, 1e-9)
        self._late = [late * -np.expm1(-t / late) for t in self._times]

    @property
    def yaw(self) -> Array:
        """Heading as the emulator and MAVLink have it, clockwise from north, rad in [-pi, pi)."""
        return wrap(np.pi / 2 - self.psi)

    def slant(self, target: Array) -> Array:
        """Range to a target at (2, B) that keeps its height, m."""
        return np.sqrt(((self.position - target) ** 2).sum(axis=0) + self._height**2)

    def step(self, speed: Array, command: Array, wind: Array) -> None:
        """Fly on for dt: a first-order lag of the turn rate, three-point Gauss quadrature of the exact heading."""
        goal = np.clip(command, -self._limit, self._limit)
        error = self.turn_rate - goal
        moved = np.zeros_like(self.position)
        for t, late, weight in zip(self._times, self._late, GAUSS_WEIGHT, strict=False):
            heading = self.psi + goal * t + error * late
            moved += weight * np.stack([np.cos(heading), np.sin(heading)])
        self.position = self.position + (speed * moved + wind) * self._dt
        turned = goal * self._dt + error * self._late[-1]
        self.psi = self.psi + turned
        self.turn_rate = np.where(self._lag > 0, goal + error * np.exp(-self._dt / np.maximum(self._lag, 1e-9)), goal)
