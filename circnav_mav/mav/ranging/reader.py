"""Conversion of ranging telemetry to samples of range and range rate, with the reasons for rejected
messages.

Order of the checks: source, id, finite, "no range" codes, limits, quality, single source, stamp,
age, noise, height. The innovation gate follows later, in the estimator. `table` lists the messages,
and `sources` defines a source.
"""

from collections import Counter, deque
from collections.abc import Callable, Hashable, Mapping
from math import inf, isfinite

from circnav_mav.guidance.maths import horizontal, horizontal_rate
from circnav_mav.guidance.range_noise import NoiseCheck
from circnav_mav.guidance.rate_check import RateCheck
from circnav_mav.guidance.types import SAME_TIME, RangeSample, RateSample
from circnav_mav.mav.clocks import JUMP, Order, Slower, StampFilter, no_link_delay
from circnav_mav.mav.codec import Message, ids
from circnav_mav.mav.identity import AUTOPILOT_COMPONENT, MOVES_AFTER, Sender, host_of
from circnav_mav.mav.ranging.interface import (
    EXPLAINED,
    OTHERS,
    RATE_SIGMA,
    RangingSettings,
    Reading,
    Reject,
    boot_stamp,
)
from circnav_mav.mav.ranging.sources import LISTEN_PERIODS, SOURCE_SILENT, RangeSource, RangeSources
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from circnav_mav.timers import Since

FUTURE = 0.15
"""Largest lead of a stamp over the estimate of the sensor's clock, s. A smaller lead is link
jitter. A larger lead indicates another clock or a shorter link delay: such a stamp is accepted only
when ranges of the old clock have stopped."""
KNOWN_AFTER = 100
"""Number of accepted ranges after which the shortest link delay is known and FUTURE applies.
Before, the limit of the lead is JUMP."""


def same_radio(sender: Sender, other: Sender) -> bool:
    """True if two senders have the same ids and the same host. Their ports may differ."""
    return sender.ids == other.ids and host_of(sender.source) == host_of(other.source)


