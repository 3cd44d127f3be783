"""Parameters of ArduPilot for the places of beacons."""

from collections.abc import Iterator, Mapping

import numpy as np

from circnav_mav.extras.locate.place import Place


def ardupilot(places: Mapping[str, Place]) -> Iterator[str]:
    """Yield lines of a parameter file that put the origin of the beacon system at the first
    beacon."""
    origin: Place | None = None
    for tag, place in places.items():
        if origin is None:
            origin = place
            yield f"# origin of the beacon system: the place of {tag}; {_rounding(place)}"
            yield f"BCN_LATITUDE,{place.latitude:.8f}"
            yield f"BCN_LONGITUDE,{place.longitude:.8f}"
            if place.up_known:
                yield f"BCN_ALT,{place.up:.2f}"
            else:
                yield "# BCN_ALT: the height is not observable: set it yourself, m above sea level"
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


def _rounding(place: Place) -> str:
    """Return the accuracy of the place and the error of storing it in 32-bit parameters, as
    text."""
    kept = (float(np.float32(place.latitude)), float(np.float32(place.longitude)))
    east, north = place.plane.to_metres(*kept)
    lost = float(np.hypot(east - place.east, north - place.north))
    return f"sigma {place.sigma:.1f} m; 32-bit numbers change the coordinates by {lost:.1f} m"
