"""`auto` and `drift` for many flights at once: estimators and laws of the flight, asked when the pilot asks them."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from circnav_mav.analysis.batch.filters import BatchKalman
from circnav_mav.analysis.campaign.own_paths import LONGEST, OwnPaths
from circnav_mav.analysis.campaign.plan import Run
from circnav_mav.analysis.campaign.seekers import Seekers
from circnav_mav.analysis.campaign.steering import Circles
from circnav_mav.analysis.campaign.turn_gains import ATTITUDE_EVERY
from circnav_mav.core.auto import at_start, hand_over, merged
from circnav_mav.core.drift_law import DriftGains, drift, drift_gains, mirrored, orbit_turn_rate
from circnav_mav.core.estimators.drift_bank import Stage
from circnav_mav.core.guidance import LONGEST_STEP
from circnav_mav.core.laws import LAWS, Kind

Array = Any


class RelativeSteering:
    """A law on relative motion fed by the `auto` estimator. All arrays (B,); turn rates counter-clockwise positive.

    beyond: flights in which something happened that no batch follows; they must be flown alone.
    """

    def __init__(self, runs: Sequence[Run]) -> None:
        circles = self._circles = Circles(runs)
        settings = [run.mission.estimation for run in runs]
        gates = np.array([s.gate for s in settings])
        self._needed = np.array([s.min_samples for s in settings])
        self._kalman = BatchKalman(circles.V, circles.limit, len(runs), gate=gates)
        self._paths, self._seekers = OwnPaths(circles.V), Seekers(circles.V, gates)
        self._gains = _gains(runs)
        self._lag: Array = np.array([run.mission.law.lag for run in runs])
        self._law = LAWS["auto"].function
        self._tries = np.array([LAWS[run.mission.law.name].kind is Kind.AUTO for run in runs])
        self._handover = at_start(len(runs))
        self._steered_at = np.full(len(runs), np.nan)
        self._broken = np.zeros(len(runs), bool)
        self.sure_at = np.full(len(runs), -np.inf)

    @property
    def speed(self) -> Array:
        """What each vehicle is told to fly, m/s."""
        return self._circles.V

    @property
    def ready(self) -> Array:
        """Whether the estimate may steer."""
        return (self._kalman.informed & (self._kalman.accepted >= self._needed)) | self._seekers.ready

    @property
    def beyond(self) -> Array:
        """Who must be flown alone."""
        return self._broken | self._seekers.beyond

    def see(self, now: float, dt: float, z: Array, sigma: Array, arrived: Array) -> None:
        """Let dt pass, s, and take in the ranges that arrived `now`; `sure_at` is when one was last believed."""
        before = self._kalman.accepted
        self._kalman.step(dt, z, sigma, arrived)
        if not arrived.any():
            return
        here, heard = self._paths.at(now), arrived & self._paths.known
        self._broken |= heard & (here.age > LONGEST)
        refused = self._seekers.observe(here, z, sigma, heard)
        by_range = self._kalman.accepted != before
        believed = np.where(refused | ~self._seekers.ready, by_range, True)
        self.sure_at = np.where(arrived & believed, now, self.sure_at)

    def move(self, now: float, heading: Array, turn_rate: Array, who: Array) -> None:
        """The attitudes of some flights (mask) that do as they are told."""
        self._paths.move(now, heading, turn_rate, who)

    def turn(self, now: float, holding: Array, ours: Array) -> Array:
        """The turn rates wanted at a time, s, within the limit; those that hold fly the circle's own.

        ours: whom the law steers unless they hold.
        """
        c, here = self._circles, self._paths.at(now)
        self._broken |= ours & (here.age > LONGEST)
        at, trusted = self._seekers.at(here)
        found, tracks = self._seekers.stage != Stage.EMPTY, self._seekers.stage == Stage.TRACK
        p, d, psi, rate = mirrored((at.x, at.y), at.drift, here.heading, here.turn_rate, c.sense)
        V = np.where(found, np.maximum(at.airspeed, 0.1 * c.V), c.V)
        by_range = self._law(self._kalman.r, self._kalman.r_dot, V=c.V, r_d=c.fed, k=-c.k)
        by_bank = drift(p, d, psi, rate, V=V, r_d=c.r_d, max_turn_rate=c.limit, gains=self._gains)
        steers = ours & ~holding
        since = np.where(steers & ~np.isnan(self._steered_at), np.minimum(now - self._steered_at, LONGEST_STEP), 0.0)
        self._steered_at = np.where(steers, now, self._steered_at)
        after = hand_over(
            self._handover, since, trusted=found & trusted,
            favourite=np.where(found & ~tracks & self._tries, self._seekers.favourite, -1),
            by_range=by_range, by_bank=np.where(found, by_bank, by_range), limit=c.limit,
        )  # fmt: skip
        self._handover = merged(steers, after, self._handover)
        round_it = orbit_turn_rate(d, psi + self._lag * rate, V=V, r_d=c.r_d)
        hold = np.where(found & trusted, round_it, c.V / c.r_d)
        return c.sense * np.clip(np.where(holding, hold, self._handover.command), -c.limit, c.limit)

    def through_gain(self, turn: Array, gain: Array) -> Array:
        """What to tell vehicles that turn at `gain` times what they are told."""
        return self._circles.through_gain(turn, gain)


def _gains(runs: Sequence[Run]) -> DriftGains:
    """The gains of the drift law of each flight, arrays (B,). A vehicle in lockstep answers with its next attitude."""
    circles = [(run.mission.orbit, run.mission.law.lag) for run in runs]
    each = [drift_gains(orbit.speed, orbit.radius, lag, delay=ATTITUDE_EVERY) for orbit, lag in circles]
    return DriftGains(*(np.array([getattr(gains, field.name) for gains in each]) for field in fields(DriftGains)))
