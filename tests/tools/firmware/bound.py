"""python -m tests.tools.firmware.bound: lower bounds of the radius error for the flights of
docs/measured.md.

**Linear guidance** (`best`). The velocity error of PX4's estimate is an oscillator of 0.32 rad/s,
and the vehicle follows the estimate. Across the circle it is 0.38 m/s for the emulator's copter,
fitted to firmware, and 0.16 m/s for its plane. Turbulence of 3 moves ArduPilot's plane as gusts of
2.4 m/s that last 3 s. Only ranges at 10 Hz with 0.5 m of noise (0.15 m: UWB) measure these
disturbances. The best linear control (LQG: a Kalman filter and the gains of a quadratic cost) uses
the true plant, delay and disturbance model, which are unknown to a real guidance. RMS radius error
and standard deviation of the turn command are printed for several costs of turning. The last entry
of each line is the same filter with circnav's gains for this delay, which have margins of 6 dB and
45 deg (tests/guidance/test_margins.py).

**LoRa-like ranges** (`lora_radius_error`): radius error of ArduPilot's plane over the last two laps
of 150 s on the circle. It is the Cramer-Rao bound if place, steady wind and airspeed scale are
unknown. Errors of own motion are modeled as a random walk of the drift.

**A bank limit** (`squeezed`): the lap with the least radius error, for a plane in wind that turns
no faster than its limit.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, solve_discrete_are, solve_discrete_lyapunov
from scipy.optimize import nnls

from circnav_mav.guidance.vector_field import drift_gains
from tests.tools.firmware.flight import PRESETS, VEHICLES

STEP = 0.1
FREQUENCY = 0.32
DAMPING = 0.45
"""Oscillator that models the velocity error of PX4's estimate: frequency, rad/s, and damping
ratio."""
LASTS = 3.0
"""Duration of a gust, s."""
CASES = {
    "PX4 copter": (5.0, 0.38, False),
    "PX4 plane": (10.0, 0.16, False),
    "Plane, turbulence 3": (22.0, 2.4, True),
}
"""Speed, m/s; RMS of the disturbance across the circle, m/s; True if the disturbance is a gust,
False for the oscillator."""
COSTS = 1000.0, 300.0, 100.0, 30.0, 10.0, 3.0
"""Cost of the squared turn command, m^2 per (rad/s)^2."""


def best(
    cost: float | None, *, noise: float, delay: float, case: str = "PX4 copter"
) -> tuple[float, float]:
    """Return the RMS radius error, m, and the standard deviation of the turn command, deg/s. cost:
    cost of turning, as in COSTS; None: circnav's gains. noise: range noise, m. delay: delay from
    the command to the vehicle's turn, s. case: one of CASES."""
    speed, across, gust = CASES[case]
    # states: radius error, course error from the tangent, disturbance (m/s) and its rate, then the
    # pending commands
    motion = np.zeros((5, 5))
    motion[0, 1:3] = speed, 1.0
    motion[1, 4] = 1.0
    if gust:
        motion[2, 2] = motion[3, 3] = -1 / LASTS
    else:
        motion[2, 3] = 1.0
        motion[3, 2:4] = -(FREQUENCY**2), -2 * DAMPING * FREQUENCY
    steps = round(delay / STEP)
    n = 4 + steps
    F = np.zeros((n, n))
    G = np.zeros((n, 1))
    H = np.eye(1, n)
    F[:4, :5] = expm(motion * STEP)[:4]
    F[range(4, n - 1), range(5, n)] = G[-1] = 1.0
    Q = 1e-12 * np.eye(n)
    S = np.eye(1) * noise**2
    C = 1e-9 * np.eye(n)
    driven_at, power = (2, 2 / LASTS) if gust else (3, 4 * DAMPING * FREQUENCY**3)
    Q[driven_at, driven_at] = power * across**2 * STEP
    C[0, 0] = 1.0
    P: NDArray[np.float64] = solve_discrete_are(F.T, H.T, Q, S)
    K = P @ H.T / (H @ P @ H.T + S)
    if cost is None:
        gains = drift_gains(speed, delay, 1 / delay)
        heading = float(gains.heading)
        radial = float(gains.radial)
        # The commanded course is -radial e - disturbance/speed, and its rate is fed forward.
        # Pending commands are added to the course.
        L = np.zeros((1, n))
        L[0, :3] = heading * radial, heading + radial * speed, heading / speed + radial
        L[0, 4:] = (heading + radial * speed) * STEP
    else:
        W: NDArray[np.float64] = solve_discrete_are(F, G, C, np.array([[cost]]))
        L = np.linalg.solve(G.T @ W @ G + cost, G.T @ W @ F)
    # joint system of true state and prediction; the command uses the estimate after the range
    # update
    after = np.hstack([K @ H, np.eye(n) - K @ H])
    both = np.vstack([np.hstack([F, 0 * F]) - G @ L @ after, (F - G @ L) @ after])
    by_noise = np.vstack([-G @ L @ K, (F - G @ L) @ K])
    driven = by_noise @ S @ by_noise.T
    driven[:n, :n] += Q
    X: NDArray[np.float64] = solve_discrete_lyapunov(both, driven)
    turn = L @ (after @ X @ after.T + K @ S @ K.T) @ L.T
    return float(np.sqrt(X[0, 0])), float(np.degrees(np.sqrt(turn[0, 0])))


