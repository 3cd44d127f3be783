"""Ranging telemetry to samples of range and range rate: which messages count, and why the others do not.

The order of the checks is source, id, finite, "no range" codes, limits, quality, one source only, stamp; the innovation
gate comes later, in the estimator. See `table` for what each message says, and `sources` for what a source is.
"""

from collections import Counter
from collections.abc import Collection, Hashable
from math import isfinite

from circnav_mav.guidance.maths import horizontal, horizontal_rate
from circnav_mav.guidance.range_noise import NoiseCheck
from circnav_mav.guidance.rate_check import RateCheck
from circnav_mav.guidance.types import SAME_TIME, RangeSample, RateSample
from circnav_mav.mav.clocks import RemoteClock, Slower, nobody_tells
from circnav_mav.mav.codec import Message, ids
from circnav_mav.mav.identity import AUTOPILOT_COMPONENT, Sender
from circnav_mav.mav.ranging.interface import EXPLAINED, OTHERS, RangingSettings, Reading, Reject, boot_stamp
from circnav_mav.mav.ranging.sources import SOURCE_SILENT, RangeSource, RangeSources
from circnav_mav.mav.ranging.table import RANGING_MESSAGES

MISSED = 2.5
"""Ranges of the usual rate that must have failed to come by the old clock before a new one is followed."""
EPOCH_JUMP = 1.0
"""A stamp that is newer than the sensor's clock allows, or older than the newest, by more than this, s, is of a clock
that was set. One that is merely late is not: RemoteClock tells a clock that stood still from a slow link."""
FUTURE, KNOWN_AFTER = 0.15, 100
"""How far, s, a stamp may be ahead of the sensor's clock once so many ranges have told how quick its way can be. Less
is the jitter of a link; more is of another clock, or the way has become quicker, and counts only where nothing comes by
the old one any more."""
DOUBT = 0.5
"""Time, s, after such a stamp in which those by the old clock do not count either: if the way has become quicker, they
are older than they seem."""
MOST_RATE = 3.0
"""A range rate of more than so many times V is none of this vehicle and its target."""


