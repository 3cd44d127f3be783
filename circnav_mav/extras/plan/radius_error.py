"""Expected RMS error of the radius: a linear model of the radial channel near the circle.

    e' = u + g,   u' = h (c - u),   c = -(b e_hat + g_hat),   z = e + white noise

e: radius error, m. u: radial speed that the heading makes, m/s. g: radial gust, first order with the emulator's
correlation time (the first-order form of the Dryden model). b, h: gains of the drift law (`vector_field.drift_gains`).
e_hat, g_hat: steady-state Kalman filter of (e, g) with the range noise. The RMS follows from the Lyapunov equation of
the closed loop (linear-quadratic-Gaussian control; Anderson and Moore, "Optimal Control", 1990).

UNSTEADY is fitted on three flights of the emulator in calm air. SEEN is fitted on the cell "gusts 1.5, with
accelerations" of extras/bench/BENCHMARK.md. CARRIED is an estimate.
"""

from math import sqrt

import numpy as np
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

from circnav_mav.guidance.margin import LINK
from circnav_mav.guidance.turn_answer import MEASUREMENT_DELAY
from circnav_mav.guidance.vector_field import drift_gains
from circnav_mav.mission.mission import Mission

GUST_TIME = 3.0
"""Correlation time of gusts, s: default of the emulator."""
UNSTEADY = 0.002
"""Apparent gust in calm air, as a share of V: errors of heading and airspeed, and slip. Fitted: plane 0.162
m, copter 0.064 m, rover 0.049 m flown with ranges of 0.5 m at 10 Hz, within 4 % of the model."""
SEEN = 0.6
"""Share of a gust that acts on the radius, because the accelerometers measure the onset of the gust. Fitted: 0.578 m
flown in 1.5 m/s."""
CARRIED = 0.15
"""Share of a gust that displaces a copter whose autopilot holds its speed over the ground. Estimated from the drag of
the vehicle (0.185 1/s) and the time in which its autopilot compensates (1 to 2 s)."""


def radius_rms(mission: Mission, gust: float) -> float:
    """Return the expected RMS of the radius error on the mission's first circle, m. gust: RMS per axis, m/s."""
    orbit, ranging, delay = mission.orbit, mission.file.ranging, mission.file.vehicle.turn_lag_s
    holds_ground_speed = any(one.ground_speed_sigma is not None for one in mission.vehicles)
    late = MEASUREMENT_DELAY if any(one.banks for one in mission.vehicles) else 0.0
    gains = drift_gains(orbit.speed, delay + LINK + late, 1 / max(delay, 1e-3))
    rolls = mission.file.vehicle.kind == "rover"
    gust *= 0.0 if rolls else CARRIED if holds_ground_speed else SEEN
    return linear_rms(
        noise=ranging.sigma_m**2 / ranging.rate_hz,
        gust=float(np.hypot(gust, UNSTEADY * orbit.speed)),
        radial=float(gains.radial) * orbit.speed,
        heading=float(gains.heading),
    )


def linear_rms(noise: float, gust: float, radial: float, heading: float) -> float:
    """Return the RMS of e in the linear model, m. noise: power density of the ranges, m^2 s. gust: m/s. radial,
    heading: loop gains b and h, 1/s."""
    drift_psd = 2 * gust**2 / GUST_TIME
    model = np.array([[0.0, 1.0], [0.0, -1 / GUST_TIME]])
    P = solve_continuous_are(model.T, np.array([[1.0], [0.0]]), np.diag([0.0, drift_psd]), np.array([[noise]]))
    gain_e, gain_g = P[0, 0] / noise, P[1, 0] / noise
    # states: e, g, u, e_hat, g_hat
    loop = np.array([
        [0.0, 1.0, 1.0, 0.0, 0.0],
        [0.0, -1 / GUST_TIME, 0.0, 0.0, 0.0],
        [0.0, 0.0, -heading, -heading * radial, -heading],
        [gain_e, 0.0, 1.0, -gain_e, 1.0],
        [gain_g, 0.0, 0.0, -gain_g, -1 / GUST_TIME],
    ])  # fmt: skip
    drive = np.diag([0.0, drift_psd, 0.0, 0.0, 0.0])
    drive[3:, 3:] += noise * np.outer([gain_e, gain_g], [gain_e, gain_g])
    return sqrt(float(solve_continuous_lyapunov(loop, -drive)[0, 0]))
