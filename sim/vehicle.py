"""The vehicle: it receives and sends bytes, and the caller advances its simulated time. No sockets,
no clock, no threads."""

import itertools
from collections import deque
from functools import partial

from pymavlink.dialects.v20 import all as mavlink

from .agenda import NEVER, Agenda
from .config import Event, VehicleConfig
from .flight import DRIFT_STEP_US, Flight, Truth
from .links import TYPE_GCS, Link, Message, Router
from .ranging_radio import SECOND, RangingRadio
from .sensor import Sample
from .services import Services, Streams
from .signing import UNSIGNED_BY_ARDUPILOT, UNSIGNED_BY_PX4, FrameSigning, read_key
from .steering import WEAK, Steering
from .telemetry import sim_state, truth_array
from .world import Air

__all__ = ["Truth", "Vehicle"]

AUTOPILOT_COMPONENT = 1
MAIN = "main"
RANGING = "ranging"
SETPOINTS = frozenset(
    {
        "MANUAL_CONTROL",
        "SET_ATTITUDE_TARGET",
        "SET_POSITION_TARGET_LOCAL_NED",
        "SET_POSITION_TARGET_GLOBAL_INT",
    }
)
MAX_SETPOINT_LOG = 2_000
TEXT_LENGTH = 50
REBOOT_S = 2.0


