"""The conversation with one vehicle: our heartbeat, commands, streams, time. See `identity` for who the vehicle is, and
`vehicle_state` for what it reports."""

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
from circnav_mav.mav.vehicle_state import READ, VehicleState

HEARTBEAT_PERIOD = 1.0
"""Time, s, between two heartbeats (MAVLink: 1 Hz)."""
LOST_AFTER = 3.0
"""Silence of the vehicle about its mode, s, after which the link counts as lost (MAVSDK's figure)."""
SENT_KEPT = 1024
"""Frames of ours that are remembered: twenty seconds of them, by which an echo is known."""
TWIN_FRAMES, TWIN_WITHIN = 4, 10.0
"""So many frames in our name that we did not send, within so many seconds, are of another companion: it says at least a
heartbeat a second. A stray one now and then is nobody's."""
MOST_REPLIES = 4
"""Answers to TIMESYNC in one step at most: a flood is not answered."""
ECHO_RATE = 4.0
"""Rate, Hz, of the vehicle's reports of the setpoint that it flies."""
ECHOES = ("POSITION_TARGET_LOCAL_NED", "ATTITUDE_TARGET", "NAV_CONTROLLER_OUTPUT")
HANDLED = frozenset(
    getattr(dialect, f"MAVLINK_MSG_ID_{name}")
    for name in (*READ, "COMMAND_ACK", "TIMESYNC", "VFR_HUD", *ACCELERATIONS, *ECHOES)
)
"""Ids of the messages that a session, the motion sensor or the pilot reads."""


