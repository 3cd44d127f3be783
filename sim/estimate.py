"""What an autopilot's estimate gets wrong of its own motion, and flies by.

Noisy gyros tilt the estimate; gravity then looks like an acceleration, and the GPS takes both back within seconds:
PX4's EKF under SIH, whose gyros are far noisier than real ones, shows 1 deg of roll that comes and goes like an
oscillator of 0.32 rad/s, with 0.2 m/s of velocity along the nose and 1.1 deg of heading. ArduPilot's plane shows 0.17
deg of heading in wind.
"""

import math
from random import Random
from typing import NamedTuple

GRAVITY = 9.80665  # m/s^2
FREQUENCY, DAMPING = 0.32, 0.45  # of the correction by GPS, rad/s
TILT_NOISE = 0.57  # of the gyro about the nose, for each rad of roll error, 1/s^.5; half of it about the wings
HEADING_SHARE, HEADING_TIME = 1.1, 12.0  # of the roll error, s


class EstimateError(NamedTuple):
    """What is believed less what is true: velocity in m/s; the acceleration that the tilt seems to be, in g; rad."""

    velocity: tuple[float, float] = (0.0, 0.0)
    lean: tuple[float, float] = (0.0, 0.0)
    heading: float = 0.0

    def tilt(self, heading: float) -> tuple[float, float]:
        """Of roll and pitch, rad."""
        (north, east), cos, sin = self.lean, math.cos(heading), math.sin(heading)
        return east * cos - north * sin, -(north * cos + east * sin)

    def after(self, dt: float, size: float, heading: float, rng: Random) -> "EstimateError":
        """A step later; size: rms of the roll, rad; heading: of the nose."""
        noise = size * TILT_NOISE * math.sqrt(dt)
        right, forward = rng.gauss(0.0, noise), rng.gauss(0.0, noise / 2)
        cos, sin = math.cos(heading), math.sin(heading)
        fresh = forward * cos - right * sin, forward * sin + right * cos
        kept = math.exp(-dt / HEADING_TIME)
        turned = kept * self.heading + rng.gauss(0.0, size * HEADING_SHARE * math.sqrt(1 - kept * kept))
        moved = tuple(_corrected(*one, dt) for one in zip(self.velocity, self.lean, fresh, strict=True))
        (north, lean_north), (east, lean_east) = moved
        return EstimateError((north, east), (lean_north, lean_east), turned)


def _corrected(velocity: float, lean: float, fresh: float, dt: float) -> tuple[float, float]:
    lean += fresh - FREQUENCY**2 / GRAVITY * velocity * dt
    return velocity + (GRAVITY * lean - 2 * DAMPING * FREQUENCY * velocity) * dt, lean
