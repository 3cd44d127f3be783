"""Ranging telemetry to range samples: which messages count, and why the others do not.

The order of the checks is source, id, finite, "no range" codes, limits, quality, stamp; the innovation gate comes
later, in the estimator. See the messages' own files for what each says.
"""

from collections import Counter
from collections.abc import Collection, Hashable

from circnav_mav.guidance.geometry import horizontal
from circnav_mav.guidance.range_noise import NoiseCheck
from circnav_mav.guidance.types import SAME_TIME, RangeSample
from circnav_mav.mav.clocks import RemoteClock, Slower, nobody_tells
from circnav_mav.mav.codec import Message
from circnav_mav.mav.identity import Sender
from circnav_mav.mav.ranging.interface import OTHERS, RangingSettings, Reading, Reject
from circnav_mav.mav.ranging.table import RANGING_MESSAGES

MISSED = 2.5
"""Ranges of the usual rate that must have failed to come by the old clock before a new one is followed."""
AUTOPILOT_COMPONENT = 1
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
SOURCE_SILENT = 5.0
"""Silence of the first sensor heard, s, after which another one may take its place."""


class RangeReader:
    """Turns messages into samples, each measurement at most once and in the order of the sensor's clock."""

    def __init__(
        self, settings: RangingSettings, noise: NoiseCheck | None = None, slower: Slower = nobody_tells
    ) -> None:
        """noise: whether ranges scatter as they say; None: not checked. slower: tells of the link that they come on."""
        self._settings = settings
        self._noise = noise
        self._kind = RANGING_MESSAGES[settings.message]
        self.clock = RemoteClock(slower, wrap=self._kind.stamp_wrap if settings.sensor_stamps else None)
        """The sensor's clock, on which its range rates are, too."""
        self.trusted: Sender | None = None
        """Whose ranges count, and from where."""
        self.rival: Sender | None = None
        """Who has sent the newest message, where it is a range like those of the trusted sender, from elsewhere."""
        self._with_vehicle = False
        self._taken = 0
        self._ahead_at = float("-inf")
        self._sequence: int | None = None
        self.slant = 0.0
        """The newest slant range, m."""
        self.restarted = False
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
        vehicles, whose ranges are theirs unless the mission names one of them. one_way: how long messages of this link
        are under way at least, s, as far as anybody can tell: stamps alone cannot. source: where it came from. vehicle:
        where the vehicle's frames come from, None where that is not known; a radio that the autopilot forwards moves
        with it.
        `restarted` tells whether the sensor's clock was found to have jumped with this sample.
        """
        self.restarted, self.stepped, self.rival = False, 0.0, None
        if message.get_type() != self._kind.type:
            return None
        if self._with_vehicle and self.trusted is not None and vehicle is not None:
            self.trusted = (*self.trusted[:2], vehicle)
        answer = self._judge(message, now, height, strangers, source)
        if isinstance(answer, RangeSample) and vehicle is not None:
            self._with_vehicle = source == vehicle
        if isinstance(answer, RangeSample) and one_way > self._settings.max_age - SAME_TIME:
            answer = Reject.TOO_OLD
        if isinstance(answer, Reject):
            self.reject(answer)
            return None
        return answer

    def reject(self, reason: Reject) -> None:
        """Count a rejection, also one decided further on (gate, stall)."""
        self.rejected[reason.value] += 1

    def _judge(
        self, message: Message, now: float, height: float | None, strangers: Collection[int], source: Hashable
    ) -> RangeSample | Reject | None:
        reading, picked = self._kind.read(message), self._kind.picked(message, self._settings)
        if reading is None or (self._kind.for_anything and not picked):
            return None
        sender = (message.get_srcSystem(), message.get_srcComponent(), source)
        if not self._from_our_sensor(sender, now, strangers):
            self.rival = self.rival if picked and not isinstance(reading, Reject) else None
            return Reject.WRONG_SOURCE
        if not picked:
            return Reject.OTHER_SENSOR
        if isinstance(reading, Reject):
            return reading
        if reading.slant < self._settings.min_range:
            return Reject.BELOW_MIN
        if reading.slant > self._settings.max_range:
            return Reject.ABOVE_MAX
        if self.trusted not in (None, sender):
            self._begin_anew()
            self._with_vehicle = False
        carried = reading.stamp if self._settings.sensor_stamps else None
        stamp = now if carried is None else self.clock.unwrapped(carried)
        rejection = self._order(reading, stamp, now)
        if rejection is not None:
            return rejection
        self.trusted, self._sequence, self.slant = sender, reading.sequence, reading.slant
        self._taken += 1
        self.clock.take(stamp, now)
        return self._sample(reading, stamp, now, height)

    def _sample(self, reading: Reading, stamp: float, now: float, height: float | None) -> RangeSample | Reject:
        """The sample of a reading that is new, unless it is too old or the target is overhead."""
        settings = self._settings
        time = self.clock.local(stamp, now)
        self.stepped = self.clock.followed
        if now - time > settings.max_age:
            return Reject.CLOCK if self.clock.doubted else Reject.TOO_OLD
        sigma, noise = reading.sigma or settings.sigma, self._noise
        if noise is not None:
            sigma = noise.corrected(stamp, reading.slant, sigma, moving=self.moving)
            if noise.repeated:
                return Reject.FROZEN
        flat = reading.slant, sigma
        if flat[1] > settings.max_sigma:
            return Reject.TOO_NOISY
        if height:
            answer = horizontal(*flat, height)
            if answer is None:
                return Reject.OVERHEAD
            flat = answer
        return RangeSample(stamp, time, *flat, source=self._kind.type)

    def _from_our_sensor(self, sender: Sender, now: float, strangers: Collection[int]) -> bool:
        """One sensor only, of the configured ids, from one address: the first heard, until it falls silent."""
        settings = self._settings
        if settings.system not in (None, sender[0]) or settings.component not in (None, sender[1]):
            return False
        # an autopilot's also where they were heard, and believed, before its heartbeat told what it is
        stays = self.sender_stays and sender == self.trusted and sender[1] != AUTOPILOT_COMPONENT
        if settings.system is None and sender[0] in strangers and not stays:
            return False
        if self.trusted in (None, sender):
            return True
        silent = now - self.clock.newest_at > SOURCE_SILENT
        self.rival = None if silent or sender[2] == self.trusted[2] else sender
        return silent and not self.sender_stays

    def _order(self, reading: Reading, stamp: float, now: float) -> Reject | None:
        """Why a reading is not a newer measurement than the last, or None."""
        if self.clock.newest is None:
            return None
        step, waited = stamp - self.clock.newest, now - self.clock.newest_at
        ahead = self.clock.ahead(stamp, now)
        if self._taken > KNOWN_AFTER and FUTURE < ahead <= EPOCH_JUMP:
            self._ahead_at = now
            return self._jump(stamp, now)
        if step <= -EPOCH_JUMP or ahead > EPOCH_JUMP:
            return self._jump(stamp, now)
        if now - self._ahead_at < DOUBT:
            self.clock.newest_at = now
            return Reject.CLOCK
        self.clock.on_line()
        if step < 0:
            return Reject.OLDER
        if step == 0 or (reading.sequence is not None and reading.sequence == self._sequence and waited < 10):
            return Reject.REPEAT
        settings = self._settings
        if settings.resent and reading.slant == self.slant and step < 0.9 / settings.rate:
            return Reject.REPEAT
        return None

    def _jump(self, stamp: float, now: float) -> Reject | None:
        """A stamp of another clock: followed when the next one agrees with it, a glitch must not reset us; and when no
        range came by the old clock meanwhile, which a looped route does not silence."""
        anew = self.clock.set_anew(stamp, now, within=EPOCH_JUMP)
        if not anew or now - self.clock.newest_at < MISSED / self._settings.rate:
            return Reject.STAMP_JUMP
        self._begin_anew()
        return None

    def _begin_anew(self) -> None:
        """Another clock, or another sensor: what was known of the old one says nothing of it."""
        self.clock.reset()
        self._sequence, self._taken = None, 0
        self._ahead_at = float("-inf")
        self.restarted = True
