"""The closed loop of a batch: world, radio, senses, guidance."""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from circnav_mav.experiments.batch.estimators import Seen
from circnav_mav.experiments.batch.guidance import Guidance
from circnav_mav.experiments.batch.sensors import OwnSenses, Radio
from circnav_mav.experiments.batch.world import Truth, World

Array = Any
ATTITUDE_EVERY = 0.05
"""Time, s, from one heading to the next by which a turn gain is learnt: that of ATTITUDE, as asked for."""


class Authority(Protocol):
    """Which flights are under our control at a step, masks (B,)."""

    def hears(self, step: int) -> Array:
        """Whose ranges reach us."""
        ...

    def flies(self, step: int, good: Array) -> Array:
        """Who is steered by us, after an estimate that is good for some."""
        ...

    def over(self, step: int) -> bool:
        """Whether all have ended."""
        ...


class Always(Authority):
    """From the first step to the last."""

    def __init__(self, flights: int, steps: int) -> None:
        self._all, self._steps = np.ones(flights, bool), steps

    def hears(self, step: int) -> Array:
        return self._all

    def flies(self, step: int, good: Array) -> Array:
        return self._all

    def over(self, step: int) -> bool:
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