class Session:
    """Everything between us and the vehicle, except setpoints and ranging."""

    def __init__(
        self,
        settings: LinkSettings,
        adapters: tuple[Autopilot, ...],
        more_streams: Mapping[int, float] | None = None,
        signing: Signing | None = None,
    ) -> None:
        """adapters: the vehicles that the mission allows; the pinned vehicle picks one. more_streams: id -> Hz."""
        self._component = settings.component_id
        self._more_streams = dict(more_streams or {})
        self._next_heartbeat = float("-inf")
        self._replies: list[Message] = []
        self._mode_results: deque[CommandResult] = deque(maxlen=8)
        self._sent: deque[bytes] = deque(maxlen=SENT_KEPT)
        self._twin_heard: deque[float] = deque(maxlen=TWIN_FRAMES)
        self.identity = Identity(settings, adapters)
        self.vehicle = VehicleState(self.identity.adapter)
        self.encoder = Encoder(settings.system_id or 1, settings.component_id, signing)
        self.commands = CommandSender()
        self.streams = StreamRequests({})
        self.timesync = Timesync()
        self.motion = OwnMotionSensor(self.timesync.slower)
        self.announcer = Announcer()
        self.mode_requests_dropped = 0
        """Times that a request was dropped before its answer had come."""
        self.ignored, self.misfits = self.identity.ignored, self.identity.misfits
        self.clock_speed, self.texts = self.vehicle.clock_speed, self.vehicle.texts

    @property
    def peer(self) -> Sender | None:
        """The pinned vehicle, None while there is none."""
        return self.identity.peer

    @property
    def up(self) -> bool:
        return self.peer is not None

    @property
    def us(self) -> Ids:
        """In whose name we speak."""
        return self.encoder.system, self._component

    @property
    def adapter(self) -> Autopilot:
        """Of the vehicle; of the first that the mission allows before one was heard."""
        return self.identity.adapter

    @property
    def vehicle_ids(self) -> Ids:
        """(system, component) to address; (0, 0) when there is no vehicle."""
        return self.peer.ids if self.peer else (0, 0)

    @property
    def reply_to(self) -> Hashable:
        """Where our bytes go, None for nowhere yet."""
        return self.identity.reply_to

    def heartbeat_age(self, now: float) -> float:
        return now - self.vehicle.heard_at

    @property
    def doubled(self) -> bool:
        """Whether another companion speaks in our name."""
        heard = self._twin_heard
        return len(heard) == TWIN_FRAMES and heard[-1] - heard[0] <= TWIN_WITHIN

    def missing(self, now: float) -> list[str]:
        """What the vehicle must tell before it can be flown, and does not."""
        motion = self.motion.at(now)
        return sorted(name for name in self.adapter.needs if getattr(motion, name) is None)

    # --- in ---

    def receive(self, message: Message, now: float, source: Hashable) -> bool:
        """Take one message in; tells whether it is of the pinned vehicle. Nobody else moves anything here."""
        before = self.peer
        if before is not None and ids(message) == self.us:
            self._in_our_name(bytes(message.get_msgbuf()), before, source, now)
            return False
        ours = self.identity.receive(message, source, now, continues=self.vehicle.continues)
        if self.peer is not None and self.peer != before:
            self._pinned(self.peer, anew=before is None)
        if not ours:
            return False
        self.streams.heard(message.get_msgId())
        reboots = self.vehicle.reboots
        self.vehicle.receive(message, now)
        if self.vehicle.reboots > reboots:
            self.streams.restart()
        if message.get_type() == "COMMAND_ACK":
            self.commands.acknowledge(message, self.us, now)
        elif message.get_type() == "TIMESYNC" and message.tc1:
            self.timesync.heard(message.ts1, now)
        elif message.get_type() == "TIMESYNC" and len(self._replies) < MOST_REPLIES:
            # a question (tc1 = 0) is answered with our clock, in ns, and the asker's mirrored
            self._replies.append(dialect.MAVLink_timesync_message(int(now * 1e9) or 1, message.ts1))
        return True

    def lose(self) -> None:
        """The vehicle has fallen silent: let go of it."""
        self.vehicle.lost()
        self.identity.peer = None
        self.commands.clear()

    def _in_our_name(self, frame: bytes, peer: Sender, source: Hashable, now: float) -> None:
        """An echo, or another companion. What the vehicle forwards was said to it; from elsewhere anybody says that."""
        if frame in self._sent:
            self.ignored["echo"] += 1
        elif source == peer.source:
            self.ignored["twin"] += 1
            self._twin_heard.append(now)
        else:
            self.identity.rivals.heard(OUR_NAME, Sender(*self.us, source), Sender(*self.us, "this computer"), now)

    def _pinned(self, peer: Sender, *, anew: bool) -> None:
        """The vehicle was found, or speaks from another address."""
        self.encoder.system = peer.system
        if not anew:
            self.vehicle.moved()
        else:
            self.vehicle.found(self.adapter)
            echo = {} if self.adapter.echo is None else {self.adapter.echo: ECHO_RATE}
            self.streams = StreamRequests({**self.adapter.firmware.streams, **echo, **self._more_streams}, maybe=echo)
            self.commands.send(Command(dialect.MAV_CMD_REQUEST_MESSAGE, (dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION,)))
        if self.vehicle.unproven:
            self.commands.send(Command(dialect.MAV_CMD_REQUEST_MESSAGE, (dialect.MAVLINK_MSG_ID_SYSTEM_TIME,)))

    # --- out ---

    def encode(self, message: Message) -> bytes:
        """Encode one frame in our name. It is remembered, so that neither its echo nor its answer seems to be due to
        another companion."""
        frame = self.encoder.encode(message)
        if message.get_type() in ("COMMAND_LONG", "COMMAND_INT"):
            self.commands.sent(message.command)
        self._sent.append(frame)
        return frame

    def poll(self, now: float) -> list[Message]:
        """The messages due now: our heartbeat, commands, texts. Called by the healthy tick only."""
        messages, self._replies = self.heartbeats_due(now) + self._replies, []
        if self.peer is not None:
            for result in self.commands.take_results():
                if result.command.number == dialect.MAV_CMD_DO_SET_MODE:
                    self._mode_results.append(result)  # for whoever asked
                elif result.command.number == dialect.MAV_CMD_SET_MESSAGE_INTERVAL and result.refused:
                    self.streams.denied(result)
            for request in self.streams.poll(now):
                self.commands.send(request)
            messages += self.streams.group_requests(self.peer.ids, now)
            messages += self.commands.poll(self.peer.ids, now) + self.timesync.poll(now)
            messages += self.announcer.texts(now)
        return messages

    def take_mode_results(self) -> list[CommandResult]:
        results = list(self._mode_results)
        self._mode_results.clear()
        return results

    def drop_mode_requests(self) -> None:
        """Ask for no mode any more: it was reached, or the operator has chosen another, or may have."""
        self.mode_requests_dropped += self.commands.drop(dialect.MAV_CMD_DO_SET_MODE)
        self._mode_results.clear()

    def farewell(self) -> list[Message]:
        """Give the vehicle its own stream rates back, also where it is silent, and nobody else his; nobody waits for
        the answer."""
        home = self.identity.home
        return [] if home is None else [once(command, home.ids) for command in self.streams.give_back()]

    def heartbeats_due(self, now: float) -> list[Message]:
        """Our heartbeat, when due."""
        if now < self._next_heartbeat:
            return []
        self._next_heartbeat = now + HEARTBEAT_PERIOD
        return [self.heartbeat()]

    def heartbeat(self) -> Message:
        """Our own heartbeat: an onboard controller of the vehicle's system, never a ground station (that would feed
        the operator's GCS failsafe)."""
        return dialect.MAVLink_heartbeat_message(
            dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
        )
