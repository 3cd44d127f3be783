"""Conversion of ranging telemetry to samples of range and range rate, with the reasons for rejected
messages.

Order of the checks: source, id, finite, "no range" codes, limits, quality, single source, stamp,
age, noise, height. The innovation gate follows later, in the estimator. `table` lists the messages,
and `sources` defines a source.
"""

from collections import Counter, deque
from collections.abc import Callable, Hashable
from math import inf
from typing import NamedTuple

from circnav_mav.guidance.maths import horizontal, horizontal_rate
from circnav_mav.guidance.range_noise import NoiseCheck
from circnav_mav.guidance.rate_check import RateCheck
from circnav_mav.guidance.types import SAME_TIME, RangeSample, RateSample
from circnav_mav.mav.clocks import JUMP, Order, Slower, StampFilter, no_link_delay
from circnav_mav.mav.codec import Message, ids
from circnav_mav.mav.identity import (
    AUTOPILOT_COMPONENT,
    MOVES_AFTER,
    RADIO_NAME,
    Identity,
    Sender,
    host_of,
)
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


class Accepted(NamedTuple):
    """A message that became a sample.

    sample: the sample.
    restarted: True if the sensor's clock was reset or replaced since the last accepted message.
    stepped: pause of the sensor's clock that this message showed, s, or 0.
    """

    sample: RangeSample
    restarted: bool
    stepped: float


class _Radio(NamedTuple):
    """Sender and sensor of the ranges in use.

    since: time of the first range from the present address, s.
    with_vehicle: True if the ranges arrive from the address of the vehicle.
    """

    sender: Sender
    sensor: RangeSource
    since: float
    with_vehicle: bool


class _Received(NamedTuple):
    """A ranging message, as the checks use it.

    reading: calibrated reading, or the reason why the message contains none.
    picked: True if the mission selects the sensor.
    fits: True if the sender has the configured ids and is no other vehicle.
    moved: True if the trusted radio sends from another port now.
    """

    sender: Sender
    sensor: RangeSource
    reading: Reading | Reject
    picked: bool
    fits: bool
    moved: bool
    now: float


