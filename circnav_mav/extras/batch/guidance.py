"""The guidance of the flight for B flights: an estimator, the step, the circle's own turn without ranges, turn gain;
and its closed loop with world, radio and senses."""

from collections.abc import Callable
from typing import Any

import numpy as np

from circnav_mav.extras.batch.estimators import Auto, Estimator, FullInformation, Kalman, Seen, Unicycle, merged
from circnav_mav.extras.batch.sensors import OwnSenses, Radio
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
"""What the benchmark flies: law and estimator."""
SHORTEST = 0.05
"""Shortest lag, s, that the gains are made for."""


def estimator(name: str, settings: EstimatorSettings, flights: int) -> Estimator:
    """An estimator by name. The settings may hold arrays (B,) for `kalman` alone."""
    if name == "kalman":
        return Kalman(settings, flights)
    if name == "unicycle":
        return Unicycle(settings, flights)
    if name == "truth":
        return FullInformation(settings.speed, flights)
    return Auto(settings, flights, float(np.max(settings.speed)))


class Guidance:
    """Estimator and law of B flights. lag: of the vehicles' turn as the missions have it, s. stale: oldest range that
    may steer, s. answers: the vehicles' true lag, s, which a flight learns within some turns and a batch knows.
    learns (B,): whose turn gain is learnt in flight; the others keep `turn_gain`."""

    def __init__(
        self, settings: StepSettings, estimator: Estimator, flights: int, *, lag: Array, stale: float,
        answers: float = 0.4, turn_gain: Array = 1.0, learns: Array = False,
    ) -> None:  # fmt: skip
        self.settings, self.estimator, self._stale = settings, estimator, stale
        self._state = StepState()
        self._pending, self._pending_turn = Pending(0.0, lag), PendingTurn()
        self._lag, self._learns = lag, learns + np.zeros(flights, bool)
        self._response = Response(0.0, answers, 1 / max(answers, SHORTEST), learnt=True)
        self._gain = TurnGain(*(value + np.zeros(flights) for value in TurnGain(gain=turn_gain)))
        self._sure_at, self._now = np.full(flights, -np.inf), 0.0
        self._told: Array = np.zeros(flights)

    @property
    def good(self) -> Array:
        """Whose estimate may steer: ready, and of a range that is not stale, (B,)."""
        return self.estimator.ready & (self._now - self._sure_at <= self._stale + SAME_TIME)

    def see(self, now: float, seen: Seen, true: Truth) -> None:
        """What is reported and heard at a time, s."""
        self._now = now
        self.estimator.observe(seen, true)
        self._sure_at = np.where(self.estimator.taken, now, self._sure_at)
        if self.settings.law.flies_relative_motion:
            pending = self._pending_turn.at(now, self._response, seen.turn_rate)
            self._pending = pending._replace(most=self._gain.gain * self.settings.limit)

    def feel(self, now: float, heading: Array, flies: Array) -> None:
        """Learn the turn gain from a heading (B,)."""
        if (flies & self._learns).any():
            after = learn(self._gain, lag=self._lag, time=now, heading=heading, command=self._told)
            self._gain = merged(flies & self._learns, after, self._gain)

    def command(self, steers: Array) -> tuple[Array, Array]:
        """The commanded turn rates (B,) and whether the limit cut them: the law's for those who steer, the circle's own
        for the others."""
        e, cfg = self.estimator, self.settings
        after, wanted = step(self._state, cfg, Inputs(self._now, e.r, e.r_dot, self._pending, e.relative))
        self._state = merged(steers, after, self._state)
        held = hold(cfg, e.relative, self._pending)
        told: Any = compensate_turn_gain(merged(steers, wanted, held), cfg.limit, self._gain.gain)
        self._told = told.turn_rate
        if cfg.law.flies_relative_motion:
            self._pending_turn.command(self._now, told.turn_rate * self._gain.gain)
        return told.turn_rate, told.saturated


ATTITUDE_EVERY = 0.05
"""Time, s, from one heading to the next by which a turn gain is learnt: that of ATTITUDE, as asked for."""


class Authority:
    """Which flights are under our control at a step, masks (B,): here all, from the first step to the last."""

    def __init__(self, flights: int, steps: int) -> None:
        self._all, self._steps = np.ones(flights, bool), steps

    def hears(self, step: int) -> Array:
        """Whose ranges reach us."""
        return self._all

    def flies(self, step: int, good: Array) -> Array:
        """Who is steered by us, after an estimate that is good for some."""
        return self._all

    def over(self, step: int) -> bool:
        """Whether all have ended."""
        return step >= self._steps


Record = Callable[[int, Truth, Array, Array], None]
"""Is told the truth at a step of this number, what is commanded, and whether that was cut."""


def fly(
    world: World, radio: Radio, senses: OwnSenses, guidance: Guidance, authority: Authority, dt: float, record: Record
) -> None:
    """Fly all to their ends, in steps of dt, s."""
    step, feels = 0, max(1, round(ATTITUDE_EVERY / dt))
    flies = authority.flies(0, np.zeros(world.psi.shape, bool))
    while not authority.over(step):
        now = step * dt
        true = world.truth
        z, sigma, arrived = radio.measure(world.r, step, dt)
        rate = radio.measure_rate(world.r_dot, step, dt)
        psi, turn_rate, airspeed = senses.report(world.psi, world.turn_rate, world.airframe.speed, now)
        felt = senses.feel(world.psi, world.velocity, now)
        arrived &= authority.hears(step)
        seen = Seen(dt if step else 0.0, psi, turn_rate, airspeed, z, sigma, arrived, flies, felt, rate)
        guidance.see(now, seen, true)
        before, good = flies, guidance.good
        flies = authority.flies(step, good)
        if step % feels == 0:
            guidance.feel(now, psi, before & flies)
        command, cut = guidance.command(flies & good)
        record(step, true, command, cut)
        world.step(dt, command, flies)
        step += 1
