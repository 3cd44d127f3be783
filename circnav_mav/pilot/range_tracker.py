"""What is known of the range to the target: ranges in, an estimate out."""

from collections.abc import Collection, Hashable

from circnav_mav.guidance.estimators.interface import Fused
from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.range_noise import NoiseCheck
from circnav_mav.guidance.types import SAME_TIME, OwnMotion, RangeEstimate, RangeSample
from circnav_mav.mav.clocks import Slower
from circnav_mav.mav.codec import Message
from circnav_mav.mav.height import Height
from circnav_mav.mav.ranging.interface import Reject
from circnav_mav.mav.ranging.reader import RangeReader
from circnav_mav.pilot.mission_state import Say
from circnav_mav.pilot.settings import PilotSettings

FRESH = 0.6
"""Share of `stale` that a range's age must be below to steer again at once after ranges were stale."""
CALM = 1.0
"""Time, s, for which ranges must not have been stale to steer again otherwise: a radio whose ranges come at an age near
`stale` would else start and stop steering with each of them."""


class RangeTracker:
    """Reads ranges and keeps the estimator. `fresh`: a range came in that no step has answered yet."""

    def __init__(self, settings: PilotSettings, say: Say, say_once: Say, slower: Slower) -> None:
        """slower: tells of the link that ranges come on."""
        self._say, self._say_once = say, say_once
        self._stale = settings.timing.stale
        self._noise = NoiseCheck(settings.orbit.speed, settings.orbit.max_turn_rate)
        self._needs_altitude = settings.height.needs_altitude
        self.height = Height(settings.height)
        self.ranging = RangeReader(settings.ranging, self._noise, slower)
        self.estimator = ESTIMATORS[settings.estimator](settings.estimation)
        self.newest: RangeSample | None = None
        self.fresh = False
        self.accepted = 0
        self._stale_at = float("-inf")

    def receive(
        self,
        message: Message,
        now: float,
        *,
        stalled: bool,
        strangers: Collection[int],
        one_way: float,
        source: Hashable = None,
        vehicle: Hashable = None,
    ) -> bool:
        """Take in what may be a range; tells whether the estimator took it. stalled: we slept, its age is not known.
        strangers: systems of other vehicles. one_way: least delay of the link that it came on, s. source: where it came
        from. vehicle: where the vehicle's frames come from, where that is the same link."""
        height = self.height.at(now)
        sample = self.ranging.read(
            message, now, height=height, strangers=strangers, one_way=one_way, source=source, vehicle=vehicle
        )
        if self.ranging.restarted:
            self.estimator.restamp()
        if self.ranging.stepped:
            self._say("clock", f"sensor clock stalled {self.ranging.stepped:.1f} s")
        if sample is None:
            return False
        if stalled:
            self.ranging.reject(Reject.STALLED)
            return False
        if height is None and self._needs_altitude:
            self.ranging.reject(Reject.NO_HEIGHT)
            return False
        if self._noise.found is not None:
            self._say_once("noise", "range noise {1:.2g} m, expected {0:.2g} m".format(*self._noise.found))
        if self.estimator.observe(sample) is Fused.GATED:
            self.ranging.reject(Reject.GATED)
            return False
        self.accepted += 1
        self.newest, self.fresh = sample, True
        return True

    def move(self, own: OwnMotion) -> None:
        """The vehicle's own motion, where it is as it is told."""
        self.estimator.move(own)

    def at(self, now: float) -> RangeEstimate | None:
        """The estimate of this moment."""
        return self.estimator.at(now)

    def good(self, estimate: RangeEstimate | None, now: float, *, holding: bool) -> bool:
        """Whether an estimate of now may steer: ready, and of a range that is not stale. holding: whether steering was
        given up; then the range must be clearly fresh, or ranges must not have been stale for a while."""
        age = self.age(now)
        if age is None or age > self._stale + SAME_TIME:
            self._stale_at = now
            return False
        fresh = not holding or age <= FRESH * self._stale or now - self._stale_at > CALM
        return self.estimator.ready and estimate is not None and fresh

    def age(self, now: float) -> float | None:
        """Seconds since the newest range was measured."""
        return None if self.newest is None else now - self.newest.time