def lora_radius_error(wander: float) -> float:
    """Return the RMS error of the radius that is estimated from LoRa-like ranges on the plane's
    circle, m. wander: power density of the random walk of the drift, m^2/s^3."""
    V = VEHICLES["plane"].speed
    r_d = VEHICLES["plane"].radius
    radio = PRESETS["lora"]
    drifting = radio["drift"]
    variance = radio["noise"] ** 2 / (1 - radio["loss"])
    keep = np.exp(-STEP / radio["drift_s"])
    lap = 2 * np.pi * r_d / V
    # states: position, drift, airspeed scale, slow range error
    P = np.diag([r_d, r_d, 5.0, 5.0, 0.05, drifting]) ** 2
    F = np.eye(6)
    Q = np.diag([0, 0, wander * STEP, wander * STEP, 0, drifting**2 * (1 - keep**2)])
    F[0, 2] = F[1, 3] = STEP
    F[5, 5] = keep
    late = []
    for time in np.arange(0.0, 150.0, STEP):
        x, y = np.cos(V * time / r_d), np.sin(V * time / r_d)
        H = np.array([x, y, 0, 0, 0, 1])
        P -= np.outer(P @ H, H @ P) / (H @ P @ H + variance)
        if time > 150.0 - 2 * lap:
            late.append(H[:2] @ P[:2, :2] @ H[:2])
        F[0, 4], F[1, 4] = -y * V * STEP, x * V * STEP
        P = F @ P @ F.T + Q
    return float(np.sqrt(np.mean(late)))


def squeezed(
    limit: float, *, speed: float = 23.4, wind: float = 5.0, radius: float = 150.0
) -> float:
    """Return the least RMS radius error, m, on a lap with turn rates up to a limit, rad/s. speed:
    true airspeed, m/s. wind: m/s. The turn rate is linear in the radius error, so this is a
    least-distance problem (Lawson and Hanson, ch. 23). The defaults are those of the flown
    ArduPlane: 22 m/s of indicated airspeed are 23.4 m/s true."""
    n = 180
    angle = 2 * np.pi * np.arange(n) / n
    nose = np.sqrt(speed**2 - (wind * np.sin(angle)) ** 2)
    ground = nose + wind * np.cos(angle)
    turn = ground**2 / (radius * nose)
    one = np.eye(n)
    step = 2 * np.pi / n
    bend = one + (np.roll(one, 1, 1) - 2 * one + np.roll(one, -1, 1)) / step**2
    slope = (np.roll(one, 1, 1) - np.roll(one, -1, 1)) / (2 * step)
    # the second term: a course error changes the angle between course and wind constraint on the
    # radius error e: G e >= h
    G = (turn[:, None] * bend + np.gradient(turn, step)[:, None] * slope) / radius
    h = turn - limit
    E = np.vstack([G.T, h])
    f = np.eye(n + 1)[-1]
    rest = E @ nnls(E, f, maxiter=20000)[0] - f
    error = -rest[:-1] / rest[-1]
    return float(np.sqrt(np.average(error**2, weights=1 / ground)))


def main() -> None:
    print("noise m, delay s: RMS m at a turn command of deg/s")
    for case, noise, delay in product(CASES, (0.5, 0.15), (0.4, 0.7, 1.0)):
        figures = (best(cost, noise=noise, delay=delay, case=case) for cost in (*COSTS, None))
        print(
            f"{case}, {noise:4.2f}, {delay:.1f}:",
            ", ".join(f"{rms:.2f} at {turn:.1f}" for rms, turn in figures),
        )
    for wander in (0.0, 1e-4, 3e-4, 1e-3):
        print(
            f"LoRa-like ranges, drift wanders {wander:g} m^2/s^3: {lora_radius_error(wander):.2f} m"
        )
    for limit in (0.215, 0.213, 0.21):
        print(f"plane at 150 m in wind 5, turn limit {limit:.3f} rad/s: {squeezed(limit):.2f} m")


if __name__ == "__main__":
    main()
