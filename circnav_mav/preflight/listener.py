"""Preflight listener: receives vehicle and ranging data before a flight, and sends nothing that
could move the vehicle.

A `Pilot` would engage the vehicle, end the mission and report both to the ground station, even in a
dry run. The listener has no controller at all. To receive the same data as a flight, it sends our
heartbeat and stream requests. It also requests AUTOPILOT_VERSION, TIMESYNC and parameters
(PARAM_REQUEST_READ).
"""

from collections import Counter, defaultdict
from collections.abc import Hashable, Mapping
from dataclasses import dataclass

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.range_noise import NoiseCheck
from circnav_mav.mav.autopilots.interface import rules_by_parameter
from circnav_mav.mav.clocks import Moment, Span, quick_span
from circnav_mav.mav.codec import Message
from circnav_mav.mav.identity import describe_vehicle
from circnav_mav.mav.params import ParameterReader
from circnav_mav.mav.ranging.reader import RangeRateReader, RangeReader
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from circnav_mav.mav.signing import Signing
from circnav_mav.mav.statustext import TextReader, plain_text
from circnav_mav.mission.mission import VEHICLE, Mission
from circnav_mav.pilot.connection import Connection
from circnav_mav.pilot.height import Height

TICK = 0.05
"""Time between two steps, s, as in a flight."""
SETTLE = 2.0
"""Time, s, from finding the vehicle to the start of the measurement. In this time the requested
streams start."""


@dataclass(frozen=True, slots=True)
class ReceivedRange:
    """One accepted range.

    stamp: time of measurement on the sensor's clock, s.
    time: time of measurement on our clock, s.
    arrival: time of arrival on our clock, s.
    r: slant range, m.
    sigma: standard deviation of r, m.
    """

    stamp: float
    time: float
    arrival: float
    r: float
    sigma: float


