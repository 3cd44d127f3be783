"""Range to the target: ranging messages in, an estimate out."""

from collections import deque
from collections.abc import Hashable
from math import pi, sqrt
from statistics import median

from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.range_noise import NoiseCheck
from circnav_mav.guidance.types import (
    SAME_TIME,
    RangeEstimate,
    RangeSample,
    RateSample,
    RelativeMotion,
)
from circnav_mav.mav.clocks import no_link_delay
from circnav_mav.mav.codec import Message
from circnav_mav.mav.ranging.interface import Reject
from circnav_mav.mav.ranging.reader import RangeRateReader, RangeReader
from circnav_mav.mav.session import Session
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot.height import Height
from circnav_mav.timers import Since

FRESH = 0.5
"""Age of the newest range below which steering resumes at once after stale ranges, as a share of
`stale`."""
JUMPED_FOR = 1.0
"""Time, s, for which ranges must stay at a new value before a jump is reported. Outliers are
shorter."""


class RangeTracker:
    """Reads ranges and updates the estimator. fresh: True if a range was added since the newest
    step."""

    def __init__(self, settings: Mission, session: Session) -> None:
        self._settings = settings
        self._session = session
        speed = settings.orbit.speed
        max_turn_rate = settings.orbit.max_turn_rate
        self.noise = NoiseCheck.of_ranges(speed, max_turn_rate)
        self.height = Height(settings.file.orbit)
        slower = no_link_delay if settings.ranging_apart else session.timesync.slower
        # 0.5: smallest jump of the range that is rejected, as a share of the radius. Noise of this
        # size is rejected, too.
        self.jumps = JumpGate(speed, 0.5 * settings.orbit.radius)
        self.ranging = RangeReader(
            settings.ranging, session.identity, self.noise, slower, self.jumps.reach
        )
        self.rates = RangeRateReader(
            settings.ranging, self.ranging, NoiseCheck.of_rates(speed, max_turn_rate), speed
        )
        self.estimator = ESTIMATORS[settings.estimator](settings.tuning.estimation)
        # 0.75: least time between two ranges that are added to the estimator, in ticks. Ranges in
        # between are merged, because each added range causes a setpoint and takes 1 to 2 ms of
        # processor time.
        self._thinning = Thinning(0.75 * settings.file.limits.tick)
        # 100: number of newest ranges that are stored, more than one datagram of a slow link
        # contains.
        self.recent: deque[RangeSample] = deque(maxlen=100)
        """Newest ranges that the estimator accepted."""
        self.newest_rate: RateSample | None = None
        self.fresh = False
        self.estimate: RangeEstimate | None = None
        """Estimate of the newest step, or of the step that runs now."""
        self.accepted = 0
        self._since_stale = Since()

    def receive(
        self, message: Message, now: float, source: Hashable, *, stalled: bool, begun: bool
    ) -> bool:
        """Process a message that may be a range. Return True if the estimator accepted it.

        source: address of the sender.
        stalled: True if the message may date from a gap between steps, so that its age is unknown.
        begun: True after the first engagement. Before it, the delay of a slow link does not reject
            ranges, because the engagement waits for a shorter round trip.
        """
        height = self.height.at(now)
        if self.rates.carries(message):
            rate = self.rates.read(message, now, height=height, source=source)
            if rate is not None and not stalled:
                self._take_rate(rate)
            return False
        one_way = self.one_way if begun else 0.0
        answer = self.ranging.read(message, now, height=height, one_way=one_way, source=source)
        if answer is None:
            return False
        if answer.restarted:
            self.estimator.restamp()
            self._thinning.reset()
        if answer.stepped:
            self._session.announcer.say("clock", f"sensor clock stalled {answer.stepped:.1f} s")
        if stalled:
            self.ranging.reject(Reject.STALLED)
            return False
        if height is None and self._settings.file.orbit.needs_altitude:
            self.ranging.reject(Reject.NO_HEIGHT)
            return False
        self.rates.range_taken(answer)
        merged = self._thinning.take(answer.sample)
        if merged is None:
            return False
        sample, count = merged
        jumped = self.jumps.rejects(sample, self._reference())
        if jumped or not self.estimator.observe(sample):
            self.ranging.reject(Reject.GATED, count)
            return False
        self.accepted += count
        self.fresh = True
        self.recent.append(sample)
        return True

    def _take_rate(self, rate: RateSample) -> None:
        """Pass a range rate to the estimator, unless it follows the newest one too soon."""
        before = self.newest_rate
        if before is None or rate.time - before.time >= self._thinning.period:
            self.newest_rate = rate
            self.estimator.observe_rate(rate)

    @property
    def newest(self) -> RangeSample | None:
        """Newest range that the estimator accepted, None before the first."""
        return self.recent[-1] if self.recent else None

    def _reference(self) -> RangeSample | None:
        """Return the newest accepted range, with its value replaced by the median of the newest
        three ranges. Return None unless the vehicle is steered.

        The median rejects a single outlier. Ranges from before an outage are not used, because the
        vehicle has moved since.
        """
        newest = self.newest
        if not self.ranging.moving or newest is None:
            return None
        lately = [one.r for one in list(self.recent)[-3:] if newest.time - one.time <= JUMPED_FOR]
        return newest._replace(r=median(lately))

    @property
    def relative(self) -> RelativeMotion | None:
        """Relative motion of the newest estimate, or None while it is not trusted."""
        relative = self.estimate.relative if self.estimate is not None else None
        return relative if relative is not None and relative.trusted else None

    @property
    def one_way(self) -> float:
        """Least one-way delay of ranges on the vehicle's link, s, or 0 on a separate ranging
        link."""
        return 0.0 if self._settings.ranging_apart else self._session.timesync.one_way

    def measured_rate(self, now: float) -> float | None:
        """Return the newest accepted range rate, m/s, or None if it is too old."""
        rate = self.newest_rate
        return (
            None
            if rate is None or now - rate.time > self._settings.stale + SAME_TIME
            else rate.r_dot
        )

    def good(self, now: float, *, coasting: bool) -> bool:
        """True if the current estimate may steer: the estimator is ready and the newest range is
        not stale.

        coasting: True while steering is suspended. Steering resumes if the newest range is fresh
        (FRESH), or if no range was stale for 1 s.
        """
        age = self.age(now)
        stale = self._settings.stale
        if age is None or age > stale + SAME_TIME:
            self._since_stale.restart(now)
            return False
        # 1.0: time, s, without stale ranges after which steering resumes even if the range is older
        # than FRESH. Without this wait, ranges with ages near `stale` would start and stop steering
        # again and again.
        fresh = not coasting or age <= FRESH * stale or self._since_stale.age(now) > 1.0
        return (
            self.estimator.ready
            and self.estimate is not None
            and fresh
            and self.ranging.one_source(now)
        )

    def age(self, now: float) -> float | None:
        """Return the time since the newest range was measured, s, or None without a range."""
        newest = self.newest
        return None if newest is None else now - newest.time


