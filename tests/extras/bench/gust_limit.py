"""Bound of the radius error in gusts under any linear guidance.

The radial channel is a linear-quadratic-Gaussian problem:

    e' = v + w,   w' = -w/T + white noise,   v'' = (u - v')/tau,   z = e + white noise

e = r - r_d (m), w is the radial gust (m/s), v the radial speed from the heading (m/s), and u/V the
commanded turn rate beyond the circle's own (rad/s). Bearing and model are exact, so the result is a
bound for range-only flight, not a prediction. Source: separation theorem, Anderson and Moore,
"Optimal Control" (1990).

    python -m tests.extras.bench.gust_limit
"""

from typing import Any

import numpy as np
from scipy.linalg import expm, solve_discrete_are, solve_discrete_lyapunov

Array = Any
GUST = 1.5
GUST_TIME = 10.0
LAG = 0.4
DT = 0.05
V = 15.0
"""GUST: standard deviation of the gusts, m/s. GUST_TIME: their correlation time, s. LAG: lag of the
turn, s. DT: time step, s. V: airspeed, m/s."""


def limit(effort: float, sigma: float = 0.5) -> tuple[float, float, float]:
    """Return the RMS of e (m) with ranges only and with full information, and the RMS turn rate
    (rad/s) with ranges only. Uses the best linear guidance for the cost e^2 + effort (u m/s^2)^2
    and ranges of noise sigma (m)."""
    F, G, W = _discrete()
    H = np.array([[1.0, 0, 0, 0]])
    R = sigma**2
    P = solve_discrete_are(F.T, H.T, W + 1e-12 * np.eye(4), [[R]])
    K = P @ H.T / (P[0, 0] + R)
    X = solve_discrete_are(F, G, H.T @ H + 1e-10 * np.eye(4), [[effort]])
    L = np.linalg.solve(effort + G.T @ X @ G, G.T @ X @ F)
    together = np.block([[F, -G @ L], [K @ H @ F, F - G @ L - K @ H @ F]])
    disturbed = np.vstack([np.eye(4), K @ H])
    measured = np.vstack([np.zeros((4, 1)), K])
    S = solve_discrete_lyapunov(together, disturbed @ W @ disturbed.T + R * measured @ measured.T)
    informed = solve_discrete_lyapunov(F - G @ L, W)
    turn = np.sqrt((L @ S[4:, 4:] @ L.T)[0, 0]) / V
    return float(np.sqrt(S[0, 0])), float(np.sqrt(informed[0, 0])), float(turn)


def _discrete() -> tuple[Array, Array, Array]:
    """Return transition, input and noise of one step, for the state (e, w, v, v')."""
    A = np.zeros((4, 4))
    A[0, 1] = A[0, 2] = A[2, 3] = 1.0
    A[1, 1], A[3, 3] = -1 / GUST_TIME, -1 / LAG
    augmented = np.zeros((5, 5))
    augmented[:4, :4], augmented[3, 4] = A, 1 / LAG
    step = expm(augmented * DT)
    at = (np.arange(100) + 0.5) * DT / 100
    q = np.diag([0.0, 2 * GUST**2 / GUST_TIME, 0.0, 0.0])
    W = np.mean([expm(A * s) @ q @ expm(A * s).T for s in at], axis=0) * DT
    return step[:4, :4], step[:4, 4:], W


if __name__ == "__main__":
    for effort in (0.5, 0.1, 1e-2, 1e-3, 1e-4):
        by_range, informed, turn = limit(effort)
        ratio = f"{by_range / informed:.1f} times"
        print(
            f"RMS turn {turn:.2f} rad/s: by range {by_range:.2f} m, informed {informed:.2f} m,"
            f" {ratio}"
        )
