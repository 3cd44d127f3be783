"""Guidance of B flights, and its closed loop with world, radio and sensors.

As in the flight stack it has an estimator, the guidance step, the turn of the circle while ranges are missing, and the
learned turn gain.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from circnav_mav.extras.batch.estimators import Auto, Estimator, FullInformation, Kalman, Measurements, Unicycle, merged
from circnav_mav.extras.batch.sensors import MotionSensors, Radio
from circnav_mav.extras.batch.world import Truth, World
from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.table import default_estimator
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.maths import Array
from circnav_mav.guidance.pending_turn import Pending, PendingTurn
from circnav_mav.guidance.step import Inputs, StepSettings, StepState, compensate_turn_gain, hold, step
from circnav_mav.guidance.turn_gain import TurnGain, learn
from circnav_mav.guidance.turn_response import Response
from circnav_mav.guidance.types import SAME_TIME

POLICIES: dict[str, tuple[str, str]] = {law: (law, default_estimator(law)) for law in reversed(LAWS)} | {
    "feedforward+unicycle": ("feedforward", "unicycle"),
    "smooth+unicycle": ("smooth", "unicycle"),
    "full information": ("drift", "truth"),
}
"""Policies of the benchmark: law and estimator."""
SHORTEST = 0.05
"""Smallest lag in the settling rate of the turn response, s."""


def estimator(name: str, settings: EstimatorSettings, flights: int) -> Estimator:
    """Return an estimator by name. The settings may contain arrays (B,) for `kalman` only."""
    if name == "kalman":
        return Kalman(settings, flights)
    if name == "unicycle":
        return Unicycle(settings, flights)
    if name == "truth":
        return FullInformation(settings.speed, flights)
    return Auto(settings, flights, float(np.max(settings.speed)))


class Guidance:
    """Estimator and law of B flights.

    lag: turn lag of the vehicles as in the missions, s. stale: largest age of a range that may steer, s. true_lag: the
    vehicles' true turn lag, s; a flight learns it within some turns, a batch is given it. learns (B,): True if the turn
    gain is learned in flight; otherwise it stays `turn_gain`.
    """

    def __init__(
        self, settings: StepSettings, estimator: Estimator, flights: int, *, lag: Array, stale: float,
        true_lag: float = 0.4, turn_gain: Array = 1.0, learns: Array = False,
    ) -> None:  # fmt: skip
        self.settings, self.estimator, self._stale = settings, estimator, stale
        self._state = StepState()
        self._pending, self._pending_turn = Pending(0.0, lag), PendingTurn()
        self._lag, self._learns = lag, learns + np.zeros(flights, bool)
        self._response = Response(0.0, true_lag, 1 / max(true_lag, SHORTEST))
        self._gain = TurnGain(*(value + np.zeros(flights) for value in TurnGain(gain=turn_gain)))
        self._good_at, self._now = np.full(flights, -np.inf), 0.0
        self._commanded: Array = np.zeros(flights)

    @property
    def good(self) -> Array:
        """True if the estimate may steer, (B,): it is ready and its newest range is not stale."""
        return self.estimator.ready & (self._now - self._good_at <= self._stale + SAME_TIME)

    def observe(self, now: float, measured: Measurements, true: Truth) -> None:
        """Update the estimate with the measurements of one step. now: its time, s."""
        self._now = now
        self.estimator.observe(measured, true)
        self._good_at = np.where(self.estimator.taken, now, self._good_at)
        if self.settings.law.flies_relative_motion:
            pending = self._pending_turn.at(now, self._response, measured.turn_rate)
            self._pending = pending._replace(most=self._gain.gain * self.settings.limit)

    def learn_turn_gain(self, now: float, heading: Array, flies: Array) -> None:
        """Learn the turn gain from the headings (B,)."""
        if (flies & self._learns).any():
            after = learn(self._gain, lag=self._lag, time=now, heading=heading, command=self._commanded)
            self._gain = merged(flies & self._learns, after, self._gain)

    def command(self, steers: Array) -> tuple[Array, Array]:
        """Return the commanded turn rates (B,), and True where the limit cut them.

        Flights in the mask `steers` follow the law. The others keep the turn of the circle.
        """
        e, cfg = self.estimator, self.settings
        after, wanted = step(self._state, cfg, Inputs(self._now, e.r, e.r_dot, self._pending, e.relative))
        self._state = merged(steers, after, self._state)
        held = hold(cfg, e.relative, self._pending)
        compensated: Any = compensate_turn_gain(merged(steers, wanted, held), cfg.limit, self._gain.gain)
        self._commanded = compensated.turn_rate
        if cfg.law.flies_relative_motion:
            self._pending_turn.command(self._now, compensated.turn_rate * self._gain.gain)
        return compensated.turn_rate, compensated.saturated


ATTITUDE_EVERY = 0.05
"""Interval of the headings used to learn the turn gain, s: that of ATTITUDE, as requested in flight."""


class Authority:
    """Masks (B,) of the flights under control at a step. In this base class: all flights, at every step."""

    def __init__(self, flights: int, steps: int) -> None:
        self._all, self._steps = np.ones(flights, bool), steps

    def receives(self, step: int) -> Array:
        """Return the mask of the flights that receive ranges at this step."""
        return self._all

    def flies(self, step: int, good: Array) -> Array:
        """Return the mask of the flights under control. good (B,): True if the estimate may steer."""
        return self._all

    def over(self, step: int) -> bool:
        """True if all flights have ended."""
        return step >= self._steps


Record = Callable[[int, Truth, Array, Array], None]
"""Callback(step, truth, command, saturated)."""


def fly(
    world: World,
    radio: Radio,
    senses: MotionSensors,
    guidance: Guidance,
    authority: Authority,
    dt: float,
    record: Record,
) -> None:
    """Fly all flights to their ends, in steps of dt (s)."""
    step, steps_per_heading = 0, max(1, round(ATTITUDE_EVERY / dt))
    flies = authority.flies(0, np.zeros(world.psi.shape, bool))
    while not authority.over(step):
        now = step * dt
        true = world.truth
        z, sigma, arrived = radio.measure(world.r, step, dt)
        rate = radio.measure_rate(world.r_dot, step, dt)
        psi, turn_rate, airspeed = senses.report(world.psi, world.turn_rate, world.airframe.speed, now)
        change = senses.velocity_change(world.psi, world.velocity, now)
        arrived &= authority.receives(step)
        since = dt if step else 0.0
        measured = Measurements(since, psi, turn_rate, airspeed, z, sigma, arrived, flies, change, rate)
        guidance.observe(now, measured, true)
        before, good = flies, guidance.good
        flies = authority.flies(step, good)
        if step % steps_per_heading == 0:
            guidance.learn_turn_gain(now, psi, before & flies)
        command, cut = guidance.command(flies & good)
        record(step, true, command, cut)
        world.step(dt, command, flies)
        step += 1
