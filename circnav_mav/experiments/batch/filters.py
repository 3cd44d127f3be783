"""The `kalman` estimator for B flights at once: the same equations as the one in flight, which a test compares."""

from typing import Any

import numpy as np

Array = Any
ACCELERATION_SIGMAS = 3.0


class BatchKalman:
    """State (r, r') and covariance per flight; see `circnav_mav.guidance.estimators.range_rate`.

    speed, max_turn_rate and gate are numbers or arrays (B,).
    """

    def __init__(self, speed: Array, max_turn_rate: Array, flights: int, gate: Array = 5.0, restart_after: int = 5):
        self._V, self._omega, self._gate, self._restart_after = speed, max_turn_rate, gate, restart_after
        self.r, self.r_dot = np.zeros(flights), np.zeros(flights)
        self._P = np.zeros((3, flights))
        self._age = np.zeros(flights)
        self._started = np.zeros(flights, bool)
        self._refused = np.zeros(flights, int)
        self._before = np.zeros(flights)
        self.accepted = np.zeros(flights, int)
        """Samples taken in since the filter was last started, (B,)."""

    @property
    def informed(self) -> Array:
        """Whether r' is better known than before the first sample, (B,)."""
        return self._P[2] < self._V**2 / 4

    @property
    def ready(self) -> Array:
        """Whether it may steer, (B,)."""
        return (self.accepted >= 5) & self.informed

    def step(self, dt: float, z: Array, sigma: Array, arrived: Array) -> None:
        """Time passes, and ranges come in where they arrived."""
        self._age += dt
        self.r = self.r + self.r_dot * dt
        if not arrived.any():
            return
        first = arrived & ~self._started
        later = arrived & self._started
        h, rr, rv, vv = self._age, *self._P
        r_before = self.r - self.r_dot * self._age
        bound = self._V**2 / np.maximum(r_before, self._V / self._omega) + self._V * self._omega
        q = (bound / ACCELERATION_SIGMAS) ** 2
        rr, rv, vv = rr + 2 * h * rv + h**2 * vv + q * h**4 / 4, rv + h * vv + q * h**3 / 2, vv + q * h**2
        S = rr + sigma**2
        nu = z - self.r
        taken = later & (nu**2 / S <= self._gate**2)
        gain = np.where(taken, np.stack([rr, rv]) / S, 0.0)
        self._P = np.where(later, np.stack([rr - gain[0] * rr, rv - gain[0] * rv, vv - gain[1] * rv]), self._P)
        self.r, self.r_dot = self.r + gain[0] * nu, self.r_dot + gain[1] * nu
        refused = later & ~taken
        agree = np.abs(z - self._before) <= 2 * self._V * h + self._gate * sigma * np.sqrt(2)
        self._refused = np.where(refused, np.where((self._refused > 0) & ~agree, 1, self._refused + 1), self._refused)
        self._refused[taken] = 0
        self._before = np.where(refused, z, self._before)
        restart = first | (refused & (self._refused >= self._restart_after))
        self.accepted = np.where(restart, 1, self.accepted + taken)
        self.r, self.r_dot = np.where(restart, z, self.r), np.where(restart, 0.0, self.r_dot)
        fresh = np.stack([sigma**2, np.zeros_like(sigma), np.zeros_like(sigma) + self._V**2 / 2])
        self._P = np.where(restart, fresh, self._P)
        self._refused[restart] = 0
        self._started |= arrived
        self._age = np.where(arrived, 0.0, self._age)