class RangeReader:
    """Converter of messages to samples, each measurement at most once and in the order of the
    sensor's clock."""

    def __init__(
        self,
        settings: RangingSettings,
        noise: NoiseCheck | None = None,
        slower: Slower = no_link_delay,
        reach: Callable[[float], float] = lambda seconds: inf,
    ) -> None:
        """noise: check of the reported sigma, None for no check. slower: delay increase of the
        ranges' link. reach: largest plausible change of the range in a time, m."""
        self._settings = settings
        self._noise = noise
        self._kind = RANGING_MESSAGES[settings.message]
        self.clock = StampFilter(
            slower, wrap=self._kind.stamp_wrap if settings.stamp == "sensor" else None
        )
        """The sensor's clock, also used for the range rates of the sensor."""
        self.sources = RangeSources(self._kind, settings)
        self.trusted: Sender | None = None
        """Sender and address of the ranges in use."""
        self._source: RangeSource | None = None
        """Sensor of the trusted sender that is in use."""
        self.rival: Sender | None = None
        """Sender of the newest message if it is a second sender: a selected range from another
        address."""
        self._reach = reach
        self._here_since = -inf
        """Time of the first range from the present address of the trusted sender, s."""
        self._left: deque[Hashable] = deque(maxlen=8)
        """Earlier addresses of the trusted sender."""
        self._with_vehicle = False
        self._taken = 0
        self._since_ahead = Since()
        self._sequence: int | None = None
        self.slant = 0.0
        """Newest slant range, m."""
        self.stamped = True
        """False if the newest message has no usable timestamp."""
        self.restarted = False
        """True if the newest message showed a reset of the sensor's clock."""
        self.stepped = 0.0
        """Pause of the sensor's clock that the newest message showed, s, or 0."""
        self.moving = False
        """True if the vehicle certainly moves, so that its range cannot stay constant."""
        self.sender_stays = False
        """True if no other sender may replace a silent trusted sender, because the vehicle is
        steered by its ranges."""
        self.rejected: Counter[str] = Counter()
        self.other_beacons: dict[int, tuple[float, float]] = {}
        """Time, s, and newest slant range, m, of the radio's other beacons, by id."""

    @property
    def refused(self) -> int:
        """Number of rejected ranges of our sensor, without ranges of other sensors."""
        return self.rejected.total() - sum(self.rejected[reason] for reason in OTHERS)

    def read(
        self,
        message: Message,
        now: float,
        *,
        height: float | None = None,
        other_vehicles: Mapping[int, Hashable] | None = None,
        one_way: float = 0.0,
        source: Hashable = None,
        vehicle: Hashable = None,
    ) -> RangeSample | None:
        """Return the sample that a message carries, or None. A rejection is counted in `rejected`.

        height: height of the vehicle above the target, m, None to take ranges as horizontal.
        other_vehicles: system ids of other vehicles, with the addresses of their autopilots. Their
            ranges are rejected unless the mission specifies that system id.
        one_way: least one-way delay of this link, s. Stamps alone do not show it.
        source: address of the sender.
        vehicle: address of the vehicle, or None. Ranges that the autopilot forwards arrive from
            this address, even after the vehicle has changed it.
        """
        self.restarted = False
        self.stepped = 0.0
        self.rival = None
        if message.get_type() != self._kind.type:
            return None
        if self._with_vehicle and self.trusted is not None and vehicle is not None:
            self.trusted = self.trusted._replace(source=vehicle)
        answer = self._judge(message, now, height, other_vehicles or {}, source)
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
        """Number of `refused` ranges, without the reasons that are shown to the operator elsewhere
        (EXPLAINED)."""
        return self.refused - sum(self.rejected[reason] for reason in EXPLAINED)

    def one_source(self, now: float) -> bool:
        """True if the ranges certainly come from a single source."""
        return self.sender_stays or (self.sources.listened(now) and not self._ambiguous(now))

    def reject(self, reason: Reject, count: int = 1) -> None:
        """Count rejections, including later rejections by the gate or after a stall."""
        self.rejected[reason.value] += count

    def _judge(
        self,
        message: Message,
        now: float,
        height: float | None,
        other_vehicles: Mapping[int, Hashable],
        source: Hashable,
    ) -> RangeSample | Reject | None:
        settings = self._settings
        reading = self._kind.read(message)
        picked = self._kind.picked(message, settings)
        if reading is None:
            return None
        sender = Sender(*ids(message), source)
        fits = self._fits(sender, other_vehicles)
        slant = None if isinstance(reading, Reject) else reading.slant
        sensor = self.sources.receive(message, slant, now, picked=picked and fits)
        if self._kind.for_anything and not picked:
            return None
        if not picked and fits and isinstance(reading, Reading):
            self._note_other_beacon(sensor, reading, now)
        moved = picked and slant is not None and self._moved(sender, sensor, slant, now)
        if not fits or not (
            moved or self._counts(sender, sensor, now, picked=picked and slant is not None)
        ):
            return Reject.OTHER_SENSOR if fits and sender == self.trusted else Reject.WRONG_SOURCE
        if not picked:
            return Reject.OTHER_SENSOR
        if isinstance(reading, Reject):
            return reading
        reading = reading.calibrated(settings.calibration)
        if reading.slant <= 0:  # near the beacon, a corrected bias of meters can give this
            return Reject.NO_RANGE
        if reading.slant > self._kind.farthest:
            return Reject.ABOVE_MAX
        # Before the engagement, a second source may be the intended source. In flight a second
        # source has no effect.
        if self._ambiguous(now):
            return Reject.AMBIGUOUS
        changed = (sender, sensor) != (self.trusted, self._source)
        if self.trusted is not None and changed and not moved:
            self._restart()
            self._with_vehicle = False
        carried = reading.stamp if settings.stamp == "sensor" else None
        self.stamped = reading.stamp is not None
        stamp = now if carried is None else self.clock.unwrapped(carried)
        rejection = self._order(reading, stamp, now)
        if rejection is not None:
            return rejection
        if self.trusted is not None and moved:
            self._left.append(self.trusted.source)
        if changed:
            self._here_since = now
        self.trusted = sender
        self._source = sensor
        self._sequence = reading.sequence
        self.slant = reading.slant
        self._taken += 1
        self.clock.take(stamp, now)
        return self._sample(reading, stamp, now, height)

    def _note_other_beacon(self, sensor: RangeSource, reading: Reading, now: float) -> None:
        """Store the range of the trusted radio to another beacon, such as a member of a fleet."""
        trusted = self._source
        beacon = sensor.keys.get("beacon_id")
        # 256: limit of stored beacon ids. In an unsigned network any sender can invent ids.
        if trusted is None or sensor[:2] != trusted[:2] or not isinstance(beacon, int):
            return
        if beacon in self.other_beacons or len(self.other_beacons) < 256:
            slant = reading.calibrated(self._settings.calibration).slant
            self.other_beacons[beacon] = (now, slant)

    def _sample(
        self, reading: Reading, stamp: float, now: float, height: float | None
    ) -> RangeSample | Reject:
        """Return the sample of a new reading, or the reason for its rejection."""
        settings = self._settings
        noise = self._noise
        time = self.clock.local(stamp, now) - settings.calibration.delay
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
        return (
            Reject.OVERHEAD
            if flat is None
            else RangeSample(stamp, time, *flat, source=self._kind.type)
        )

    def _ambiguous(self, now: float) -> bool:
        return not self.sender_stays and self.sources.several(now)

    def _fits(self, sender: Sender, other_vehicles: Mapping[int, Hashable]) -> bool:
        """True if a sender has the configured ids and does not belong to another vehicle."""
        settings = self._settings
        if settings.system_id not in (None, sender.system) or settings.component_id not in (
            None,
            sender.component,
        ):
            return False
        # Ranges of another vehicle's autopilot may have been accepted before its first heartbeat,
        # which arrives from the same address. A heartbeat with the radio's system id from another
        # address may be an imitation. Rejecting the radio because of such a heartbeat would end the
        # flight.
        its_own = (
            sender.component == AUTOPILOT_COMPONENT
            and other_vehicles.get(sender.system) == sender.source
        )
        stays = self.sender_stays and sender == self.trusted and not its_own
        return settings.system_id is not None or sender.system not in other_vehicles or stays

    def _counts(self, sender: Sender, sensor: RangeSource, now: float, *, picked: bool) -> bool:
        """True if ranges of this sensor are used: it is the trusted sensor, or the trusted sensor
        is silent.

        picked: True for a range that the mission selects. Such a range from another address
        indicates a second sender.
        """
        if self.trusted is None or (sender, sensor) == (self.trusted, self._source):
            return True
        silent = now - self.clock.newest_at > SOURCE_SILENT
        self.rival = (
            sender if picked and not silent and sender.source != self.trusted.source else None
        )
        return silent and not self.sender_stays

    def _moved(self, sender: Sender, sensor: RangeSource, slant: float, now: float) -> bool:
        """True if the trusted radio sends from another port of its host now."""
        trusted = self.trusted
        if (
            trusted is None
            or sender.source == trusted.source
            or sensor != self._source
            or not same_radio(sender, trusted)
        ):
            return False
        # An ESP8266 or a script may open a new socket for each datagram. Each port of such a radio
        # sends once, and no port sends again. A second program on the same host uses its port
        # again, and is a second sender.
        newest_at = self.clock.newest_at
        if self._here_since == newest_at and sender.source not in self._left:
            return True
        # A radio that restarts is silent before it sends from a new port. Its range continues.
        silence = max(MOVES_AFTER, LISTEN_PERIODS / self._settings.rate_hz)
        return now - newest_at > silence and abs(slant - self.slant) <= self._reach(now - newest_at)

    def _order(self, reading: Reading, stamp: float, now: float) -> Reject | None:
        """Return the reason to reject a reading by its stamp, or None if it is newer than the last
        reading."""
        clock = self.clock
        settings = self._settings
        if clock.newest is None:
            return None
        most_ahead = FUTURE if self._taken > KNOWN_AFTER else JUMP
        if most_ahead < clock.ahead(stamp, now) <= JUMP:
            self._since_ahead.restart(now)
        # A looped route repeats old frames while the sensor still sends. So a new clock is followed
        # only after 2.5 range periods without a stamp of the old clock.
        order = clock.order(
            stamp, now, most_ahead=most_ahead, steady=JUMP, patience=2.5 / settings.rate_hz
        )
        if order is Order.RESTARTED:
            self._restart()
            return None
        if order is Order.JUMPED:
            return Reject.STAMP_JUMP
        # 0.5: time after a stamp with a lead above FUTURE, s, in which stamps of the old clock are
        # rejected too. If the link has become faster, these ranges are older than the clock
        # estimate shows.
        if self._since_ahead.age(now) < 0.5:
            clock.newest_at = now
            return Reject.CLOCK
        if order is Order.OLDER:
            return Reject.OLDER
        again = (
            reading.sequence is not None
            and reading.sequence == self._sequence
            and now - clock.newest_at < 10
        )
        # ArduPilot repeats the last range of its rangefinder with new stamps until the next
        # measurement, and many radios print each line several times. A radio of coarse resolution
        # may measure equal ranges, once per period: those are not rejected.
        resent = reading.slant == self.slant and stamp - clock.newest < 0.9 / settings.rate_hz
        return Reject.REPEAT if order is Order.REPEATED or again or resent else None

    def _restart(self) -> None:
        """Reset the clock state for another clock or another sensor."""
        self.clock.reset()
        self._sequence = None
        self._taken = 0
        self._since_ahead.clear()
        self.restarted = True


