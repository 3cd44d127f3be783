"""What the autopilot measures and believes of its own motion: the truth, bent as [sensors] says."""

import math
from random import Random

from .body import Body, Vector
from .config import Sensors

CLIP_MPS2 = 8.0  # below 1 g, so that the vertical axis shows it in level flight
VIBRATION_HZ = 73.0  # of a motor; a stream of 50 Hz sees its alias
PHASES = (0.0, 2.1, 4.2)  # rad, of the vibration in the three axes


class Instruments:
    """Compass bias and drift, gyro scale, airspeed noise, accelerometer errors. Only what is reported is bent."""

    def __init__(self, config: Sensors, seed: int) -> None:
        self._config = config
        self._rng = Random(f"{seed}:instruments")
        self._imu_rng = Random(f"{seed}:imu")
        drawn = [self._imu_rng.uniform(0.05, 0.1) * self._imu_rng.choice((-1, 1)) for _ in range(3)]
        size = config.accel_bias_mps2
        self._bias = drawn if size is None else [math.copysign(size, value) for value in drawn]
        self.imu_state = config.imu
        self._last_imu: tuple[Vector, Vector] | None = None

    def body(self, true: Body, time: float) -> Body:
        """The body as the estimate of attitude and velocity shows it."""
        c = self._config
        north, east = true.velocity_error
        if not (c.heading_bias_deg or c.heading_drift_deg_s or north or east):
            return true
        error = math.radians(c.heading_bias_deg + c.heading_drift_deg_s * time)
        return true._replace(
            heading=math.remainder(true.heading + error, math.tau),
            velocity_north=true.velocity_north + north,
            velocity_east=true.velocity_east + east,
        )

    def rates(self, true: Body) -> Vector:
        """p, q, r as the gyros read them."""
        p, q, r = true.body_rates()
        return p * self._config.gyro_scale, q * self._config.gyro_scale, r * self._config.gyro_scale

    def airspeed(self, shown: float) -> float:
        noise = self._config.airspeed_noise_mps
        return shown + self._rng.gauss(0.0, noise) if noise > 0 else shown

    def imu(self, true: Body, specific_force: Vector, time: float) -> tuple[Vector, Vector]:
        """Accelerometers in m/s^2 and gyros in rad/s, forward, right, down."""
        if self.imu_state == "frozen" and self._last_imu is not None:
            return self._last_imu
        c, (p, q, r) = self._config, self.rates(true)
        shaken = c.accel_vibration_mps2
        x, y, z = (
            value
            + bias
            + self._imu_rng.gauss(0.0, c.accel_noise_mps2)
            + shaken * math.sin(math.tau * VIBRATION_HZ * time + phase)
            for value, bias, phase in zip(specific_force, self._bias, PHASES, strict=True)
        )
        if self.imu_state == "rotated":
            x, y, p, q = y, -x, q, -p
        if self.imu_state == "clipped":
            x, y, z = (max(-CLIP_MPS2, min(CLIP_MPS2, value)) for value in (x, y, z))
        self._last_imu = (x, y, z), (p, q, r)
        return self._last_imu
