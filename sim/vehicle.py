"""The vehicle: bytes in, bytes out, simulated time carried forward by the caller. No sockets, no clock, no threads."""

from collections import deque
from collections.abc import Callable
from functools import partial

from pymavlink.dialects.v20 import all as mavlink

from sim.agenda import NEVER, Agenda
from sim.commands import COMMAND_INT, COMMAND_LONG, Commands
from sim.config import VehicleConfig
from sim.flight import Flight, Truth
from sim.links import HEARTBEAT, TYPE_GCS, Link, Router
from sim.radio import MESSAGES
from sim.sensor import RangeSensor, Sample
from sim.services import Services
from sim.streams import Streams
from sim.truth import sim_state, truth_array
from sim.wire import Message, Sender

__all__ = ["Truth", "Vehicle"]

AUTOPILOT_COMPONENT = 1
MAIN, RANGING = "main", "ranging"
SECOND = 1_000_000
SETPOINTS = frozenset({69, 82, 84, 86})
REMEMBERED = 100_000
TEXT_LENGTH = 50


class Vehicle:
    """One MAVLink vehicle in lockstep: the same config and the same bytes at the same times give the same flight."""

    def __init__(self, config: VehicleConfig) -> None:
        self.config = config
        self._agenda = Agenda()
        self._links: dict[str, Link] = {}
        self._flight = Flight(config, self._say)
        own = (config.vehicle.system_id, AUTOPILOT_COMPONENT)
        self._router = Router(own, self._flight.autopilot.identity.unknown_ids)
        self._streams = Streams(self._agenda, self._flight)
        self._services = Services(self._flight, self._streams)
        self._commands = Commands(self._flight, self._streams, self._say)
        self._setpoints: deque[tuple[float, str]] = deque(maxlen=REMEMBERED)
        self._link(MAIN)
        self._set_up_radio()
        if config.truth.rate_hz > 0:
            self._repeat("truth", round(SECOND / config.truth.rate_hz), self._send_truth, 0)

    # -- the public side ----------------------------------------------------------------------------------------------

    def receive(self, data: bytes, link: str = MAIN) -> None:
        """One datagram heard on a link, handled at the current simulated time. Never raises, whatever it holds."""
        source = self._link(link)
        for message in source.parser.messages(data):
            self._hear(message, source)

    def advance(self, until: float) -> None:
        """Fly to simulated time `until`, s; going back in time does nothing."""
        goal = round(until * SECOND)
        while (due := self._agenda.next_due()) <= goal:
            self._flight.run(max(due, self._flight.now))
            self._agenda.take()()
        self._flight.run(max(goal, self._flight.now))

    def outgoing(self, link: str = MAIN) -> list[bytes]:
        """What has been sent on a link since the last call: whole MAVLink frames, oldest first."""
        return self._link(link).drain()

    @property
    def next_event(self) -> float:
        """Simulated time at which something is next due, s."""
        return min(self._agenda.next_due(), self._flight.next_due(), NEVER) / SECOND

    @property
    def time(self) -> float:
        return self._flight.seconds

    @property
    def truth(self) -> Truth:
        return self._flight.truth()

    @property
    def setpoint_log(self) -> list[tuple[float, str]]:
        """Accepted setpoints: simulated time, s, and message name; the last hundred thousand."""
        return list(self._setpoints)

    @property
    def links(self) -> tuple[str, ...]:
        return tuple(self._links)

    # -- hearing ------------------------------------------------------------------------------------------------------

    def _hear(self, message: Message, source: Link) -> None:
        if source.name == RANGING:
            return  # the radio's own wire: it listens to nobody
        if not self._router.pass_on(message, source, self._autopilot_links()):
            return
        flight, number = self._flight, message.get_msgId()
        if number in (COMMAND_LONG, COMMAND_INT):
            self._commands.obey(message, source)
        elif number in SETPOINTS:
            if flight.autopilot.setpoint(message, flight.now, flight.body):
                self._setpoints.append((flight.seconds, message.get_type()))
        elif not self._services.answer(message, source):
            if number == HEARTBEAT and message.type == TYPE_GCS:
                source.gcs_heard = True
            flight.autopilot.heard(message, flight.now)

    # -- sending ------------------------------------------------------------------------------------------------------

    def _link(self, name: str) -> Link:
        found = self._links.get(name)
        if found is None:
            airframe = self.config.vehicle
            found = self._links[name] = Link(name, airframe.system_id, AUTOPILOT_COMPONENT, airframe.mavlink_version)
            if name != RANGING:
                self._open(found)
        return found

    def _open(self, link: Link) -> None:
        """A new wire to the autopilot: its heartbeat at once, and whatever this autopilot sends unasked."""
        defaults = {HEARTBEAT: SECOND, **self._flight.autopilot.identity.default_streams}
        for number, interval in defaults.items():
            self._streams.run(link, number, interval)
        self._agenda.put(("first", link.name), self._flight.now, partial(self._greet, link))

    def _greet(self, link: Link) -> None:
        self._streams.send_once(link, HEARTBEAT)

    def _autopilot_links(self) -> list[Link]:
        return [link for link in self._links.values() if link.name != RANGING]

    def _say(self, severity: int, text: str) -> None:
        message = mavlink.MAVLink_statustext_message(severity, text.encode()[:TEXT_LENGTH])
        for link in self._autopilot_links():
            link.send(message)

    def _send_truth(self) -> None:
        messages = (sim_state(self._flight), truth_array(self._flight))
        for link in self._autopilot_links():
            for message in messages:
                link.send(message)

    def _repeat(self, name: str, interval: int, action: Callable[[], None], first: int) -> None:
        def run(due: int) -> None:
            action()
            self._agenda.put((name,), due + interval, partial(run, due + interval))

        self._agenda.put((name,), first, partial(run, first))

    # -- ranging ------------------------------------------------------------------------------------------------------

    def _set_up_radio(self) -> None:
        ranging = self.config.ranging
        self._sensor = RangeSensor(ranging, self.config.seed)
        self._radio_sender = Sender(ranging.system_id, ranging.component_id, self.config.vehicle.mavlink_version)
        self._radio_wire = Link("radio", ranging.system_id, ranging.component_id, self.config.vehicle.mavlink_version)
        if ranging.via == "direct":
            self._link(RANGING)
        if ranging.rate_hz > 0:
            self._repeat("range", round(SECOND / ranging.rate_hz), self._measure, 0)
        if ranging.via == "forwarded":
            self._repeat("radio heartbeat", SECOND, self._radio_heartbeat, SECOND // 2)

    def _measure(self) -> None:
        now = self._flight.now
        sample = self._sensor.measure(self._flight.slant_range(), now)
        if sample is None:
            return
        latency = round(self.config.ranging.latency_s * SECOND)
        if latency == 0:
            self._report(sample)
        else:
            self._agenda.put(("report", sample.taken_us), now + latency, partial(self._report, sample))

    def _report(self, sample: Sample) -> None:
        ranging = self.config.ranging
        if ranging.via == "autopilot":
            self._flight.rangefinder.update(sample, self._flight.now)
            return
        self._radio_sends(MESSAGES[ranging.message](ranging, sample))

    def _radio_heartbeat(self) -> None:
        self._radio_sends(mavlink.MAVLink_heartbeat_message(0, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3))

    def _radio_sends(self, message: Message) -> None:
        frame = self._radio_sender.frame(message)
        if frame is None:
            return
        if self.config.ranging.via == "direct":
            self._link(RANGING).waiting.append(frame)
        else:
            self._hear(message, self._radio_wire)
