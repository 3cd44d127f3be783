"""The bounds of a mission: leaving one of them ends it with the mission's exit action."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Bounds:
    """None: no such bound. Ranges in m, altitudes in m above sea level, battery in percent."""

    closest: float | None = None
    farthest: float | None = None
    lowest: float | None = None
    highest: float | None = None
    battery: float | None = None


def breach(bounds: Bounds, *, r: float | None, altitude: float | None, battery: float | None) -> str | None:
    """What bound is broken, in words; what is not known breaks none."""
    limits = (
        (r, bounds.closest, -1, "range {:.1f} m is nearer than {:.1f} m"),
        (r, bounds.farthest, 1, "range {:.1f} m is farther than {:.1f} m"),
        (altitude, bounds.lowest, -1, "altitude {:.1f} m is below {:.1f} m"),
        (altitude, bounds.highest, 1, "altitude {:.1f} m is above {:.1f} m"),
        (battery, bounds.battery, -1, "battery {:.0f} % is below {:.0f} %"),
    )
    for value, bound, side, words in limits:
        if value is not None and bound is not None and side * (value - bound) > 0:
            return words.format(value, bound)
    return None
