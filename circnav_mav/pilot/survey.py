"""Listens to the vehicle and the ranging before a flight, and sends nothing that could move anything.

Not a silenced pilot: a pilot engages, ends and tells the ground station so, even in a dry run. A survey has no
controller at all. It sends what a flight needs in order to hear the same (our heartbeat, stream requests), and asks
(AUTOPILOT_VERSION, TIMESYNC, PARAM_REQUEST_READ).
"""

from collections import Counter, defaultdict
from collections.abc import Hashable, Mapping
from dataclasses import dataclass

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.range_noise import NoiseCheck
from circnav_mav.mav.autopilots.interface import Autopilot
from circnav_mav.mav.clocks import Moment, Span, quick_span
from circnav_mav.mav.codec import LinkCounts, Message
from circnav_mav.mav.height import Height
from circnav_mav.mav.identity import RADIO_NAME, describe_vehicle
from circnav_mav.mav.own_motion import Motion
from circnav_mav.mav.params import ParameterReader
from circnav_mav.mav.ranging.reader import RangeRateReader, RangeReader
from circnav_mav.mav.signing import Signing
from circnav_mav.mav.statustext import TextReader, plain_text
from circnav_mav.pilot.connection import Connection
from circnav_mav.pilot.settings import VEHICLE, PilotSettings

TICK = 0.05
SETTLE = 2.0
"""Time, s, that the streams get to come up after the vehicle was found, before anything is measured."""
PARAMETER_PATIENCE = 10.0
"""Time, s, that slow answers about parameters may take beyond the time to listen."""


@dataclass(frozen=True, slots=True)
class RangeHeard:
    """One accepted range. stamp: sensor's clock, s. time: the same moment on ours. arrival: ours. r: slant, m."""

    stamp: float
    time: float
    arrival: float
    r: float
    sigma: float


@dataclass(frozen=True, slots=True)
class VehicleSeen:
    """The pinned vehicle as it was at the end. streams: message id -> (wanted, measured) in Hz. airspeed_told: as in
    VFR_HUD, NaN included, None without VFR_HUD. height: above the target, m, None without; height_unknown: why there is
    none although the mission wants one. boot: (our time, boot time) of an early and a late one, those that came with
    the least delay."""

    system: int
    component: int
    kind: str
    adapter: Autopilot
    firmware: str | None
    mode: int | None
    mode_name: str
    armed: bool
    heartbeat_age: float
    streams: Mapping[int, tuple[float, float]]
    motion: Motion
    airspeed_told: float | None
    height: float | None
    height_unknown: str
    battery: float | None
    boot: Span | None
    reboots: int
    round_trip: float | None
    parameters: Mapping[str, float]
    texts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Observations:
    """All that a survey has heard. links: what came in on each. rivals: second senders at the end, in words. carriers:
    ranging messages by sender and marks. end, seconds: when the listening ended and how long it measured, s. rates,
    rate_trouble: range rates heard (m/s), and why they would not count, in words."""

    vehicle: VehicleSeen | None
    links: Mapping[str, LinkCounts]
    others: Mapping[str, int]
    rivals: tuple[str, ...]
    misfits: tuple[str, ...]
    ranges: tuple[RangeHeard, ...]
    rejected: Mapping[str, int]
    carriers: Mapping[str, int]
    end: float
    seconds: float
    rates: tuple[float, ...]
    rate_trouble: str