class RangeRateReader:
    """Reader of the range rate: a NAMED_VALUE_FLOAT of the same sender and clock as the ranges.

    Rates that are not consistent with the ranges are not used.
    """

    def __init__(
        self, settings: RangingSettings, ranging: RangeReader, noise: NoiseCheck, speed: float
    ) -> None:
        """ranging: reader of the ranges.
        noise: noise check of the rates.
        speed: V, m/s.
        """
        self._settings = settings
        self._ranging = ranging
        self._noise = noise
        # 3.0: largest plausible range rate in units of V.
        self._most = 3.0 * speed
        self._check = RateCheck()
        self._stamp: float | None = None
        self._sigma = RATE_SIGMA

    @property
    def trouble(self) -> str:
        """Human-readable reason why measured rates are not used now, or empty."""
        if self._noise.repeated:
            return f"frozen, the same value for {self._noise.repeated:.0f} s"
        return "" if self._check.trusted else self._check.why

    def carries(self, message: Message) -> bool:
        name = self._settings.rate_name
        return (
            name is not None and message.get_type() == "NAMED_VALUE_FLOAT" and message.name == name
        )

    def range_taken(self, sample: RangeSample) -> None:
        """Process an accepted range, to compare measured range rates with the change of ranges."""
        if self._ranging.restarted:
            self._check.reset()
            self._stamp = None
        if self._settings.rate_name is not None:
            self._check.add_range(sample.stamp, self._ranging.slant, sample.sigma, self._sigma)

    def read(
        self, message: Message, now: float, *, height: float | None = None, source: Hashable = None
    ) -> RateSample | None:
        """Return the sample of a rate message, or None if it is rejected. height: height of the
        vehicle above the target, m."""
        settings = self._settings
        ranging = self._ranging
        sender = Sender(*ids(message), source)
        if (
            ranging.trusted is None
            or not same_radio(sender, ranging.trusted)
            or not isfinite(message.value)
            or abs(message.value) > self._most
        ):
            return None
        carried = boot_stamp(message) if settings.stamp == "sensor" else None
        stamp = now if carried is None else ranging.clock.unwrapped(carried)
        time = now + min(ranging.clock.ahead(stamp, now), 0.0) - settings.calibration.delay
        if now - time > settings.max_age - SAME_TIME or (
            self._stamp is not None and stamp <= self._stamp
        ):
            return None
        self._stamp = stamp
        rate = message.value if settings.rate_sign == "opening" else -message.value
        self._sigma = self._noise.corrected(stamp, rate, RATE_SIGMA, moving=ranging.moving)
        self._check.add_rate(stamp, rate)
        if self.trouble:
            return None
        flat = horizontal_rate(ranging.slant, rate - self._check.bias, self._sigma, height or 0.0)
        return None if flat is None else RateSample(stamp, time, *flat)