class JumpGate:
    """Rejects ranges that jump farther than the vehicle can have flown, and later ranges that
    continue from a rejected range.

    A radio sends such a series if it changes its unit, measures the range to another anchor or
    reaches its limit. The estimator would accept the series after a second, and the vehicle would
    follow it off its circle. While a series is rejected, ranges are missing: the circle's turn rate
    is held until the ranges jump back or the flight ends.
    """

    def __init__(self, speed: float, least: float) -> None:
        """speed: V, m/s. least: smallest jump that is rejected, m."""
        # 2.0: largest rate of change of the range, in units of the vehicle's speed V, because wind
        # and target motion add to V.
        self._speed = 2.0 * speed
        self._least = least
        self._first: RangeSample | None = None
        self._newest: RangeSample | None = None
        self._by = 0.0

    @property
    def found(self) -> float:
        """Jump of the ranges, m, once it has lasted for JUMPED_FOR, else 0."""
        first = self._first
        newest = self._newest
        lasts = first is not None and newest is not None and newest.time - first.time >= JUMPED_FOR
        return self._by if lasts else 0.0

    def reach(self, seconds: float) -> float:
        """Return the largest change of the range in a time that is no jump, m."""
        return max(self._speed * seconds, self._least)

    def rejects(self, sample: RangeSample, accepted: RangeSample | None) -> bool:
        """Return True if a range is rejected. accepted: newest accepted range to compare with, or
        None."""
        before = self._newest
        # The distance that the vehicle can have flown grows with time until it covers the jump.
        # Ranges that continue from a rejected range remain rejected nevertheless.
        goes_on = before is not None and self._gap(sample, before) <= self._least / 2
        if (
            accepted is None
            or abs(sample.r - accepted.r) <= self._least
            or (not goes_on and self._gap(sample, accepted) <= self._least)
        ):
            self._first = self._newest = None
            return False
        self._first = self._first or sample
        self._newest = sample
        self._by = sample.r - accepted.r
        return True

    def _gap(self, sample: RangeSample, before: RangeSample) -> float:
        """Return the difference of two ranges beyond the distance that the vehicle can have flown
        in between, m."""
        return abs(sample.r - before.r) - self._speed * max(sample.time - before.time, 0.0)


class Thinning:
    """Merges ranges that arrive faster than estimator and vehicle need them. A range that was
    measured a period or more after the last passed range passes unchanged and without delay."""

    def __init__(self, period: float) -> None:
        """period: least time between two ranges that pass, s."""
        self.period = period
        self._passed_at = float("-inf")
        self._held: list[RangeSample] = []

    def reset(self) -> None:
        """Drop the stored ranges. Call after a change of the sensor's clock."""
        self._held = []
        self._passed_at = float("-inf")

    def take(self, sample: RangeSample) -> tuple[RangeSample, int] | None:
        """Return the merged range and the number of ranges that it replaces, or None while ranges
        are collected.

        Periods are measured by the times of measurement, so that ranges of a slow radio remain
        separate if a link delivers several at once.
        """
        self._held.append(sample)
        # 1000: largest number of ranges that are merged into one range.
        if 0 <= sample.time - self._passed_at < self.period - SAME_TIME and len(self._held) < 1000:
            return None
        # drop ranges from before a silence of the radio
        held = [one for one in self._held if sample.time - one.time <= self.period]
        count = len(self._held)
        self._held = []
        self._passed_at = sample.time
        if len(held) == 1:
            return sample, count
        # The median rejects outliers, which the estimator's gate cannot detect after merging. The
        # time of the merged range is halfway between the first and the last range, because the
        # range changes in between. The standard deviation of a median of n ranges is sqrt(pi/(2 n))
        # sigma.
        first = held[0]
        r = median(one.r for one in held)
        sigma = median(one.sigma for one in held) * min(sqrt(pi / 2 / len(held)), 1.0)
        stamp = (first.stamp + sample.stamp) / 2
        time = (first.time + sample.time) / 2
        return sample._replace(stamp=stamp, time=time, r=r, sigma=sigma), count
