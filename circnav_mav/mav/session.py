"""MAVLink session with one vehicle: our heartbeat, commands, streams and time synchronization.

See `identity` for the vehicle's ids and address, and `vehicle_state` for its reported state.
"""

from collections import deque
from collections.abc import Hashable, Mapping

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.interface import Autopilot
from circnav_mav.mav.clocks import Timesync
from circnav_mav.mav.codec import Encoder, Ids, Message, ids
from circnav_mav.mav.commands import Command, CommandResult, CommandSender, StreamRequests, once
from circnav_mav.mav.identity import OUR_NAME, Identity, LinkSettings, Sender
from circnav_mav.mav.own_motion import ACCELERATIONS, OwnMotionSensor
from circnav_mav.mav.signing import Signing
from circnav_mav.mav.statustext import Announcer
from circnav_mav.mav.vehicle_state import Change, VehicleState
from circnav_mav.timers import Every

HEARTBEAT_PERIOD = 1.0
"""Time between two of our heartbeats, s (MAVLink: 1 Hz)."""
LOST_AFTER = 3.0
"""Time without a mode report, s, after which the link is treated as lost (value of MAVSDK)."""
TWIN_FRAMES = 4
"""Number of foreign frames with our ids, within TWIN_WITHIN, that indicates another companion.
Another companion sends at least one heartbeat per second. Fewer frames are stray frames."""
TWIN_WITHIN = 10.0
"""Time in which foreign frames with our ids are counted, s."""
WAITING = dialect.MAV_STATE_BOOT
"""State in circnav's heartbeat until it steers the vehicle. A circnav that already steers ignores
heartbeats with this state from a second circnav."""
ECHO_RATE = 4.0
"""Requested rate of the vehicle's setpoint reports, Hz."""
AIR_DATA = ("VFR_HUD", "GLOBAL_POSITION_INT")
"""Messages with airspeed, climb rate and altitudes. Positions in them are never read."""
ECHOES = ("POSITION_TARGET_LOCAL_NED", "ATTITUDE_TARGET", "NAV_CONTROLLER_OUTPUT")
HANDLED = frozenset(
    getattr(dialect, f"MAVLINK_MSG_ID_{name}")
    for name in (
        *VehicleState.READERS,
        "COMMAND_ACK",
        "TIMESYNC",
        *AIR_DATA,
        *ACCELERATIONS,
        *ECHOES,
    )
)
"""Ids of the messages that the session, the motion sensor or `Pilot` reads."""