class Survey:
    """A sans-I/O listener: `receive` bytes, send what `step` answers, until `done`; then `observations`."""

    def __init__(self, settings: PilotSettings, *, seconds: float, signing: Signing | None = None) -> None:
        """seconds: how long to measure, once the vehicle was found."""
        self._connection = Connection(settings, signing, also=[dialect.MAVLINK_MSG_ID_PARAM_VALUE])
        self.session = self._connection.session
        self.done, self.next_tick = False, float("-inf")
        self._settings = settings
        self._seconds = seconds
        self._ranging = RangeReader(settings.ranging)
        speed, max_turn_rate = settings.orbit.speed, settings.orbit.max_turn_rate
        noise = NoiseCheck.of_rates(speed, max_turn_rate)
        self._rating = RangeRateReader(settings.ranging, self._ranging, noise, speed)
        self._rates: list[float] = []
        self._height = Height(settings.height)
        self._reader: ParameterReader | None = None
        self._began: float | None = None
        self._found: float | None = None
        self._end = 0.0
        self._kind = ""
        self._airspeed: float | None = None
        self._counted: Counter[int] = Counter()
        self._boots: defaultdict[int, list[Moment]] = defaultdict(list)
        """Of each start of the vehicle."""
        self._ranges: list[RangeHeard] = []
        self._carriers: Counter[str] = Counter()
        self._texts: dict[str, None] = {}
        self._text_reader = TextReader()

    @property
    def reply_to(self) -> Hashable:
        """Where the vehicle link's bytes go."""
        return self.session.reply_to

    def receive(self, data: bytes, now: float, source: Hashable = None, link: str = VEHICLE) -> None:
        """Take in one datagram (or chunk of a stream) that arrived at `now` from `source` on a link."""
        for message, of_vehicle, of_ranging in self._connection.receive(data, now, source, link):
            if of_vehicle:
                self._take_telemetry(message, now)
            if of_ranging:
                self._take_range(message, now, source)

    def step(self, now: float) -> bytes:
        """What to send to the vehicle now."""
        if self.done or now < self.next_tick:
            return b""
        self.next_tick = now + TICK
        self._began = now if self._began is None else self._began
        messages = self.session.poll(now)
        if self.session.up:
            messages += self._questions(now)
        if self._over(now):
            self.done, self._end = True, now
            messages += self.session.farewell() if self.session.up else []
        return b"".join(map(self.session.encode, messages))

    def hello(self, now: float) -> bytes:
        """What goes out on a separate ranging link."""
        return b"" if self.done else self._connection.hello(now)

    def observations(self) -> Observations:
        """What was heard, once done."""
        return Observations(
            vehicle=self._vehicle() if self.session.up else None,
            links={link: decoder.counts for link, decoder in self._connection.decoders.items()},
            others=dict(self.session.ignored),
            rivals=tuple(self.session.identity.rivals.recent(self._end)),
            misfits=tuple(self.session.misfits.values()),
            ranges=tuple(self._ranges),
            rejected=dict(self._ranging.rejected),
            carriers=dict(self._carriers),
            end=self._end,
            seconds=self._measured_for,
            rates=tuple(self._rates),
            rate_trouble=self._rating.trouble,
        )

    def _vehicle(self) -> VehicleSeen:
        session = self.session
        wanted = {**session.adapter.firmware.streams, **self._connection.more_streams}
        return VehicleSeen(
            *session.vehicle_ids,
            kind=self._kind,
            adapter=session.adapter,
            firmware=session.vehicle.firmware,
            mode=session.vehicle.mode,
            mode_name=session.vehicle.mode_name,
            armed=session.vehicle.armed,
            heartbeat_age=session.heartbeat_age(self._end),
            streams={id: (rate, self._counted[id] / max(self._measured_for, TICK)) for id, rate in wanted.items()},
            motion=session.motion.at(self._end),
            airspeed_told=self._airspeed,
            height=self._height.at(self._end),
            height_unknown=self._height.why_unknown(self._end),
            battery=session.vehicle.battery,
            boot=quick_span(self._boots[session.vehicle.reboots]),
            reboots=session.vehicle.reboots,
            round_trip=session.timesync.typical,
            parameters=dict(self._reader.values) if self._reader else {},
            texts=tuple(self._texts),
        )

    @property
    def _measured_for(self) -> float:
        """How long the settled vehicle was listened to, s."""
        return 0.0 if self._found is None else max(self._end - self._found - SETTLE, 0.0)

    def _settled(self, now: float) -> bool:
        return self._found is not None and now - self._found >= SETTLE

    def _over(self, now: float) -> bool:
        assert self._began is not None
        if self._found is None:
            return now - self._began > self._settings.timing.wait_link
        end = self._found + SETTLE + self._seconds
        answered = self._reader is None or self._reader.done
        return now >= (end if answered else end + PARAMETER_PATIENCE)

    def _questions(self, now: float) -> list[Message]:
        """Parameters by name."""
        if self._reader is None:
            adapter, self._found = self.session.adapter, now
            names = [name for rule in adapter.parameters for name, _ in rule.names]
            self._reader = ParameterReader(names, bytewise=adapter.firmware.bytewise)
        return self._reader.poll(self.session.vehicle_ids, now)

    def _take_telemetry(self, message: Message, now: float) -> None:
        """One message of the pinned vehicle, after the session had it."""
        session, type_ = self.session, message.get_type()
        session.motion.receive(message, now)
        self._height.hear(message, session.motion.at(now).altitude, now)
        if type_ == "HEARTBEAT":
            self._kind = describe_vehicle(message)
        elif type_ == "VFR_HUD":
            self._airspeed = message.airspeed
        elif type_ == "STATUSTEXT":
            text, before = self._text_reader.read(message)
            self._texts.pop(before or "", None)
            self._texts[text] = None
        elif type_ == "PARAM_VALUE" and self._reader is not None:
            self._reader.receive(message)
        if self._settled(now):
            self._counted[message.get_msgId()] += 1
            boot_time = session.vehicle.boot_time
            if type_ in ("ATTITUDE", "ATTITUDE_QUATERNION", "SYSTEM_TIME") and boot_time is not None:
                self._boots[session.vehicle.reboots].append((now, boot_time))

    def _take_range(self, message: Message, now: float, source: Hashable) -> None:
        kind = self._connection.ranging_message
        if message.get_type() != kind.type:
            return
        if self._rating.carries(message):
            rate = self._rating.read(message, now, source=source)
            if rate is not None and self._settled(now):
                self._rates.append(rate.r_dot)
            return
        marks = ", ".join(f"{mark} {plain_text(str(value))}" for mark, value in kind.mark_values(message).items())
        self._carriers[f"{message.get_srcSystem()}/{message.get_srcComponent()} {marks}"] += 1
        peer = None if self._settings.ranging_apart else self.session.peer
        sample = self._ranging.read(message, now, source=source, vehicle=peer.source if peer else None)
        if self._ranging.rival is not None and self._ranging.trusted is not None:
            self.session.identity.rivals.heard(RADIO_NAME, self._ranging.rival, self._ranging.trusted, now)
        if sample is not None:
            self._rating.range_taken(sample)
        if sample is not None and self._settled(now):
            self._ranges.append(RangeHeard(sample.stamp, sample.time, now, sample.r, sample.sigma))
