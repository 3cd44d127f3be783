"""Synthetic tracks and ranges for the estimator, made with numpy alone."""

import numpy as np

from circnav_mav.extras.locate.estimator import Knowledge, Ranges, Track
from circnav_mav.extras.locate.place import Plane

PLANE = Plane(47.3, 8.5)
KNOWN = Knowledge(up=400.0, up_sigma=20.0)
"""Prior of the target's height, m. All tracks here are level at 440 m, 40 m above the target. A
target at 480 m fits the ranges as well. This prior rejects 480 m; the default sigma of 50 m would
not."""
V = 15.0


def gps_error(
    times: np.ndarray, rng: np.random.Generator, size: float, time: float = 100.0
) -> np.ndarray:
    """Return a GPS error as a first-order Gauss-Markov process, m, (n, 2)."""
    kept = np.exp(-np.diff(times) / time)
    out = [rng.normal(0, size, 2)]
    for share in kept:
        out.append(share * out[-1] + rng.normal(0, size * np.sqrt(1 - share**2), 2))
    return np.array(out)


def circles(
    radii: tuple[float, ...] = (100.0,),
    *,
    seed: int = 1,
    laps: float = 1.0,
    noise: float = 0.5,
    bias: float = 0.0,
    height: float = 40.0,
    gps: float = 1.5,
    target: tuple[float, float] = (120.0, -60.0),
    velocity: tuple[float, float] = (0.0, 0.0),
    outliers: float = 0.0,
    delay: float = 0.0,
) -> tuple[Track, Ranges, np.ndarray]:
    """Return a track of laps around a target at 15 m/s, with each radius in turn, and the target's
    final position (east, north, m). delay: delay added to the stamps of the positions, s."""
    rng = np.random.default_rng(seed)
    time = [0.0]
    around = [0.0]
    far = [radii[0]]
    for radius in radii:
        for _ in range(int(laps * 2 * np.pi * radius / V * 10)):
            time.append(time[-1] + 0.1)
            around.append(around[-1] + V / radius * 0.1)
            far.append(radius)
    t = np.array(time)
    angle = np.array(around)
    r = np.array(far)
    there = np.array(target) + np.outer(t, velocity)
    true = there + np.column_stack([r * np.cos(angle), r * np.sin(angle)])
    measured = true + (gps_error(t, rng, gps) if gps else 0.0)
    slant = (
        np.sqrt(((true - there) ** 2).sum(axis=1) + height**2) + bias + rng.normal(0, noise, len(t))
    )
    far_off = rng.random(len(t)) < outliers
    slant[far_off] += rng.uniform(10, 60, far_off.sum())
    shown = slice(None, None, 2)
    track = Track(
        t[shown] + delay,
        measured[shown, 0],
        measured[shown, 1],
        np.full(len(t[shown]), 400.0 + height),
    )
    inside = t <= t[shown][-1]
    return track, Ranges(t[inside], slant[inside], np.full(inside.sum(), noise)), there[inside][-1]