class RangeReader:
    """Turns messages into samples, each measurement at most once and in the order of the sensor's clock."""

    def __init__(
        self, settings: RangingSettings, noise: NoiseCheck | None = None, slower: Slower = nobody_tells
    ) -> None:
        """noise: whether ranges scatter as they say; None: not checked. slower: tells of the link that they come on."""
        self._settings = settings
        self._noise = noise
        self._kind = RANGING_MESSAGES[settings.message]
        self.clock = RemoteClock(slower, wrap=self._kind.stamp_wrap if settings.stamp == "sensor" else None)
        """The sensor's clock, on which its range rates are, too."""
        self.sources = RangeSources(self._kind, settings)
        self.trusted: Sender | None = None
        """Whose ranges count, and from where."""
        self._source: RangeSource | None = None
        """Which of the sensors of the trusted sender counts."""
        self.rival: Sender | None = None
        """Who has sent the newest message, where it is a range like those of the trusted sender, from elsewhere."""
        self._with_vehicle = False
        self._taken = 0
        self._ahead_at = float("-inf")
        self._sequence: int | None = None
        self.slant = 0.0
        """The newest slant range, m."""
        self.restarted = False
        """Whether the sensor's clock was found to have jumped with the newest message."""
        self.stepped = 0.0
        """By how much the sensor's clock was found to have stood still with the newest message, s; 0 if not."""
        self.moving = False
        """Whether the vehicle certainly moves, so that its range cannot stay one number."""
        self.sender_stays = False
        """Whether nobody may stand in for a sender that falls silent: the vehicle is being steered by it."""
        self.rejected: Counter[str] = Counter()

    @property
    def refused(self) -> int:
        """Ranges of our sensor that did not become samples; those of others do no harm."""
        return self.rejected.total() - sum(self.rejected[reason] for reason in OTHERS)

    def read(
        self,
        message: Message,
        now: float,
        *,
        height: float | None = None,
        strangers: Collection[int] = (),
        one_way: float = 0.0,
        source: Hashable = None,
        vehicle: Hashable = None,
    ) -> RangeSample | None:
        """The sample that a message carries, or None; a rejection is counted in `rejected`.

        height: of the vehicle above the target, m; None: ranges are taken as horizontal. strangers: systems of other
        vehicles, whose ranges are theirs unless the mission names one of them. one_way: the least that messages are
        under way on this link, s: stamps alone cannot tell. source: where it came from. vehicle: where the vehicle's
        frames come from, if known: a radio that the autopilot forwards moves with it.
        """
        self.restarted, self.stepped, self.rival = False, 0.0, None
        if message.get_type() != self._kind.type:
            return None
        if self._with_vehicle and self.trusted is not None and vehicle is not None:
            self.trusted = self.trusted._replace(source=vehicle)
        answer = self._judge(message, now, height, strangers, source)
        if isinstance(answer, RangeSample) and vehicle is not None:
            self._with_vehicle = source == vehicle
        if isinstance(answer, RangeSample) and one_way > self._settings.max_age - SAME_TIME:
            answer = Reject.TOO_OLD
        if isinstance(answer, Reject):
            self.reject(answer)
            return None
        return answer

    @property
    def unexplained(self) -> int:
        """Those of them whose reason is not shown to the operator otherwise."""
        return self.refused - sum(self.rejected[reason] for reason in EXPLAINED)

    def one_source(self, now: float) -> bool:
        """True if the ranges are certainly those of one source."""
        return self.sender_stays or (self.sources.listened(now) and not self._ambiguous(now))

    def reject(self, reason: Reject, count: int = 1) -> None:
        """Count rejections, also those decided further on (gate, stall)."""
        self.rejected[reason.value] += count

    def _judge(
        self, message: Message, now: float, height: float | None, strangers: Collection[int], source: Hashable
    ) -> RangeSample | Reject | None:
        settings = self._settings
        reading, picked = self._kind.read(message), self._kind.picked(message, settings)
        if reading is None:
            return None
        sender = Sender(*ids(message), source)
        fits = self._fits(sender, strangers)
        slant = None if isinstance(reading, Reject) else reading.slant
        sensor = self.sources.receive(message, slant, now, picked=picked and fits)
        if self._kind.for_anything and not picked:
            return None
        if not fits or not self._counts(sender, sensor, now, picked=picked and slant is not None):
            return Reject.OTHER_SENSOR if fits and sender == self.trusted else Reject.WRONG_SOURCE
        if not picked:
            return Reject.OTHER_SENSOR
        if isinstance(reading, Reject):
            return reading
        if reading.slant > settings.max_range_m:
            return Reject.ABOVE_MAX
        # before the engagement a second source may be the one that is meant; in flight it changes nothing any more
        if self._ambiguous(now):
            return Reject.AMBIGUOUS
        if self.trusted is not None and (sender, sensor) != (self.trusted, self._source):
            self._begin_anew()
            self._with_vehicle = False
        carried = reading.stamp if settings.stamp == "sensor" else None
        stamp = now if carried is None else self.clock.unwrapped(carried)
        rejection = self._order(reading, stamp, now)
        if rejection is not None:
            return rejection
        self.trusted, self._source = sender, sensor
        self._sequence, self.slant = reading.sequence, reading.slant
        self._taken += 1
        self.clock.take(stamp, now)
        return self._sample(reading, stamp, now, height)

    def _sample(self, reading: Reading, stamp: float, now: float, height: float | None) -> RangeSample | Reject:
        """The sample of a reading that is new, unless it is too old or the target is overhead."""
        settings, noise = self._settings, self._noise
        time = self.clock.local(stamp, now)
        self.stepped = self.clock.followed
        if now - time > settings.max_age:
            return Reject.CLOCK if self.clock.doubted else Reject.TOO_OLD
        sigma = reading.sigma or settings.sigma_m
        if noise is not None:
            sigma = noise.corrected(stamp, reading.slant, sigma, moving=self.moving)
            if noise.repeated:
                return Reject.FROZEN
        if sigma > settings.max_sigma:
            return Reject.TOO_NOISY
        flat = horizontal(reading.slant, sigma, height) if height else (reading.slant, sigma)
        return Reject.OVERHEAD if flat is None else RangeSample(stamp, time, *flat, source=self._kind.type)

    def _ambiguous(self, now: float) -> bool:
        return not self.sender_stays and self.sources.several(now)

    def _fits(self, sender: Sender, strangers: Collection[int]) -> bool:
        """True if a sender has the configured ids, and is not of another vehicle."""
        settings = self._settings
        if settings.system_id not in (None, sender.system) or settings.component_id not in (None, sender.component):
            return False
        # an autopilot's also where they were heard, and believed, before its heartbeat told what it is
        stays = self.sender_stays and sender == self.trusted and sender.component != AUTOPILOT_COMPONENT
        return settings.system_id is not None or sender.system not in strangers or stays

    def _counts(self, sender: Sender, sensor: RangeSource, now: float, *, picked: bool) -> bool:
        """True if ranges of this sensor count: it is the first one, or that one has fallen silent. picked: a range
        that the mission picks, so that a second sender of it is a rival."""
        if self.trusted is None or (sender, sensor) == (self.trusted, self._source):
            return True
        silent = now - self.clock.newest_at > SOURCE_SILENT
        self.rival = sender if picked and not silent and sender.source != self.trusted.source else None
        return silent and not self.sender_stays

    def _order(self, reading: Reading, stamp: float, now: float) -> Reject | None:
        """Why a reading is not a newer measurement than the last, or None."""
        clock, settings = self.clock, self._settings
        if clock.newest is None:
            return None
        step, ahead = stamp - clock.newest, clock.ahead(stamp, now)
        future = self._taken > KNOWN_AFTER and FUTURE < ahead <= EPOCH_JUMP
        if future:
            self._ahead_at = now
        if future or step <= -EPOCH_JUMP or ahead > EPOCH_JUMP:
            # of another clock: followed when the next one agrees with it, a glitch must not reset us; and when no range
            # came by the old clock meanwhile, which a looped route does not silence
            anew = clock.set_anew(stamp, now, within=EPOCH_JUMP)
            if not anew or now - clock.newest_at < MISSED / settings.rate_hz:
                return Reject.STAMP_JUMP
            self._begin_anew()
            return None
        if now - self._ahead_at < DOUBT:
            clock.newest_at = now
            return Reject.CLOCK
        clock.on_line()
        if step < 0:
            return Reject.OLDER
        again = reading.sequence is not None and reading.sequence == self._sequence and now - clock.newest_at < 10
        resent = settings.resent and reading.slant == self.slant and step < 0.9 / settings.rate_hz
        return Reject.REPEAT if step == 0 or again or resent else None

    def _begin_anew(self) -> None:
        """Another clock, or another sensor: what was known of the old one says nothing of it."""
        self.clock.reset()
        self._sequence, self._taken, self._ahead_at = None, 0, float("-inf")
        self.restarted = True


