"""Consistency check of GPS, ranges and compass. It names the most likely faulty source and never steers.

Three comparisons:

- measured range against the distance from the reported position to the estimated place
- ground velocity by reported positions against airspeed, heading and the wind estimated before
- bearing of the target by position against the bearing by ranges and compass

The combination of failing comparisons identifies the source.
"""

from collections import deque
from dataclasses import dataclass
from enum import Enum
from math import atan2, degrees

SPAN = 3.0
"""Time span, s, of the velocity comparison: longer than the jitter of the streams, much shorter than a lap."""
FACTOR = 5.0
"""Difference, in standard deviations, from which two sources disagree: the gate of the estimators."""
RANGE_FLOOR, SPEED_FLOOR, BEARING_FLOOR = 6.0, 4.0, 0.2
"""Smallest differences, m, m/s and rad, that can raise an alarm. GPS multipath, gusts, and compass errors in
turns cause smaller ones."""
PATIENCE = 2.0
"""Time, s, for which a comparison must fail before an alarm."""
WIND_MEMORY = 20.0
"""Time constant, s, of the averages of wind and gusts. The velocity comparison begins this long after the first
estimate of the wind. Chosen, shorter than a lap."""
RECENT = 30.0
"""Time, s, after a failed velocity comparison. A range error within this time is attributed to the GPS."""
CALM = 10.0
"""Time, s, without a disagreement after which the alarm ends."""


class FaultSource(Enum):
    """Most likely faulty source."""

    GPS = "GPS"
    BEACON = "beacon"
    COMPASS = "compass"


@dataclass(frozen=True, slots=True)
class Observation:
    """Values compared at one time (s). east, north: position, m. air: velocity through the air, m/s, east + j north,
    None if unknown. range_off: measured minus predicted range, and standard deviation, m. bearing_off: bearing of
    the target by compass minus bearing by position, and standard deviation, rad. Each is None if not available."""

    time: float
    east: float
    north: float
    air: complex | None
    range_off: tuple[float, float] | None = None
    bearing_off: tuple[float, float] | None = None


class GpsWatch:
    """Compares every reported position with the other sources."""

    def __init__(self) -> None:
        self.fault: FaultSource | None = None
        """Most likely faulty source now, None without a disagreement."""
        self.alarm = ""
        """Human-readable description of a lasting disagreement. Empty without one."""
        self._looks: deque[Observation] = deque()
        self._wind: complex | None = None
        """Wind, m/s, east + j north."""
        self._gusts = 1.0
        self._learnt = 0.0
        self._failing: dict[str, float] = {}
        self._way_failed_at = float("-inf")
        self._calm_since: float | None = None
        self.reported: list[tuple[float, str]] = []
        """All alarms so far: start time, s, and first text of each alarm."""

    @property
    def trusts_positions(self) -> bool:
        """True if reported positions may be used for the target estimate."""
        return "range" not in self._failing and self.fault is not FaultSource.GPS

    def see(self, look: Observation) -> None:
        """Compare the values at one time and update the alarm."""
        self._looks.append(look)
        while self._looks[-1].time - self._looks[0].time > SPAN:
            self._looks.popleft()
        self._compare_ways()
        for name, off, floor in (("range", look.range_off, RANGE_FLOOR), ("bearing", look.bearing_off, BEARING_FLOOR)):
            if off is not None and abs(off[0]) > max(FACTOR * off[1], floor):
                self._failing.setdefault(name, look.time)
            else:
                self._failing.pop(name, None)
        self._judge(look)

    def forget_ranges(self) -> None:
        """Reset the range comparison: the place is estimated again."""
        self._failing.pop("range", None)

    def _compare_ways(self) -> None:
        """Compare ground velocity minus air velocity with the estimated wind, and update the wind."""
        first, last = self._looks[0], self._looks[-1]
        span = last.time - first.time
        air = [look.air for look in self._looks if look.air is not None]
        if span < SPAN / 2 or len(air) < len(self._looks):
            return
        wind = complex(last.east - first.east, last.north - first.north) / span - sum(air) / len(air)
        if self._wind is None:
            self._wind, self._learnt = wind, last.time
            return
        off = abs(wind - self._wind)
        settled = last.time - self._learnt > WIND_MEMORY
        if settled and off > max(FACTOR * self._gusts, SPEED_FLOOR):
            self._way_failed_at = last.time
            return  # do not update the wind with a mismatch
        dt = min(last.time - self._looks[-2].time, 1.0) if len(self._looks) > 1 else 0.0
        share = dt / WIND_MEMORY
        self._gusts += share * (off - self._gusts)
        self._wind += share * (wind - self._wind)

    def _judge(self, look: Observation) -> None:
        lasting = {name for name, since in self._failing.items() if look.time - since >= PATIENCE}
        if not lasting:
            self._calm_since = look.time if self._calm_since is None else self._calm_since
            if look.time - self._calm_since > CALM:
                self.fault, self.alarm = None, ""
            return
        self._calm_since = None
        # After a jump of the GPS position, the velocity comparison fails only once, but the range comparison goes on
        # failing. Attribute range errors to the GPS for a while.
        jumped = look.time - self._way_failed_at < RECENT or self.fault is FaultSource.GPS
        by_range = FaultSource.GPS if jumped else FaultSource.BEACON
        fault = by_range if "range" in lasting else FaultSource.COMPASS
        off, _ = (look.bearing_off if fault is FaultSource.COMPASS else look.range_off) or (0.0, 0.0)
        self.alarm = f"range and GPS position disagree by {abs(off):.0f} m, most likely wrong: {fault.value}"
        if fault is FaultSource.COMPASS:
            self.alarm = (
                f"bearings by compass and by GPS disagree by {degrees(abs(off)):.0f} deg, most likely wrong: compass"
            )
        if fault is not self.fault:
            self.reported.append((look.time, self.alarm))
        self.fault = fault


def angle_between(first: tuple[float, float], second: tuple[float, float]) -> float:
    """Return the angle from the second vector to the first, rad, counter-clockwise positive."""
    cross = second[0] * first[1] - second[1] * first[0]
    return atan2(cross, first[0] * second[0] + first[1] * second[1])
