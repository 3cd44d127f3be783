"""Expected RMS error of the radius, from range noise, steady errors, and gusts. The effect of the
gusts is computed with a linear model near the circle.

    e' = u + g,   u' = h (c - u),   c = -(b e_hat + g_hat),   z = e + white noise

e: radius error, m.
z: measurement of e, m.
u: radial speed caused by the heading, m/s.
c: commanded u, m/s.
g: radial gust, m/s, first order with the emulator's correlation time (the first-order form of the
    Dryden model).
b: gain `radial` of the drift law (`vector_field.drift_gains`) times the speed, 1/s.
h: gain `heading` of the drift law, 1/s.
e_hat, g_hat: estimates of a steady-state Kalman filter of (e, g) with the range noise.

The RMS follows from the Lyapunov equation of the closed loop (linear-quadratic-Gaussian control;
Anderson and Moore, "Optimal Control", 1990).

The five coefficients of this file are fitted to 110 random missions of
`tests.tools.bench.bench_plan` with the law `auto`. The missions have planes (15 to 27 m/s), copters
(3 to 8 m/s) and rovers (1.5 to 5 m/s). Ranges have a noise of 0.1 to 2 m at 4 to 20 Hz. Gusts are
up to 2 m/s.
"""

from math import hypot, sqrt

import numpy as np
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

from circnav_mav.guidance.margin import LINK
from circnav_mav.guidance.vector_field import drift_gains
from circnav_mav.guidance.vehicle_model import MEASUREMENT_DELAY
from circnav_mav.mission.mission import Mission

GUST_TIME = 3.0
"""Correlation time of gusts, s: default of the emulator."""
STEADY = 0.0055
"""Steady radius error divided by the speed, s, of vehicles that do not bank. It is caused by errors
of heading and airspeed."""
STEADY_BANKED = 0.0091
"""Steady radius error divided by the speed, s, of vehicles that bank: they also side-slip."""
ACTS = 0.46
"""Share of a gust that acts on the radius. It is below 1, because accelerometers measure the onset
of a gust."""
ACTS_ON_HELD = 0.049
"""Share of a gust that acts on the radius if the autopilot holds the speed over the ground."""


def radius_rms(mission: Mission, gust: float) -> float:
    """Return the expected RMS of the radius error on the mission's first circle, m. gust: RMS per
    axis, m/s."""
    orbit = mission.orbit
    ranging = mission.file.ranging
    delay = mission.file.vehicle.turn_lag_s
    banks = any(one.fixed_wing for one in mission.vehicles)
    holds_ground_speed = any(one.holds_ground_speed for one in mission.vehicles)
    noise = ranging.sigma_m**2 / ranging.rate_hz
    # 0.147: effective bandwidth of the radius error in calm air, 1/s: variance of this error
    # divided by the power density of the range noise.
    calm = 0.147 * noise + ((STEADY_BANKED if banks else STEADY) * orbit.speed) ** 2
    felt = (
        0.0
        if mission.file.vehicle.kind == "rover"
        else gust * (ACTS_ON_HELD if holds_ground_speed else ACTS)
    )
    # 1e-4: gust below which gusts are ignored, m/s: without gusts the linear model is singular.
    if felt <= 1e-4:
        return sqrt(calm)
    gains = drift_gains(
        orbit.speed, delay + LINK + (MEASUREMENT_DELAY if banks else 0.0), 1 / max(delay, 1e-3)
    )
    return hypot(
        sqrt(calm), linear_rms(noise, felt, float(gains.radial) * orbit.speed, float(gains.heading))
    )


def linear_rms(noise: float, gust: float, radial: float, heading: float) -> float:
    """Return the RMS of e in the linear model, m.

    noise: power density of range noise, m^2 s.
    gust: m/s.
    radial, heading: loop gains b and h, 1/s.
    """
    drift_psd = 2 * gust**2 / GUST_TIME
    model = np.array([[0.0, 1.0], [0.0, -1 / GUST_TIME]])
    P = solve_continuous_are(
        model.T, np.array([[1.0], [0.0]]), np.diag([0.0, drift_psd]), np.array([[noise]])
    )
    gain_e = P[0, 0] / noise
    gain_g = P[1, 0] / noise
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