class Session:
    """All communication with the vehicle, except setpoints and ranging."""

    def __init__(
        self,
        settings: LinkSettings,
        adapters: tuple[Autopilot, ...],
        more_streams: Mapping[int, float] | None = None,
        signing: Signing | None = None,
    ) -> None:
        """adapters: one adapter for each vehicle that the mission allows. The identified vehicle
        selects its adapter.
        more_streams: further message ids with their requested rates, Hz.
        """
        self._more_streams = dict(more_streams or {})
        self._heartbeat_timer = Every(HEARTBEAT_PERIOD)
        self._replies: list[Message] = []
        self._mode_results: deque[CommandResult] = deque(maxlen=8)
        # Number of our newest frames that are kept to recognize an echo: the frames of twenty
        # seconds.
        self._sent: deque[bytes] = deque(maxlen=1024)
        self._changes: set[Change] = set()
        self._twin_received: deque[float] = deque(maxlen=TWIN_FRAMES)
        self.identity = Identity(settings, adapters)
        self.vehicle = VehicleState(self.identity)
        self.encoder = Encoder(settings.system_id or 1, settings.component_id, signing)
        self.commands = CommandSender()
        self.airspeed_refused = False
        """True if the autopilot has refused to change its airspeed."""
        self.streams = StreamRequests({})
        self.timesync = Timesync()
        self.motion = OwnMotionSensor(self.timesync.slower)
        self.announcer = Announcer()
        self.mode_requests_dropped = 0
        """Number of mode requests that were dropped before their answer."""

    @property
    def peer(self) -> Sender | None:
        """The pinned vehicle, or None."""
        return self.identity.peer

    @property
    def up(self) -> bool:
        return self.peer is not None

    @property
    def us(self) -> Ids:
        """Our own system and component id."""
        return self.encoder.ids

    @property
    def adapter(self) -> Autopilot:
        """Adapter of the pinned vehicle. Before a vehicle is found, the adapter of the first
        vehicle that the mission allows."""
        return self.identity.adapter

    @property
    def vehicle_ids(self) -> Ids:
        """(system, component) of the vehicle, (0, 0) without a vehicle."""
        return self.peer.ids if self.peer else (0, 0)

    @property
    def reply_to(self) -> Hashable:
        """Address that our frames are sent to, or None."""
        return self.identity.reply_to

    def heartbeat_age(self, now: float) -> float:
        return now - self.vehicle.received_at

    @property
    def doubled(self) -> bool:
        """True if another companion sends with our ids."""
        received = self._twin_received
        return len(received) == TWIN_FRAMES and received[-1] - received[0] <= TWIN_WITHIN

    def contested(self, now: float) -> str:
        """Return a text if another companion with our ids may steer the vehicle, else an empty
        string."""
        received = self._twin_received
        if received and now - received[-1] <= TWIN_WITHIN:
            return f"another companion sends with our ids {self.us[0]}/{self.us[1]}"
        # 1.0: time, s, from the vehicle's first heartbeat in which circnav listens for another
        # companion with our ids. Such a companion sends a heartbeat and a TIMESYNC request in each
        # second.
        return "listening for other companions" if now - self.identity.since < 1.0 else ""

    def missing(self, now: float) -> list[str]:
        """Return the names of the motion values that the adapter needs and the vehicle does not
        report."""
        motion = self.motion.at(now)
        return sorted(name for name in self.adapter.needs if getattr(motion, name) is None)

    # --- in ---

    def receive(self, message: Message, now: float, source: Hashable) -> bool:
        """Process one message. Return True if it is from the pinned vehicle. Other senders'
        messages do not change the vehicle's state."""
        before = self.peer
        if before is not None and ids(message) == self.us:
            self._in_our_name(message, before, source, now)
            return False
        ours = self.identity.receive(message, source, now, continues=self.vehicle.continues)
        if self.peer is not None and self.peer != before:
            self._pinned(self.peer, new_vehicle=before is None)
        if not ours:
            return False
        self.streams.received(message.get_msgId())
        change = self.vehicle.receive(message, now)
        if change is Change.REBOOTED:
            self.streams.restart()
        if change is not None:
            self._changes.add(change)
        if message.get_type() == "COMMAND_ACK":
            self.commands.acknowledge(message, self.us, now)
        elif message.get_type() == "TIMESYNC":
            self._sync(message, now)
        return True

    def _sync(self, message: Message, now: float) -> None:
        """Process the answer to our TIMESYNC request, or answer a request of the vehicle."""
        if message.tc1:
            self.timesync.received(message.ts1, now)
        # 4: largest number of TIMESYNC answers in one step. A flood of requests is not answered.
        elif len(self._replies) < 4:
            # answer a request (tc1 = 0) with our clock in ns and the mirrored time of its sender
            self._replies.append(dialect.MAVLink_timesync_message(int(now * 1e9) or 1, message.ts1))

    def take_changes(self) -> set[Change]:
        """Return the changes of the vehicle's state since the last call."""
        changes = self._changes
        self._changes = set()
        return changes

    def change_method(self, adapter: Autopilot) -> None:
        """Steer the pinned vehicle by another method from now on. Until the vehicle reports the new
        guided mode, its old guided mode is treated as ours, too."""
        adapter.our_modes = frozenset((adapter.guided_mode, self.adapter.guided_mode))
        self.identity.change_method(adapter)
        if adapter.echo is not None:
            self.commands.send(
                Command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, (adapter.echo, 1e6 / ECHO_RATE))
            )

    def lose(self) -> None:
        """Release the pinned vehicle after it has become silent."""
        self.vehicle.lost()
        self.identity.peer = None
        self.commands.clear()

    def _in_our_name(self, message: Message, peer: Sender, source: Hashable, now: float) -> None:
        """Process a message with our ids: an echo of our own frame, or a frame from another
        companion."""
        # The vehicle has forwarded a foreign frame that arrives from its address: another companion
        # is connected to the vehicle. From another address, any sender may use our ids.
        if bytes(message.get_msgbuf()) in self._sent:
            self.identity.ignored["echo"] += 1
        elif source == peer.source:
            self.identity.ignored["twin"] += 1
            # A second circnav must not end the flight of the first circnav. Once the vehicle is
            # steered, only the heartbeats of a companion that may steer too are counted.
            waits = message.get_type() != "HEARTBEAT" or message.system_status == WAITING
            if not (self.identity.stays and waits):
                self._twin_received.append(now)
        else:
            self.identity.second_senders.received(
                OUR_NAME, Sender(*self.us, source), Sender(*self.us, "this computer"), now
            )

    def _pinned(self, peer: Sender, *, new_vehicle: bool) -> None:
        """Prepare the session for a vehicle that was found, or has moved to another address."""
        self.encoder.system = peer.system
        if not new_vehicle:
            self.vehicle.moved()
        else:
            self.vehicle.found()
            echo = {} if self.adapter.echo is None else {self.adapter.echo: ECHO_RATE}
            wanted = {**self.adapter.firmware.streams, **echo, **self._more_streams}
            self.streams = StreamRequests(wanted, maybe=echo)
            self._request(dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        if self.vehicle.unproven:
            self._request(dialect.MAVLINK_MSG_ID_SYSTEM_TIME)

    def _request(self, ident: int) -> None:
        """Request one message of this id."""
        self.commands.send(Command(dialect.MAV_CMD_REQUEST_MESSAGE, (ident,)))

    # --- out ---

    def encode(self, message: Message) -> bytes:
        """Encode one frame with our ids.

        The frame is remembered, so that its echo or its answer is not attributed to another
        companion.
        """
        frame = self.encoder.encode(message)
        if message.get_type() in ("COMMAND_LONG", "COMMAND_INT"):
            self.commands.sent(message.command)
        self._sent.append(frame)
        return frame

    def poll(self, now: float) -> list[Message]:
        """Return the messages due now: our heartbeat, commands, texts. Call only in a step without
        errors."""
        messages = self.heartbeats_due(now) + self._replies
        self._replies = []
        if self.peer is not None:
            for result in self.commands.take_results():
                if result.command.number == dialect.MAV_CMD_DO_SET_MODE:
                    self._mode_results.append(result)  # read by take_mode_results
                elif result.command.number == self.adapter.airspeed_command:
                    self.airspeed_refused |= result.refused
                elif (
                    result.command.number == dialect.MAV_CMD_SET_MESSAGE_INTERVAL and result.refused
                ):
                    self.streams.denied(result)
            for request in self.streams.poll(now):
                self.commands.send(request)
            messages += self.commands.poll(
                self.peer.ids, now, self.heartbeat_age(now)
            ) + self.timesync.poll(now)
            messages += self.announcer.texts(now)
        return messages

    def take_mode_results(self) -> list[CommandResult]:
        results = list(self._mode_results)
        self._mode_results.clear()
        return results

    def drop_mode_requests(self) -> None:
        """Drop mode requests. Call after the mode was reached, or after the operator has chosen
        another mode or may have done so."""
        self.mode_requests_dropped += self.commands.drop(dialect.MAV_CMD_DO_SET_MODE)
        self._mode_results.clear()

    def farewell(self) -> list[Message]:
        """Return the commands that restore our vehicle's own stream rates, even if it is lost.
        Answers are ignored."""
        home = self.identity.home
        return (
            []
            if home is None or self.doubled  # the other companion still needs the streams
            else [once(command, home.ids) for command in self.streams.give_back()]
        )

    def heartbeats_due(self, now: float) -> list[Message]:
        """Return our heartbeat when it is due."""
        return [self.heartbeat()] if self._heartbeat_timer.due(now) else []

    def heartbeat(self) -> Message:
        """Return our heartbeat as an onboard controller of the vehicle's system.

        A ground station's heartbeat would keep the operator's GCS failsafe from triggering.
        """
        return dialect.MAVLink_heartbeat_message(
            dialect.MAV_TYPE_ONBOARD_CONTROLLER,
            dialect.MAV_AUTOPILOT_INVALID,
            0,
            0,
            dialect.MAV_STATE_ACTIVE if self.identity.stays else WAITING,
            3,
        )