class RangeReader:
    """Converter of messages to samples, each measurement at most once and in the order of the
    sensor's clock."""

    def __init__(
        self,
        settings: RangingSettings,
        identity: Identity,
        noise: NoiseCheck | None = None,
        slower: Slower = no_link_delay,
        reach: Callable[[float], float] = lambda seconds: inf,
    ) -> None:
        """identity: the vehicle and the senders on its link.
        noise: check of the reported sigma, None for no check.
        slower: delay increase of the ranges' link.
        reach: largest plausible change of the range in a time, m.
        """
        self._settings = settings
        self._identity = identity
        self._noise = noise
        self._kind = RANGING_MESSAGES[settings.message]
        self.clock = StampFilter(
            slower, wrap=self._kind.stamp_wrap if settings.stamp == "sensor" else None
        )
        """The sensor's clock, also used for the range rates of the sensor."""
        self.sources = RangeSources(self._kind, settings)
        self._reach = reach
        self._radio: _Radio | None = None
        self._left: deque[Hashable] = deque(maxlen=8)
        """Earlier addresses of the trusted sender."""
        self._taken = 0
        self._since_ahead = Since()
        self._newest: Reading | None = None
        self._restarted = False
        """True if the clock was reset since the last accepted message."""
        self.moving = False
        """True if the vehicle certainly moves, so that its range cannot stay constant."""
        self.sender_stays = False
        """True if no other sender may replace a silent trusted sender, because the vehicle is
        steered by its ranges."""
        self.rejected: Counter[str] = Counter()
        self.other_beacons: dict[int, tuple[float, float]] = {}
        """Time, s, and newest slant range, m, of the radio's other beacons, by id."""

    @property
    def trusted(self) -> Sender | None:
        """Sender and address of the ranges in use."""
        return None if self._radio is None else self._radio.sender

    @property
    def slant(self) -> float:
        """Newest slant range, m, 0 before the first range."""
        return 0.0 if self._newest is None else self._newest.slant

    @property
    def stamped(self) -> bool:
        """False if the newest range has no usable timestamp."""
        return self._newest is None or self._newest.stamp is not None

    @property
    def refused(self) -> int:
        """Number of rejected ranges of our sensor, without ranges of other sensors."""
        return self.rejected.total() - sum(self.rejected[reason] for reason in OTHERS)

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

    def read(
        self,
        message: Message,
        now: float,
        *,
        height: float | None = None,
        one_way: float = 0.0,
        source: Hashable = None,
    ) -> Accepted | None:
        """Return the sample that a message carries. Return None if the message is no range, or if
        it is rejected. Rejections are counted in `rejected`, second senders in the identity.

        height: height of the vehicle above the target, m, None to take ranges as horizontal.
        one_way: least one-way delay of this link, s. Stamps alone do not show it.
        source: address of the sender.
        """
        if message.get_type() != self._kind.type:
            return None
        vehicle = self._move_with_vehicle()
        received = self._received(message, now, source)
        if received is None:
            return None
        failed = (reason for check in self._CHECKS if (reason := check(self, received)))
        answer = next(failed, None) or self._take(received, height, vehicle)
        if isinstance(answer, RangeSample) and one_way > self._settings.max_age - SAME_TIME:
            answer = Reject.TOO_OLD
        if isinstance(answer, Reject):
            self.reject(answer)
            if answer is Reject.WRONG_SOURCE:
                self._report_rival(received)
            return None
        restarted = self._restarted
        self._restarted = False
        return Accepted(answer, restarted, self.clock.followed)

    def _move_with_vehicle(self) -> Hashable:
        """Give the trusted radio the address of the vehicle whose ranges it forwards. Return the
        address, None if unknown or if the ranges have a link of their own."""
        # Ranges that the autopilot forwards arrive from the vehicle's address, even after the
        # vehicle has changed it.
        peer = None if self._settings.apart else self._identity.peer
        radio = self._radio
        if peer is None:
            return None
        if radio is not None and radio.with_vehicle:
            self._radio = radio._replace(sender=radio.sender._replace(source=peer.source))
        return peer.source

    def _received(self, message: Message, now: float, source: Hashable) -> _Received | None:
        """Note the source of a message. Return the message for the checks, or None if it is no
        range."""
        reading = self._kind.read(message)
        if reading is None:
            return None
        sender = Sender(*ids(message), source)
        picked = self._kind.picked(message, self._settings)
        fits = self._fits(sender)
        slant = None if isinstance(reading, Reject) else reading.slant
        sensor = self.sources.receive(message, slant, now, picked=picked and fits)
        if self._kind.for_anything and not picked:
            return None
        moved = False
        if isinstance(reading, Reading):
            reading = reading.calibrated(self._settings.calibration)
            if picked:
                moved = self._moved(sender, sensor, reading.slant, now)
            elif fits:
                self._note_other_beacon(sensor, reading.slant, now)
        return _Received(sender, sensor, reading, picked, fits, moved, now)

    # --- checks, in the order in which they are made ---

    def _check_sender(self, received: _Received) -> Reject | None:
        """Reject a message of another sender or sensor than the trusted one, until the trusted one
        is silent."""
        if received.fits:
            if self._continues(received):
                return None
            if self._silent(received.now) and not self.sender_stays:
                return None
            if received.sender == self.trusted:
                return Reject.OTHER_SENSOR
        return Reject.WRONG_SOURCE

    def _check_sensor(self, received: _Received) -> Reject | None:
        """Reject a message of a sensor that the mission does not select."""
        return None if received.picked else Reject.OTHER_SENSOR

    def _check_reading(self, received: _Received) -> Reject | None:
        """Reject a message without a plausible range."""
        reading = received.reading
        if isinstance(reading, Reject):
            return reading
        if reading.slant <= 0:  # near the beacon, a corrected bias of meters can give this
            return Reject.NO_RANGE
        return Reject.ABOVE_MAX if reading.slant > self._kind.farthest else None

    def _check_single_source(self, received: _Received) -> Reject | None:
        """Reject all ranges while several sources fit the mission, because any of them may be the
        intended one. In flight a second source has no effect."""
        return Reject.AMBIGUOUS if self._ambiguous(received.now) else None

    def _check_stamp(self, received: _Received) -> Reject | None:
        """Reject a message whose stamp is not newer than the newest stamp of the same clock."""
        if not self._continues(received):
            self._restart()
        clock = self.clock
        now = received.now
        if clock.newest is None:
            return None
        stamp = self._stamp(received)
        most_ahead = FUTURE if self._taken > KNOWN_AFTER else JUMP
        if most_ahead < clock.ahead(stamp, now) <= JUMP:
            self._since_ahead.restart(now)
        # Routers that forward in a loop repeat old frames while the sensor still sends. Their old
        # stamps look like another clock. So another clock is accepted only after some ranging
        # periods without a stamp of the present clock.
        patience = LISTEN_PERIODS / self._settings.rate_hz
        newest = clock.newest
        order = clock.order(stamp, now, most_ahead=most_ahead, steady=JUMP, patience=patience)
        if order is Order.RESTARTED:
            self._restart()
            return None
        if order is Order.JUMPED:
            return Reject.STAMP_JUMP
        # A stamp that leads by more than FUTURE has two possible causes: another clock, or a link
        # with a shorter delay than before. With a shorter delay, the clock estimate still contains
        # the longer one. Ranges with the expected stamps are then older than they seem. So reject
        # them too, for 0.5 s after each stamp that leads.
        if self._since_ahead.age(now) < 0.5:
            clock.newest_at = now
            return Reject.CLOCK
        if order is Order.OLDER:
            return Reject.OLDER
        again = order is Order.REPEATED or self._repeats(received, stamp - newest)
        return Reject.REPEAT if again else None

    _CHECKS = (_check_sender, _check_sensor, _check_reading, _check_single_source, _check_stamp)

    def _take(
        self, received: _Received, height: float | None, vehicle: Hashable
    ) -> RangeSample | Reject:
        """Take a new reading as the newest. Return its sample, or the reason to reject it by age,
        noise or height."""
        reading = received.reading
        assert isinstance(reading, Reading)
        stamp = self._stamp(received)
        radio = self._radio
        same = self._is_trusted(received)
        if radio is not None and received.moved:
            self._left.append(radio.sender.source)
        with_vehicle = received.sender.source == vehicle
        if vehicle is None:
            with_vehicle = radio is not None and radio.with_vehicle and (same or received.moved)
        since = radio.since if radio is not None and same else received.now
        self._radio = _Radio(received.sender, received.sensor, since, with_vehicle)
        self._newest = reading
        self._taken += 1
        self.clock.take(stamp, received.now)
        return self._sample(reading, stamp, received.now, height)

    def _sample(
        self, reading: Reading, stamp: float, now: float, height: float | None
    ) -> RangeSample | Reject:
        """Return the sample of a new reading, or the reason for its rejection."""
        settings = self._settings
        noise = self._noise
        time = self.clock.local(stamp, now) - settings.calibration.delay
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

    def _note_other_beacon(self, sensor: RangeSource, slant: float, now: float) -> None:
        """Store the range of the trusted radio to another beacon, such as a member of a fleet."""
        radio = self._radio
        beacon = sensor.keys.get("beacon_id")
        # 256: limit of stored beacon ids. In an unsigned network any sender can invent ids.
        if radio is None or sensor[:2] != radio.sensor[:2] or not isinstance(beacon, int):
            return
        if beacon in self.other_beacons or len(self.other_beacons) < 256:
            self.other_beacons[beacon] = (now, slant)

    def _ambiguous(self, now: float) -> bool:
        return not self.sender_stays and self.sources.several(now)

    def _silent(self, now: float) -> bool:
        return now - self.clock.newest_at > SOURCE_SILENT

    def _continues(self, received: _Received) -> bool:
        """True if the message is the first one, or from the trusted sensor at its present or new
        address."""
        return self._radio is None or received.moved or self._is_trusted(received)

    def _is_trusted(self, received: _Received) -> bool:
        """True if the message is from the trusted sensor at its present address."""
        radio = self._radio
        return (
            radio is not None
            and received.sender == radio.sender
            and (received.sensor == radio.sensor)
        )

    def _report_rival(self, received: _Received) -> None:
        """Report the sender of a rejected message if it is a second sender: of a selected range,
        from another address."""
        trusted = self.trusted
        ranges = received.fits and received.picked and isinstance(received.reading, Reading)
        if trusted is None or not ranges or self._silent(received.now):
            return
        if received.sender.source != trusted.source:
            self._identity.second_senders.received(
                RADIO_NAME, received.sender, trusted, received.now
            )

    def _fits(self, sender: Sender) -> bool:
        """True if a sender has the configured ids and does not belong to another vehicle."""
        settings = self._settings
        if settings.component_id not in (None, sender.component):
            return False
        if settings.system_id is not None:
            return settings.system_id == sender.system
        other_vehicles = {} if settings.apart else self._identity.other_vehicles
        if sender.system not in other_vehicles:
            return True
        # Ranges of another vehicle's autopilot may have been accepted before its first heartbeat,
        # which arrives from the same address. A heartbeat with the radio's system id from another
        # address may be an imitation. Rejecting the radio because of such a heartbeat would end the
        # flight.
        its_own = (
            sender.component == AUTOPILOT_COMPONENT
            and other_vehicles[sender.system] == sender.source
        )
        return self.sender_stays and sender == self.trusted and not its_own

    def _moved(self, sender: Sender, sensor: RangeSource, slant: float, now: float) -> bool:
        """True if the trusted radio sends from another port of its host now."""
        radio = self._radio
        if (
            radio is None
            or sender.source == radio.sender.source
            or sensor != radio.sensor
            or not same_radio(sender, radio.sender)
        ):
            return False
        # An ESP8266 or a script may open a new socket for each datagram. Each port of such a radio
        # sends once, and no port sends again. A second program on the same host uses its port
        # again, and is a second sender.
        newest_at = self.clock.newest_at
        if radio.since == newest_at and sender.source not in self._left:
            return True
        # A radio that restarts is silent before it sends from a new port. Its range continues.
        silence = max(MOVES_AFTER, LISTEN_PERIODS / self._settings.rate_hz)
        return now - newest_at > silence and abs(slant - self.slant) <= self._reach(now - newest_at)

    def _stamp(self, received: _Received) -> float:
        """Return the unwrapped stamp of a reading, s, or its arrival time if it has none."""
        reading = received.reading
        return self.stamp(None if isinstance(reading, Reject) else reading.stamp, received.now)

    def stamp(self, carried: float | None, now: float) -> float:
        """Return the unwrapped stamp of a message, s, or its arrival time if it has none or the
        mission ignores it."""
        if self._settings.stamp != "sensor" or carried is None:
            return now
        return self.clock.unwrapped(carried)

    def _repeats(self, received: _Received, step: float) -> bool:
        """True if a message repeats the newest range. step: advance of its stamp, s."""
        before = self._newest
        reading = received.reading
        assert before is not None and isinstance(reading, Reading)
        again = (
            reading.sequence is not None
            and reading.sequence == before.sequence
            and received.now - self.clock.newest_at < 10
        )
        # ArduPilot repeats the last range of its rangefinder with new stamps until the next
        # measurement, and many radios print each line several times. A radio of coarse resolution
        # may measure equal ranges, once per period: those are not rejected.
        return again or (reading.slant == before.slant and step < 0.9 / self._settings.rate_hz)

    def _restart(self) -> None:
        """Reset the clock state for another clock or another sensor."""
        self.clock.reset()
        self._taken = 0
        self._since_ahead.clear()
        self._restarted = True


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
        self._stamp = -inf
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

    def range_taken(self, accepted: Accepted) -> None:
        """Process an accepted range, to compare measured range rates with the change of ranges."""
        sample = accepted.sample
        if accepted.restarted:
            self._check.reset()
            self._stamp = -inf
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
            or not abs(message.value) <= self._most  # also NaN
        ):
            return None
        stamp = ranging.stamp(boot_stamp(message), now)
        time = now + min(ranging.clock.ahead(stamp, now), 0.0) - settings.calibration.delay
        if now - time > settings.max_age - SAME_TIME or stamp <= self._stamp:
            return None
        self._stamp = stamp
        rate = message.value if settings.rate_sign == "opening" else -message.value
        self._sigma = self._noise.corrected(stamp, rate, RATE_SIGMA, moving=ranging.moving)
        self._check.add_rate(stamp, rate)
        if self.trouble:
            return None
        flat = horizontal_rate(ranging.slant, rate - self._check.bias, self._sigma, height or 0.0)
        return None if flat is None else RateSample(stamp, time, *flat)
