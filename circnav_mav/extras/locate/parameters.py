"""Autopilot parameters for the place of a beacon."""

import re
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from circnav_mav.extras.locate.place import Place


def px4(places: Mapping[str, Place]) -> Iterator[str]:
    """Yield PX4 console commands that set the places of beacons whose RANGING_BEACON messages have
    no place."""
    yield (
        "# PX4: RNGBC1_* add the place to RANGING_BEACON messages of this beacon: pull request"
        " 28323 of 2026-08,"
    )
    yield (
        "# not in a release then. It names only RNGBC1_ID: compare the other names with param show"
        " RNGBC*"
    )
    for number, (tag, place) in enumerate(places.items(), 1):
        prefix = f"RNGBC{number}"
        ident = re.match(r"beacon (\d+)", tag)
        yield f"# {tag}: {_rounding(place)}"
        yield (
            f"param set {prefix}_ID {ident[1]}"
            if ident
            else f"# param set {prefix}_ID: the beacon_id of your radio"
        )
        yield f"param set {prefix}_LAT {place.latitude:.8f}"
        yield f"param set {prefix}_LON {place.longitude:.8f}"
        yield _altitude(place, "param set {}_ALT {:.2f}", prefix)
    yield "# EKF2_RNGBC_CTRL 1 lets the filter use the ranges"


def ardupilot(places: Mapping[str, Place]) -> Iterator[str]:
    """Yield lines of a parameter file that put the origin of the beacon system at the first
    beacon."""
    origin: Place | None = None
    for tag, place in places.items():
        if origin is None:
            origin = place
            yield f"# {tag} is the origin of the beacons; {_rounding(place)}"
            yield f"BCN_LATITUDE,{place.latitude:.8f}"
            yield f"BCN_LONGITUDE,{place.longitude:.8f}"
            yield _altitude(place, "{}ALT,{:.2f}", "BCN_")
            yield "BCN_ORIENT_YAW,0"
            continue
        east, north = (
            float(way) for way in origin.plane.to_metres(place.latitude, place.longitude)
        )
        east, north = east - origin.east, north - origin.north
        yield (
            f"# {tag}: {north:.2f} m north, {east:.2f} m east of the first beacon: set this in your"
            " beacon system"
        )


def _altitude(place: Place, line: str, prefix: str) -> str:
    if place.up_known:
        return line.format(prefix, place.up)
    return (
        f"# {prefix.rstrip('_')}_ALT: the height is not observable in this log; set it yourself, m"
        " above sea level"
    )


def _rounding(place: Place) -> str:
    """Return the accuracy of the place and the error of storing it in 32-bit parameters, as
    text."""
    kept = (float(np.float32(place.latitude)), float(np.float32(place.longitude)))
    east, north = place.plane.to_metres(*kept)
    lost = float(np.hypot(east - place.east, north - place.north))
    return f"sigma {place.sigma:.1f} m; 32-bit numbers change the coordinates by {lost:.1f} m"


PARAMETERS: Mapping[str, Callable[[Mapping[str, Place]], Iterator[str]]] = {
    "px4": px4,
    "ardupilot": ardupilot,
}
