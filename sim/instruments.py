"""The autopilot's measurements of its own motion: the truth with the errors of [sensors]."""

import math
from random import Random

from .body import Body, Vector, within
from .config import Sensors

# RMS noise of the sent values of PX4's SIH per axis, m/s^2 and rad/s
ACCEL_OF_SIH = (0.36, 1.15, 0.99)
GYRO_OF_SIH = (0.084, 0.042, 0.0185)
PHASES = (0.0, 2.1, 4.2)  # phases of the vibration in the three axes, rad


class Instruments:
    """Errors of compass, gyros, airspeed and accelerometers. They affect only the reported
    values."""

    def __init__(self, config: Sensors, seed: int, sih: bool) -> None:
        """sih: True to use the noise of PX4's simulator SIH if the file gives none."""
        self._config = config
        accel = config.accel_noise_mps2
        gyro = config.gyro_noise_deg_s
        self._accel_noise = (ACCEL_OF_SIH if sih else (0.2,) * 3) if accel is None else (accel,) * 3
        self._gyro_noise = (
            (GYRO_OF_SIH if sih else (0.0,) * 3) if gyro is None else (math.radians(gyro),) * 3
        )
        self._gyro_rng = Random(f"{seed}:gyro")
        self._rng = Random(f"{seed}:instruments")
        self._imu_rng = Random(f"{seed}:imu")
        drawn = [self._imu_rng.uniform(0.05, 0.1) * self._imu_rng.choice((-1, 1)) for _ in range(3)]
        size = config.accel_bias_mps2
        self._bias = drawn if size is None else [math.copysign(size, value) for value in drawn]
        self.imu_state = config.imu
        self._last_imu: tuple[Vector, Vector] | None = None

    def body(self, true: Body, time: float) -> Body:
        """Return the body with the errors of estimated attitude and velocity."""
        c = self._config
        north, east = true.error.velocity
        wrong = true.error.heading or any(true.error.lean)
        if not (c.heading_bias_deg or c.heading_drift_deg_s or wrong):
            return true
        roll, pitch = true.error.tilt(true.heading)
        error = math.radians(c.heading_bias_deg + c.heading_drift_deg_s * time) + true.error.heading
        return true._replace(
            roll=true.roll + roll,
            pitch=true.pitch + pitch,
            heading=math.remainder(true.heading + error, math.tau),
            velocity_north=true.velocity_north + north,
            velocity_east=true.velocity_east + east,
        )

    def rates(self, true: Body) -> Vector:
        """Return the measured body rates p, q, r."""
        rolling, pitching, turning = (
            rate * self._config.gyro_scale
            + (self._gyro_rng.gauss(0.0, noise) if noise > 0 else 0.0)
            for rate, noise in zip(true.body_rates(), self._gyro_noise, strict=True)
        )
        return rolling, pitching, turning

    def airspeed(self, shown: float) -> float:
        noise = self._config.airspeed_noise_mps
        return shown + self._rng.gauss(0.0, noise) if noise > 0 else shown

    def imu(self, true: Body, specific_force: Vector, time: float) -> tuple[Vector, Vector]:
        """Return the readings of accelerometers (m/s^2) and gyros (rad/s): forward, right, down."""
        if self.imu_state == "frozen" and self._last_imu is not None:
            return self._last_imu
        (p, q, r), shaken = self.rates(true), self._config.accel_vibration_mps2
        # Vibration of a motor. A stream of 50 Hz contains the alias of this vibration.
        x, y, z = (
            value
            + bias
            + self._imu_rng.gauss(0.0, noise)
            + shaken * math.sin(math.tau * 73.0 * time + phase)
            for value, bias, noise, phase in zip(
                specific_force, self._bias, self._accel_noise, PHASES, strict=True
            )
        )
        if self.imu_state == "rotated":
            x, y, p, q = y, -x, q, -p
        if self.imu_state == "clipped":
            # 8.0: limit of a clipped axis, m/s^2. It is below 1 g, so that the vertical axis clips
            # in level flight.
            x, y, z = (within(value, 8.0) for value in (x, y, z))
        self._last_imu = (x, y, z), (p, q, r)
        return self._last_imu
