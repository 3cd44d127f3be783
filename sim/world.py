"""The air and the target: what the vehicle cannot change."""

import math
from dataclasses import dataclass

from sim.config import Target, Wind


@dataclass(frozen=True)
class TargetMotion:
    """Where the target is at a time: NED metres."""

    config: Target

    def at(self, time: float) -> tuple[float, float, float]:
        c = self.config
        return c.north_m + c.velocity_north_mps * time, c.east_m + c.velocity_east_mps * time, -c.altitude_m


@dataclass(frozen=True)
class Air:
    """The wind as a velocity over the ground, north and east, m/s."""

    north: float
    east: float

    @staticmethod
    def steady(config: Wind) -> "Air":
        towards = math.radians(config.from_deg) + math.pi
        return Air(config.speed_mps * math.cos(towards), config.speed_mps * math.sin(towards))

    @property
    def velocity(self) -> tuple[float, float]:
        return self.north, self.east