class PreflightListener:
    """Preflight listener without I/O: `receive` bytes and send the bytes that `step` returns, until
    `done`. Its attributes then hold the received data."""

    def __init__(
        self, settings: Mission, *, seconds: float, signing: Signing | None = None
    ) -> None:
        """seconds: duration of the measurement, s. It begins SETTLE seconds after the vehicle was
        found."""
        also = {one.id for one in RANGING_MESSAGES.values()}
        also |= {dialect.MAVLINK_MSG_ID_PARAM_VALUE}
        self.connection = Connection(settings, signing, also=also)
        self.session = self.connection.session
        self.done = False
        self.next_tick = float("-inf")
        self._settings = settings
        self._listens = seconds
        self.ranging = RangeReader(settings.ranging, self.session.identity)
        speed = settings.orbit.speed
        max_turn_rate = settings.orbit.max_turn_rate
        noise = NoiseCheck.of_rates(speed, max_turn_rate)
        self.rate_reader = RangeRateReader(settings.ranging, self.ranging, noise, speed)
        self.ranges: list[ReceivedRange] = []
        self.rates: list[float] = []
        """Range rates, m/s."""
        self.carriers: Counter[str] = Counter()
        """Number of ranging messages by sender and by their identifying fields."""
        self.other_ranging: Counter[str] = Counter()
        """Number of messages that could contain ranges, but are not selected by the mission, by
        type and sender."""
        self.height = Height(settings.file.orbit)
        self.kind = ""
        """Autopilot and type of the vehicle, human-readable."""
        self.airspeed: float | None = None
        """Airspeed of VFR_HUD, m/s, may be NaN. None without VFR_HUD."""
        self.texts: dict[str, None] = {}
        self.end = 0.0
        """Time when the listening ended, s."""
        self._parameters: ParameterReader | None = None
        self._began: float | None = None
        self._found: float | None = None
        self._counted: Counter[int] = Counter()
        self._boots: defaultdict[int, list[Moment]] = defaultdict(list)
        """Pairs (our time, time since boot), s, by number of reboots so far."""
        self._text_reader = TextReader()

    def receive(
        self, data: bytes, now: float, source: Hashable = None, link: str = VEHICLE
    ) -> None:
        """Process a datagram (or chunk of a stream) that arrived at `now` from `source` on a
        link."""
        for message, of_vehicle, of_ranging in self.connection.receive(data, now, source, link):
            if of_vehicle:
                self._take_telemetry(message, now)
            if of_ranging:
                self._take_range(message, now, source)
            elif any(message.get_msgId() == one.id for one in RANGING_MESSAGES.values()):
                sender = f"{message.get_srcSystem()}/{message.get_srcComponent()}"
                self.other_ranging[f"{message.get_type()} of {sender}"] += 1

    def step(self, now: float) -> bytes:
        """Return the bytes to send to the vehicle now."""
        if self.done or now < self.next_tick:
            return b""
        self.next_tick = now + TICK
        self._began = now if self._began is None else self._began
        messages = self.session.poll(now)
        if self.session.up:
            messages += self._questions(now)
        if self._over(now):
            self.done = True
            self.end = now
            messages += self.session.farewell() if self.session.up else []
        return b"".join(map(self.session.encode, messages))

    def hello(self, now: float) -> bytes:
        """Return the frames for a separate ranging link."""
        return b"" if self.done else self.connection.hello(now)

    # --- received data, once done

    @property
    def seconds(self) -> float:
        """Duration of the measurement, s; 0 if no vehicle was found."""
        return 0.0 if self._found is None else max(self.end - self._found - SETTLE, 0.0)

    @property
    def streams(self) -> Mapping[int, tuple[float, float]]:
        """Requested and measured rate of each stream, message id -> (requested, measured), Hz."""
        wanted = {**self.session.adapter.firmware.streams, **self.connection.more_streams}
        return {
            id: (rate, self._counted[id] / max(self.seconds, TICK)) for id, rate in wanted.items()
        }

    @property
    def boot(self) -> Span | None:
        """Pairs (our time, time since boot), s, of the least delayed messages in the first and in
        the last third of the measurement."""
        return quick_span(self._boots[self.session.vehicle.reboots])

    @property
    def parameters(self) -> Mapping[str, float]:
        """Parameters received from the vehicle."""
        return self._parameters.values if self._parameters else {}

    # --- while listening

    def _settled(self, now: float) -> bool:
        return self._found is not None and now - self._found >= SETTLE

    def _over(self, now: float) -> bool:
        assert self._began is not None
        if self._found is None:
            return now - self._began > self._settings.file.link.wait_s
        end = self._found + SETTLE + self._listens
        answered = self._parameters is None or self._parameters.done
        # 10.0: longest time, s, for which the listener waits for missing parameters after the
        # measurement.
        return now >= (end if answered else end + 10.0)

    def _questions(self, now: float) -> list[Message]:
        """Return the parameter requests that are due."""
        if self._parameters is None:
            adapter = self.session.adapter
            self._found = now
            methods = self._settings.methods(type(adapter))
            names = [
                name
                for rules in rules_by_parameter(methods).values()
                for rule in rules
                for name in rule.requested
            ]
            self._parameters = ParameterReader(names, bytewise=adapter.firmware.bytewise)
        return self._parameters.poll(self.session.vehicle_ids, now)

    def _take_telemetry(self, message: Message, now: float) -> None:
        """Process a message of the vehicle, after the session has processed it."""
        session = self.session
        type_ = message.get_type()
        session.motion.receive(message, now)
        self.height.receive(message, session.motion.at(now), now)
        if type_ == "HEARTBEAT":
            self.kind = describe_vehicle(message)
        elif type_ == "VFR_HUD":
            self.airspeed = message.airspeed
        elif type_ == "STATUSTEXT":
            text, before = self._text_reader.read(message)
            self.texts.pop(before or "", None)
            self.texts[text] = None
        elif type_ == "PARAM_VALUE" and self._parameters is not None:
            self._parameters.receive(message)
        if self._settled(now):
            self._counted[message.get_msgId()] += 1
            boot_time = session.vehicle.boot.newest
            if (
                type_ in ("ATTITUDE", "ATTITUDE_QUATERNION", "SYSTEM_TIME")
                and boot_time is not None
            ):
                self._boots[session.vehicle.reboots].append((now, boot_time))

    def _take_range(self, message: Message, now: float, source: Hashable) -> None:
        if self.rate_reader.carries(message):
            rate = self.rate_reader.read(message, now, source=source)
            if rate is not None and self._settled(now):
                self.rates.append(rate.r_dot)
            return
        marks = self.connection.ranging_message.mark_values(message)
        words = ", ".join(f"{mark} {plain_text(str(value))}" for mark, value in marks.items())
        self.carriers[f"{message.get_srcSystem()}/{message.get_srcComponent()} {words}"] += 1
        answer = self.ranging.read(message, now, source=source)
        if answer is None:
            return
        self.rate_reader.range_taken(answer)
        sample = answer.sample
        if self._settled(now):
            self.ranges.append(
                ReceivedRange(sample.stamp, sample.time, now, sample.r, sample.sigma)
            )
