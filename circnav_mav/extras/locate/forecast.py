"""Expected accuracy of a locator, computed before the flight by the estimator of the flight."""

from math import pi

import numpy as np

from circnav_mav.extras.locate.estimator import AT_REST, Knowledge, Problem, Ranges, Track
from circnav_mav.extras.locate.locator import HEIGHT_SIGMA
from circnav_mav.mission.mission import Mission


def position_sigma(mission: Mission, seconds: float) -> float | None:
    """Return the standard deviation per axis of the beacon's place after this time on the circle,
    m, or None if no fit is found.

    The estimator gets positions and ranges without errors. Its covariance then contains only the
    stated sigmas of GPS, height and ranges.
    """
    orbit = mission.orbit
    ranging = mission.file.ranging
    height = mission.file.orbit.height_above_target_m
    lap = 2 * pi * orbit.radius / orbit.speed

    def at(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        angle = 2 * pi * time / lap
        return orbit.radius * np.cos(angle), orbit.radius * np.sin(angle)

    # 0.25: time between two positions, s, as requested in flight.
    positions = np.arange(0.0, seconds + 1.0, 0.25)
    times = np.arange(0.0, seconds, 1 / ranging.rate_hz)
    track = Track(positions, *at(positions), np.full(positions.size, height or 0.0))
    slant = np.full(times.size, float(np.hypot(orbit.radius, height or 0.0)))
    ranges = Ranges(times, slant, np.full(times.size, ranging.sigma_m))
    known = Knowledge(up=0.0, up_sigma=HEIGHT_SIGMA)
    # Do not call `locate` here: it also decides if these ranges determine the place, and the plan's
    # figures would jump at the limits of its decisions.
    problem = Problem(track, ranges, known)
    prior = AT_REST[0].prior(known)
    fit = problem.fit(np.zeros((1, prior.size)), prior[None])
    try:
        covariance = problem.covariance(fit.x[0], prior)
    except np.linalg.LinAlgError:
        return None
    return float(np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
