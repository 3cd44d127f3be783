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
        second = Random(f"{seed}:imu2")
        self._second_bias = [math.copysign(value, second.uniform(-1, 1)) for value in self._bias]
        self.level_bias = 0.0  # bias forward and right of every accelerometer, m/s^2
        self._drift = config.heading_drift_deg_s
        self._drifted = config.heading_bias_deg, 0.0  # heading error, deg, and its time, s
        self.imu_state = config.imu
        self._last: dict[int, tuple[Vector, Vector]] = {}

    def body(self, true: Body, time: float) -> Body:
        """Return the body with the errors of estimated attitude and velocity."""
        north, east = true.error.velocity
        wrong = true.error.heading or any(true.error.lean)
        error = self.heading_error(time) + true.error.heading
        if not (error or wrong):
            return true
        roll, pitch = true.error.tilt(true.heading)
        return true._replace(
            roll=true.roll + roll,
            pitch=true.pitch + pitch,
            heading=math.remainder(true.heading + error, math.tau),
            velocity_north=true.velocity_north + north,
            velocity_east=true.velocity_east + east,
        )

    def heading_error(self, time: float) -> float:
        """Return the error of the compass, rad."""
        error, since = self._drifted
        return math.radians(error + self._drift * (time - since))

    def drift(self, rate: float, time: float) -> None:
        """Let the heading error grow at a rate, deg/s, from its present value."""
        self._drifted = math.degrees(self.heading_error(time)), time
        self._drift = rate

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

    def imu(
        self, true: Body, specific_force: Vector, time: float, index: int
    ) -> tuple[Vector, Vector]:
        """Return the readings of accelerometers (m/s^2) and gyros (rad/s): forward, right, down.

        index: 0 for the first IMU, 1 for the second.
        """
        if self.imu_state == "frozen" and index in self._last:
            return self._last[index]
        (p, q, r), shaken = self.rates(true), self._config.accel_vibration_mps2
        # A motor vibrates with 73 Hz. In a stream of 50 Hz this appears as a slower vibration
        # (alias).
        x, y, z = (
            value
            + bias
            + self._imu_rng.gauss(0.0, noise)
            + shaken * math.sin(math.tau * 73.0 * time + phase)
            for value, bias, noise, phase in zip(
                specific_force,
                self._second_bias if index else self._bias,
                self._accel_noise,
                PHASES,
                strict=True,
            )
        )
        x, y = x + self.level_bias, y + self.level_bias
        if self.imu_state == "rotated":
            x, y, p, q = y, -x, q, -p
        if self.imu_state == "clipped":
            # 8.0: limit of a clipped axis, m/s^2. It is below 1 g, so that the vertical axis clips
            # in level flight.
            x, y, z = (within(value, 8.0) for value in (x, y, z))
        # The gyros of ArduPilot's first IMU continue if its accelerometer fails (SIM_ACC_FAIL_MSK).
        if index == 0 and self.imu_state == "first_frozen" and index in self._last:
            x, y, z = self._last[index][0]
        elif index == 0 and self.imu_state == "first_zero":
            x, y, z = 0.0, 0.0, 0.0
        self._last[index] = (x, y, z), (p, q, r)
        return self._last[index]
