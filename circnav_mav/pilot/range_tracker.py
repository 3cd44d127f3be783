"""The range to the target: ranging messages in, an estimate out."""

from collections import deque
from collections.abc import Hashable
from math import pi, sqrt
from statistics import median

from circnav_mav.guidance.estimators.interface import Fused
from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.range_noise import NoiseCheck
from circnav_mav.guidance.types import SAME_TIME, RangeEstimate, RangeSample, RateSample
from circnav_mav.mav.clocks import nobody_tells
from circnav_mav.mav.codec import Message
from circnav_mav.mav.identity import RADIO_NAME
from circnav_mav.mav.ranging.interface import Reject
from circnav_mav.mav.ranging.reader import RangeRateReader, RangeReader
from circnav_mav.mav.session import Session
from circnav_mav.pilot.height import Height
from circnav_mav.pilot.settings import PilotSettings

FRESH = 0.6
"""Share of `stale` that a range's age must be below to steer again at once after ranges were stale."""
CALM = 1.0
"""Time, s, for which ranges must not have been stale to steer again otherwise: a radio whose ranges come at an age near
`stale` would else start and stop steering with each of them."""
THINNED = 0.75
"""Least time between two ranges that the estimator takes, in ticks: ranges in between are merged. Each range that it
takes is answered with a setpoint, and costs 1 to 2 ms of the processor."""
MOST_MERGED = 1000
"""Ranges that are merged to one at most."""
MOST_AT_ONCE = 64
"""Ranges that one datagram of a slow link may hold."""


class RangeTracker:
    """Reads ranges and keeps the estimator. `fresh`: a range came in that no step has answered yet."""

    def __init__(self, settings: PilotSettings, session: Session) -> None:
        self._session = session
        self._apart, self._stale = settings.ranging_apart, settings.timing.stale
        speed, max_turn_rate = settings.orbit.speed, settings.orbit.max_turn_rate
        self.noise = NoiseCheck.of_ranges(speed, max_turn_rate)
        self._needs_altitude = settings.height.needs_altitude
        self.height = Height(settings.height)
        slower = nobody_tells if self._apart else session.timesync.slower
        self.ranging = RangeReader(settings.ranging, self.noise, slower)
        self.rates = RangeRateReader(settings.ranging, self.ranging, NoiseCheck.of_rates(speed, max_turn_rate), speed)
        self.estimator = ESTIMATORS[settings.estimator](settings.estimation)
        self._thinning = Thinning(THINNED * settings.timing.tick)
        self.newest: RangeSample | None = None
        self.recent: deque[RangeSample] = deque(maxlen=MOST_AT_ONCE)
        """The newest ones that were taken."""
        self.newest_rate: RateSample | None = None
        self.fresh = False
        self.accepted = 0
        self._stale_at = float("-inf")

    def receive(self, message: Message, now: float, source: Hashable, *, stalled: bool, begun: bool) -> bool:
        """Take in what may be a range; tells whether the estimator took it. source: where it came from. stalled: we
        slept, its age is not known. begun: whether the vehicle was engaged: before, a slow link has its own bound, and
        is waited for."""
        height, identity = self.height.at(now), self._session.identity
        peer = None if self._apart else identity.peer
        if self.rates.carries(message):
            rate, before = self.rates.read(message, now, height=height, source=source), self.newest_rate
            apart = rate is None or before is None or rate.time - before.time >= self._thinning.period
            if rate is not None and not stalled and apart:
                self.newest_rate = rate
                self.estimator.observe_rate(rate)
            return False
        sample = self.ranging.read(
            message,
            now,
            height=height,
            strangers=() if self._apart else identity.strangers,
            one_way=self._session.timesync.one_way if begun and not self._apart else 0.0,
            source=source,
            vehicle=peer.source if peer else None,
        )
        if self.ranging.rival is not None and self.ranging.trusted is not None:
            identity.rivals.heard(RADIO_NAME, self.ranging.rival, self.ranging.trusted, now)
        if self.ranging.restarted:
            self.estimator.restamp()
            self._thinning.reset()
        if self.ranging.stepped:
            self._session.announcer.say("clock", f"sensor clock stalled {self.ranging.stepped:.1f} s")
        if sample is None:
            return False
        if stalled:
            self.ranging.reject(Reject.STALLED)
            return False
        if height is None and self._needs_altitude:
            self.ranging.reject(Reject.NO_HEIGHT)
            return False
        self.rates.range_taken(sample)
        merged = self._thinning.take(sample)
        if merged is None:
            return False
        sample, count = merged
        if self.estimator.observe(sample) is Fused.GATED:
            self.ranging.reject(Reject.GATED, count)
            return False
        self.accepted += count
        self.newest, self.fresh = sample, True
        self.recent.append(sample)
        return True

    def measured_rate(self, now: float) -> float | None:
        """The newest range rate that counted, m/s; None where none counts now."""
        rate = self.newest_rate
        return None if rate is None or now - rate.time > self._stale + SAME_TIME else rate.r_dot

    def good(self, estimate: RangeEstimate | None, now: float, *, holding: bool) -> bool:
        """Whether an estimate of now may steer: ready, and of a range that is not stale. holding: whether steering was
        given up; then the range must be clearly fresh, or ranges must not have been stale for a while."""
        age = self.age(now)
        if age is None or age > self._stale + SAME_TIME:
            self._stale_at = now
            return False
        fresh = not holding or age <= FRESH * self._stale or now - self._stale_at > CALM
        return self.estimator.ready and estimate is not None and fresh and self.ranging.one_source(now)

    def age(self, now: float) -> float | None:
        """Seconds since the newest range was measured."""
        return None if self.newest is None else now - self.newest.time


class Thinning:
    """Merges ranges that come faster than the estimator and the vehicle need them. A range that comes a period after
    the last one passes unchanged and at once."""

    def __init__(self, period: float) -> None:
        """period: least time between two ranges that pass, s."""
        self.period = period
        self._passed_at = float("-inf")
        self._held: list[RangeSample] = []

    def reset(self) -> None:
        """Drop what is held: the sensor's clock is another one."""
        self._held, self._passed_at = [], float("-inf")

    def take(self, sample: RangeSample) -> tuple[RangeSample, int] | None:
        """Return the range to use now and how many it stands for; None while they are held.

        Periods are counted in the time of measurement: a link that delivers several ranges of a slow radio at once
        delays them, and does not make them one measurement.
        """
        self._held.append(sample)
        if 0 <= sample.time - self._passed_at < self.period - SAME_TIME and len(self._held) < MOST_MERGED:
            return None
        # what was held when the radio fell silent is of another moment
        held = [one for one in self._held if sample.time - one.time <= self.period]
        count, self._held, self._passed_at = len(self._held), [], sample.time
        if len(held) == 1:
            return sample, count
        # The median, so that an outlier, which the estimator's gate cannot see any more, does not move the others; and
        # halfway between first and last, because the range goes on changing meanwhile. A median of n scatters by
        # sqrt(pi/2n).
        first, r = held[0], median(one.r for one in held)
        sigma = median(one.sigma for one in held) * min(sqrt(pi / 2 / len(held)), 1.0)
        stamp, time = (first.stamp + sample.stamp) / 2, (first.time + sample.time) / 2
        return sample._replace(stamp=stamp, time=time, r=r, sigma=sigma), count
