"""A level track: the ranges fit a target above it as well as one below it."""

import numpy as np
import pytest

from circnav_mav.extras.locate.estimator import Knowledge, Ranges, Track, locate
from circnav_mav.extras.locate.place import Place
from tests.extras.locate.worlds import PLANE


def walked(height: float, seed: int) -> Place:
    """Return the place of a tag at a height above a level track, from a radio of 5 cm and RTK
    positions on a robot."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 180.0, 0.25)
    east = 6.0 * np.sin(0.11 * t) + 2.0 * np.sin(0.31 * t + 1.0)
    north = 5.0 * np.cos(0.083 * t) + 1.5 * np.sin(0.23 * t)
    up = rng.normal(0, 0.015, len(t))
    r = (
        np.sqrt((east - 3.0) ** 2 + (north - 6.0) ** 2 + (up - height) ** 2)
        + rng.normal(0, 0.05, len(t))
        + 0.05
    )
    track = Track(t, east + rng.normal(0, 0.01, len(t)), north + rng.normal(0, 0.01, len(t)), up)
    known = Knowledge(up=float(up.min()), gps_sigma=0.02, bias_sigma=2.0, delay_sigma=0.5)
    found = locate(PLANE, track, Ranges(t, r, np.full(len(t), 0.05)), known)
    assert isinstance(found, Place)
    return found


@pytest.mark.parametrize("height", [0.9, -0.9, 2.0])
@pytest.mark.parametrize("seed", range(3))
def test_no_height_is_claimed_of_which_the_mirror_image_fits_as_well(height, seed):
    place = walked(height, seed)
    assert np.hypot(place.east - 3.0, place.north - 6.0) < 0.2
    assert not place.up_known or abs(place.up - height) < 3 * place.up_sigma
