"""The paper's examples by formulations that stand in this file and share nothing with the product but the laws. The
three examples as `circnav paper` flies them are in tests/experiments/test_paper.py.

Target at the origin, V = 1, r_d = 10.
"""

import numpy as np
import pytest

from circnav_mav.guidance.laws import smooth, switching

V, R_D = 1.0, 10.0


def starts(seed):
    """x, y and heading of 120 vehicles, 10 .. 20 m above the target."""
    x, y, psi = np.random.default_rng(seed).uniform(size=(3, 120))
    return x * 10, y * 10 + 10, psi * 2 * np.pi


@pytest.mark.parametrize(("fed", "reached"), [(R_D, 10.98684113), (8.66025404, 10.0000001)], ids=["1", "2"])
def test_law_1_reaches_the_radius_of_the_example_to_seven_digits(fed, reached):
    """In (r, theta_b), theta_b from the line to the target to the heading, by fourth-order Runge-Kutta."""

    def rates(state):
        r, theta = state
        r_dot = -V * np.cos(theta)
        return np.array([r_dot, smooth(r, r_dot, V=V, r_d=fed, k=0.01) + V * np.sin(theta) / r])

    (x, y, psi), step = starts(4), 0.05
    state = np.array([np.hypot(x, y), (psi - np.arctan2(-y, -x)) % (2 * np.pi)])
    for _ in range(6000):
        a = rates(state)
        b = rates(state + step / 2 * a)
        c = rates(state + step / 2 * b)
        state = state + step / 6 * (a + 2 * b + 2 * c + rates(state + step * c))
    assert np.abs(state[0] - reached).max() < 3e-7


@pytest.mark.parametrize(
    ("step", "least", "most"),
    [
        (0.01, (10 - 1e-3, 10.0), (10.0, 10 + 1e-3)),
        (0.1, (9.97, 10.0), (10.0, 10.03)),
        (1.0, (9.6, 10.0), (10.5, 11.7)),
    ],
)
def test_law_2_circles_clockwise_as_near_as_its_turns_are_held_short(step, least, most):
    """Within 3e-4 m of 10, within 0.023 m, and between 9.8 and 11.5, says the independent simulation behind the paper's
    page: why `check` warns of a slow sensor."""
    (x, y, psi), ranges, swept = starts(9), [], 0.0
    for i in range(round(200 / step)):
        r, angle = np.hypot(x, y), np.arctan2(y, x)
        turn = switching(r, V * (np.cos(psi) * x + np.sin(psi) * y) / r, V=V, r_d=R_D, k=0.12) * step
        chord = V * step * np.sinc(turn / 2 / np.pi)  # exact: an arc of angle `turn` has this chord at half the angle
        x, y, psi = x + chord * np.cos(psi + turn / 2), y + chord * np.sin(psi + turn / 2), psi + turn
        if i * step >= 150:
            ranges.append(r)
            swept = swept + np.angle(np.exp(1j * (np.arctan2(y, x) - angle)))
    assert least[0] < np.min(ranges) < least[1]
    assert most[0] < np.max(ranges) < most[1]
    assert swept.max() < -np.pi
