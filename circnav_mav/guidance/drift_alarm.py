"""Whether the drift (wind less target motion) is more than the circle allows; see `theory.tolerated_drift`."""

from dataclasses import dataclass

from circnav_mav.guidance.theory import tolerated_drift
from circnav_mav.guidance.types import Orbit, RangeEstimate

PERSISTS = 3.0
"""Time, s, for which the drift must be too strong before the alarm is raised: the estimate follows single gusts."""
ALLOWED_AGAIN = 0.9
"""Share of the allowed drift below which the alarm ends."""


@dataclass(frozen=True, slots=True)
class DriftAlarm:
    """on: whether it is raised. since: when the drift became too strong, s; None while it is not. drift: as estimated
    last, m/s. allowed: the most in which the circle can be held, m/s."""

    on: bool = False
    since: float | None = None
    drift: float = 0.0
    allowed: float = 0.0

    @property
    def text(self) -> str:
        """For people, short enough for a STATUSTEXT with our name before it."""
        return f"drift {self.drift:.1f} m/s, this circle allows {self.allowed:.1f}"


def watch_drift(alarm: DriftAlarm, estimate: RangeEstimate | None, orbit: Orbit, turn_gain: float) -> DriftAlarm:
    """The alarm after an estimate; unchanged by one that does not know the drift. turn_gain: realised over commanded
    turn rate, as learnt."""
    motion = estimate.relative if estimate is not None else None
    if estimate is None or motion is None or not motion.trusted:
        return alarm
    V = max(motion.airspeed, 0.1 * orbit.speed)
    allowed = max(tolerated_drift(V, orbit.radius, orbit.max_turn_rate, turn_gain), 0.0)
    drift = motion.drift
    if not drift > allowed * (ALLOWED_AGAIN if alarm.on else 1.0):
        return DriftAlarm(False, None, drift, allowed)
    since = estimate.time if alarm.since is None else alarm.since
    return DriftAlarm(alarm.on or estimate.time - since >= PERSISTS, since, drift, allowed)
