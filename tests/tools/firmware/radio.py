"""The ranging radio: slant ranges to the hidden target with a seeded error model, sent as
DISTANCE_SENSOR."""

from collections import deque
from math import cos, exp, hypot, radians, sin, sqrt

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from tests.tools.firmware.bench import Bench, Truth

UP = 24
"""Orientation field of the radio's DISTANCE_SENSOR, which no other sensor of the vehicle uses."""
FROM_OUTSIDE = 2.5
"""Default distance of the start from the target, radii."""
LONGEST_CM = 65000
UNKNOWN_COVARIANCE = 255
SENSOR_ID = 7
SX1280 = np.array(
    [(0.0, 4.4), (50.0, 57.6), (100.0, 103.0), (150.0, 148.0), (200.0, 201.0), (250.0, 253.0)]
)
"""Measured pairs of true and reported range of an SX1280, m. Longer ranges extrapolate the last
segment."""
NAME = b"RANGE"


class Radio:
    """A radio on the vehicle. The target's initial bearing from the vehicle's nose is that of the
    flight. The target may move."""

    def __init__(self, bench: Bench, home_altitude: float) -> None:
        self._bench = bench
        self._flight = bench.flight
        self._random = np.random.default_rng(self._flight.seed)
        self._next = 0.0
        self._waiting = deque[tuple[float, float, float]]()
        self._wander = self._flight.drift * self._random.standard_normal()
        self.sent = self.lost = 0
        self.altitude = home_altitude + self._flight.target_height
        here = bench.truth
        bearing = bench.truth.yaw + radians(self._flight.start_bearing)
        self._began = here.time
        away = self._flight.start_range or FROM_OUTSIDE * self._flight.radius
        self.stand(
            *self._flight.target_at
            or (here.north + away * cos(bearing), here.east + away * sin(bearing))
        )

    def stand(self, north: float, east: float) -> None:
        """Set the initial position of the target, m."""
        self._north, self._east = north, east

    def target(self, time: float) -> tuple[float, float]:
        """Return the position of the target, north and east, m."""
        way = self._flight.target_speed * (time - self._began)
        return self._north + way, self._east

    def tick(self, truth: Truth) -> None:
        """Measure and send the ranges that are due."""
        flight = self._flight
        period = 1.0 / self._flight.rate
        if truth.time >= self._next:
            self._next = max(self._next + period, truth.time - period)
            measured = self._measured(truth, period)
            if self._random.random() < flight.loss:
                self.lost += 1
            else:
                self._waiting.append((truth.time + flight.delay, truth.time, measured))
        while self._waiting and self._waiting[0][0] <= truth.time:
            _, stamp, measured = self._waiting.popleft()
            self._send(truth.time if flight.delay else stamp, measured)

    def _measured(self, truth: Truth, period: float) -> float:
        flight = self._flight
        draw = self._random.standard_normal
        if flight.drift:
            keep = exp(-period / flight.drift_s)
            self._wander = keep * self._wander + flight.drift * sqrt(1 - keep * keep) * draw()
        north, east = self.target(truth.time)
        slant = hypot(truth.north - north, truth.east - east, truth.altitude - self.altitude)
        slant = reported(slant) if flight.sx1280 else slant
        slant += self._wander + flight.noise * draw()
        if self._random.random() < flight.outliers:
            slant += (
                flight.outlier_size
                * self._random.random()
                * (1 if self._random.random() < 0.8 else -1)
            )
        return max(slant, 0.0)

    def _send(self, stamp: float, measured: float) -> None:
        self.sent += 1
        if self._flight.sx1280:
            named = mavlink.MAVLink_named_value_float_message(round(stamp * 1000), NAME, measured)
            self._bench.send(named, self._bench.radio)
            return
        centimetres = round(measured * 100)
        quality = 100 if centimetres <= LONGEST_CM else 1
        message = mavlink.MAVLink_distance_sensor_message(
            round(stamp * 1000),
            20,
            LONGEST_CM,
            min(centimetres, 65535),
            mavlink.MAV_DISTANCE_SENSOR_RADAR,
            SENSOR_ID,
            UP,
            UNKNOWN_COVARIANCE,
            0.0,
            0.0,
            (0.0,) * 4,
            quality,
        )
        self._bench.send(message, self._bench.radio)


def reported(true: float) -> float:
    """Return the range that an SX1280 reports for a true range, m, without noise."""
    at = min(max(int(np.searchsorted(SX1280[:, 0], true, side="right")) - 1, 0), len(SX1280) - 2)
    (x0, y0), (x1, y1) = SX1280[at : at + 2]
    return float(y0 + (true - x0) * (y1 - y0) / (x1 - x0))
