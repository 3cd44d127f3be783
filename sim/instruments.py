"""What the autopilot believes of heading, turn and airspeed: the truth, bent as [sensors] says."""

import math
from random import Random

from sim.body import Body
from sim.config import Sensors


class Instruments:
    """Compass bias and drift, gyro scale, airspeed noise. The vehicle flies by the truth, only its reports are bent."""

    def __init__(self, config: Sensors, seed: int) -> None:
        self._config = config
        self._rng = Random(f"{seed}:instruments")

    def body(self, true: Body, time: float) -> Body:
        """The body as the attitude estimate shows it."""
        c = self._config
        if not (c.heading_bias_deg or c.heading_drift_deg_s):
            return true
        error = math.radians(c.heading_bias_deg + c.heading_drift_deg_s * time)
        return true._replace(heading=math.remainder(true.heading + error, math.tau))

    def rates(self, true: Body) -> tuple[float, float, float]:
        """p, q, r as the gyros read them."""
        p, q, r = true.body_rates()
        return p * self._config.gyro_scale, q * self._config.gyro_scale, r * self._config.gyro_scale

    def airspeed(self, shown: float) -> float:
        noise = self._config.airspeed_noise_mps
        return shown + self._rng.gauss(0.0, noise) if noise > 0 else shown