class Vehicle:
    """One MAVLink vehicle in lockstep: equal configuration and equal bytes at equal times give the
    same flight."""

    def __init__(self, config: VehicleConfig) -> None:
        self.config = config
        self._agenda = Agenda()
        self._links: dict[str, Link] = {}
        self._rebooting = False
        self._muted = False  # by the event mute_autopilot
        self._text_ids = itertools.cycle(range(1, 65536))
        self._flight = Flight(config, self._say)
        identity = self._flight.autopilot.identity
        signing = config.signing
        px4 = config.vehicle.profile.startswith("px4")
        key = None if signing.key_file is None else read_key(signing.key_file, "signing.key_file")
        self._signing = FrameSigning(
            key, UNSIGNED_BY_PX4 if px4 else UNSIGNED_BY_ARDUPILOT, signing.accept_unsigned
        )
        own = (config.vehicle.system_id, AUTOPILOT_COMPONENT)
        self._router = Router(own, identity.unknown_ids, identity.adopts_strays)
        self._streams = Streams(self._agenda, self._flight)
        self._services = Services(self._flight, self._streams, self._say)
        self._setpoints: deque[tuple[float, str]] = deque(maxlen=MAX_SETPOINT_LOG)
        self._steering = Steering(config.vehicle.steering)
        self._link(MAIN)
        ranging = config.ranging
        version = config.vehicle.mavlink_version
        self._radio_wire = Link(
            "radio", ranging.system_id, ranging.component_id, version, self._signing
        )
        # The router forwards broadcasts to every component that has sent a message, also to the
        # radio. The radio reads no messages, so its queue would grow in a long flight.
        self._radio_wire.silent = True
        if ranging.via == "direct":
            self._link(RANGING)
        self._radio = RangingRadio(
            config, self._agenda, self._flight, self._radio_sends, self._driver
        )
        self._schedule_world()

    def receive(self, data: bytes, link: str = MAIN, *, stream: bool = False) -> None:
        """Handle one datagram, or a piece of a stream, from a link at the current simulated time.
        Never raises."""
        source = self._link(link)
        for message in source.messages(data, stream=stream):
            if self._signing.accepts(message):
                self._handle(message, source)

    def set_time(self, unix: float) -> None:
        """Set the time of the GPS, s since 1970. The timestamps of signatures use this time."""
        self._signing.set_time(unix)

    def range_node(self, node: int, distance: float) -> None:
        """Let the radio measure the distance to another radio, m. node: its id."""
        self._radio.range_node(node, distance)

    @property
    def refused(self) -> int:
        """Number of frames refused because of a missing or invalid signature."""
        return self._signing.refused

    def advance(self, until: float) -> None:
        """Fly to simulated time `until`, s. A time in the past has no effect."""
        goal = round(until * SECOND)
        while (due := self._agenda.next_due()) <= goal:
            self._flight.run(max(due, self._flight.now))
            self._agenda.take()()
        self._flight.run(max(goal, self._flight.now))

    def outgoing(self, link: str = MAIN) -> list[bytes]:
        """Return the frames sent on a link since the last call: whole MAVLink frames, oldest
        first."""
        return self._link(link).drain()

    @property
    def next_event(self) -> float:
        """Simulated time of the next action, s."""
        flight = self._flight
        return (
            min(self._agenda.next_due(), max(flight.now, flight.autopilot.wake_us()), NEVER)
            / SECOND
        )

    @property
    def time(self) -> float:
        return self._flight.seconds

    @property
    def truth(self) -> Truth:
        return self._flight.truth()

    @property
    def setpoint_log(self) -> list[tuple[float, str]]:
        """Accepted setpoints: simulated time in s and message name; the newest 2000."""
        return list(self._setpoints)

    @property
    def links(self) -> tuple[str, ...]:
        return tuple(self._links)

    def _handle(self, message: Message, source: Link) -> None:
        if source.name == RANGING or self._rebooting:
            return  # neither the radio's own link nor a rebooting autopilot receives messages
        if not self._router.pass_on(message, source, self._autopilot_links()):
            return
        flight = self._flight
        kind = message.get_type()
        if kind in SETPOINTS:
            if flight.autopilot.setpoint(self._steering.flown(message), flight.now):
                self._setpoints.append((flight.seconds, kind))
        elif not self._services.answer(message, source):
            if kind == "HEARTBEAT" and message.type == TYPE_GCS:
                source.has_gcs = True
            # PX4 passes a received DISTANCE_SENSOR to its rangefinder driver, which sends it on all
            # links as its own.
            if kind == "DISTANCE_SENSOR" and flight.autopilot.identity.ranges_on_update:
                self._driver(Sample(flight.now, message.current_distance / 100, 0))
            flight.autopilot.on_message(message, flight.now)

    def _link(self, name: str) -> Link:
        if name not in self._links:
            airframe = self.config.vehicle
            link = Link(
                name,
                airframe.system_id,
                AUTOPILOT_COMPONENT,
                airframe.mavlink_version,
                self._signing,
            )
            self._links[name] = link
            link.silent = self._muted and name != RANGING
            if name != RANGING and not self._rebooting:
                self._streams.open(link)
        return self._links[name]

    def _autopilot_links(self) -> list[Link]:
        return [link for link in self._links.values() if link.name != RANGING]

    def _say(self, severity: int, text: str) -> None:
        """Send a STATUSTEXT. A long text is sent in numbered chunks with the same id."""
        data = text.encode()
        number = 0 if len(data) <= TEXT_LENGTH else next(self._text_ids)
        starts = range(
            0, len(data) + (number > 0), TEXT_LENGTH
        )  # the last chunk has room for a final zero byte
        for link in self._autopilot_links():
            if link.has_gcs or not self._flight.autopilot.identity.texts_for_gcs_only:
                for chunk, at in enumerate(starts):
                    part = data[at : at + TEXT_LENGTH]
                    link.send(mavlink.MAVLink_statustext_message(severity, part, number, chunk))

    def _send_truth(self) -> None:
        if self._rebooting:
            return
        state = sim_state(self._flight)
        truth = truth_array(self._flight)
        for link in self._autopilot_links():
            link.send(state)
            link.send(truth)

    def _schedule_world(self) -> None:
        rate = self.config.truth.rate_hz
        if rate > 0:
            self._agenda.every(("truth",), round(SECOND / rate), 0, self._send_truth)
        if self._flight.air.gusty:
            self._agenda.every(("gusts",), Air.GUST_STEP_US, 0, self._flight.air.gust)
        if self.config.sensors.gps_error_m > 0 or any(
            event.action.startswith("gps_") for event in self.config.events
        ):
            self._agenda.every(("position",), DRIFT_STEP_US, 0, self._flight.step_position_error)
        if self.config.attitude_error > 0 or self.config.unaided_tilts:
            self._agenda.every(("estimate",), DRIFT_STEP_US, 0, self._flight.step_estimate_error)
        for i, event in enumerate(self.config.events):
            self._agenda.put(
                ("event", i), round(event.at_s * SECOND), partial(self._run_event, event)
            )

    def _run_event(self, event: Event) -> None:
        flight = self._flight
        action = event.action
        if action.endswith("mute_ranging"):
            self._radio.muted = action == "mute_ranging"
        elif action.endswith("freeze_ranging"):
            self._radio.frozen = action == "freeze_ranging"
        elif action.endswith("mute_autopilot"):
            self._muted = action == "mute_autopilot"
            for link in self._autopilot_links():
                link.silent = self._muted
        elif action == "reboot":
            self._reboot(REBOOT_S if event.value is None else event.value)
        elif action == "battery":
            flight.charge(max(0.0, min(100.0, event.value or 0.0)))
        elif action == "heading_drift":
            flight.instruments.drift(event.value or 0.0, flight.seconds)
        elif action == "ekf_zero":
            flight.ekf_zeros = round(event.value or 1)
        elif action.startswith("lose_mode_"):
            self._services.lose(action.removeprefix("lose_mode_"), round(event.value or 1))
        elif action == "accel_bias":
            flight.instruments.level_bias = event.value or 0.0
        elif action.startswith("imu_"):
            flight.instruments.imu_state = action.removeprefix("imu_")
        elif action.startswith("steering_"):
            self._steering.state = action.removeprefix("steering_")
            self._steering.share = WEAK if event.value is None else event.value
        elif action == "set_home":
            flight.set_home(event.value)
        elif action == "wind":
            flight.air.blow(event.value or 0.0)
        elif action == "wind_from":
            flight.air.turn(event.value or 0.0)
        else:
            flight.autopilot.on_event(event, flight.now)

    def _reboot(self, seconds: float) -> None:
        """Stop for `seconds`, then restart the autopilot. Its clock starts at zero, without routes
        and with only the default streams."""
        self._rebooting = True
        self._flight.reboot()
        self._signing.reboot()
        self._router.forget()
        self._agenda.drop_all("stream")
        for link in self._autopilot_links():
            link.intervals.clear()
        self._agenda.put(("boot",), self._flight.now + round(seconds * SECOND), self._boot)

    def _boot(self) -> None:
        self._rebooting = False
        self._flight.booted = self._flight.now
        for link in self._autopilot_links():
            link.has_gcs = False
            self._streams.open(link)

    def _radio_sends(self, message: Message) -> None:
        frame = self._radio_wire.frame(message)
        if frame is None:
            return
        if self.config.ranging.via == "direct":
            self._link(RANGING).waiting.append(frame)
        else:
            self._handle(message, self._radio_wire)

    def _driver(self, sample: Sample) -> None:
        """Pass a sample to the autopilot's rangefinder port."""
        self._flight.receive_range(sample)
        if self._flight.autopilot.identity.ranges_on_update and not self._rebooting:
            self._streams.range_updated(self._autopilot_links())