class RangeRateReader:
    """The range rate that a radio measures: a NAMED_VALUE_FLOAT beside its ranges, of the same sender and clock. Only
    those count that go with the ranges."""

    def __init__(self, settings: RangingSettings, ranging: RangeReader, noise: NoiseCheck, speed: float) -> None:
        """ranging: reads the ranges beside them. noise: of rates. speed: V, m/s."""
        self._settings, self._ranging, self._noise, self._most = settings, ranging, noise, MOST_RATE * speed
        self._check = RateCheck()
        self._stamp: float | None = None
        self._sigma = settings.rate_sigma_mps

    @property
    def trouble(self) -> str:
        """Why measured rates do not count now, for people; empty where they do."""
        if self._noise.repeated:
            return f"frozen, the same number for {self._noise.repeated:.0f} s"
        return "" if self._check.trusted else self._check.why

    def carries(self, message: Message) -> bool:
        name = self._settings.rate_name
        return name is not None and message.get_type() == "NAMED_VALUE_FLOAT" and message.name == name

    def range_taken(self, sample: RangeSample) -> None:
        """A range was taken, by which the rates are judged."""
        if self._ranging.restarted:
            self._check.reset()
            self._stamp = None
        if self._settings.rate_name is not None:
            self._check.add_range(sample.stamp, self._ranging.slant, sample.sigma, self._sigma)

    def read(
        self, message: Message, now: float, *, height: float | None = None, source: Hashable = None
    ) -> RateSample | None:
        """The sample of a message that carries a rate; None where it does not count. height: above the target, m."""
        settings, ranging = self._settings, self._ranging
        if (*ids(message), source) != ranging.trusted or not isfinite(message.value) or abs(message.value) > self._most:
            return None
        carried = boot_stamp(message) if settings.stamp == "sensor" else None
        stamp = now if carried is None else ranging.clock.unwrapped(carried)
        time = now + min(ranging.clock.ahead(stamp, now), 0.0)
        if now - time > settings.max_age - SAME_TIME or (self._stamp is not None and stamp <= self._stamp):
            return None
        self._stamp = stamp
        rate = message.value if settings.rate_sign == "opening" else -message.value
        self._sigma = self._noise.corrected(stamp, rate, settings.rate_sigma_mps, moving=ranging.moving)
        self._check.add_rate(stamp, rate)
        if self.trouble:
            return None
        flat = horizontal_rate(ranging.slant, rate - self._check.bias, self._sigma, height or 0.0)
        return None if flat is None else RateSample(stamp, time, *flat)
