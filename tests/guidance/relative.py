"""Relative motions for tests: a vehicle at 15 m/s, 100 m east of its target, known and trusted but where told else; and
one flight with one hypothesis for the filters of many."""

from functools import partial

import numpy as np

from circnav_mav.guidance.estimators.relative_ekf import Hypotheses, Noise
from circnav_mav.guidance.types import RelativeMotion

known = partial(
    RelativeMotion, x=100.0, y=0.0, sigma=1.0, drift_x=0.0, drift_y=0.0, heading=0.0, turn_rate=0.0, airspeed=15.0,
    scale=1.0, trusted=True,
)  # fmt: skip
guessed = partial(known, trusted=False, trial=4)


def hypothesis(x, P):
    """One flight with one hypothesis: state (12,) and covariance (12, 12)."""
    return Hypotheses(np.array(x)[:, None, None], P[:, :, None, None], np.zeros((1, 1)))


def noise(*values):
    """What one hypothesis assumes."""
    return Noise(*(np.array([[value]]) for value in values))
