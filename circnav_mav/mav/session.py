"""The link to one vehicle: who it is, its mode, our heartbeat, commands and streams.

The peer is pinned to the sender of the first HEARTBEAT that fits the mission; anybody else is counted and ignored.
"""

from collections import Counter, deque
from collections.abc import Collection, Hashable, Mapping
from dataclasses import dataclass

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.announce import Announcer
from circnav_mav.mav.autopilots.interface import Autopilot
from circnav_mav.mav.boot_clock import BootClock
from circnav_mav.mav.codec import Encoder, Message
from circnav_mav.mav.commands import Command, CommandResult, CommandSender
from circnav_mav.mav.motion import MotionSensor
from circnav_mav.mav.round_trip import RoundTrip
from circnav_mav.mav.signing import Signing
from circnav_mav.mav.streams import StreamRequests

HEARTBEAT_PERIOD = 1.0
LOST_AFTER = 3.0
"""Silence of the vehicle about its mode, s, after which the link counts as lost (MAVSDK's figure)."""
REBOOT_STEP = 1.0
"""Backward step of the vehicle's boot time, s, that proves a reboot."""
V2_MAGIC = 0xFD
SENT_KEPT = 1024
"""Frames of ours that are remembered: twenty seconds of them, by which an echo is known."""
MOST_VEHICLES = 32
AUTOPILOT_COMPONENT = dialect.MAV_COMP_ID_AUTOPILOT1
NO_AUTOPILOT = (dialect.MAV_AUTOPILOT_INVALID, dialect.MAV_AUTOPILOT_GENERIC)
NOT_FLYING = (
    dialect.MAV_LANDED_STATE_ON_GROUND,
    dialect.MAV_LANDED_STATE_TAKEOFF,
    dialect.MAV_LANDED_STATE_LANDING,
)
"""EXTENDED_SYS_STATE.landed_state in which an aircraft is not to be steered."""


@dataclass(frozen=True, slots=True)
class LinkSettings:
    """system_id: of the vehicle, None for the first that fits. component_id: ours, 191..194."""

    system_id: int | None = None
    component_id: int = 191


@dataclass(frozen=True, slots=True)
class Peer:
    """The pinned vehicle: where its frames come from, and its ids."""

    source: Hashable
    system: int
    component: int

    @property
    def ids(self) -> tuple[int, int]:
        """(system, component)."""
        return (self.system, self.component)


class Session:
    """Everything that is said between us and the vehicle, except setpoints and ranging."""

    def __init__(
        self,
        settings: LinkSettings,
        adapters: tuple[Autopilot, ...],
        more_streams: Mapping[int, float] | None = None,
        signing: Signing | None = None,
    ) -> None:
        """adapters: the vehicles that the mission allows; the pinned vehicle picks one. more_streams: id -> Hz."""
        self._settings = settings
        self._adapters = adapters
        self._more_streams = dict(more_streams or {})
        self._next_heartbeat = float("-inf")
        self._boot_ms: int | None = None
        self._doubtful_ms: int | None = None
        self._replies: list[Message] = []
        self.encoder = Encoder(settings.system_id or 1, settings.component_id, signing)
        self.commands = CommandSender()
        self.adapter = adapters[0]
        self.streams = StreamRequests({})
        self.motion = MotionSensor()
        self.round_trip = RoundTrip()
        self.boot_clock = BootClock()
        self.battery: float | None = None
        self.on_ground: bool | None = None
        self.pinned_at = 0.0
        self.announcer = Announcer()
        self.peer: Peer | None = None
        self.reply_to: Hashable = None
        self.mode: int | None = None
        self.armed = False
        self.heard_at = float("-inf")
        self.heartbeats = 0
        self.reboots = 0
        self.departures = 0
        """Times that the guided mode was left, or the vehicle disarmed in it: also between two looks at it."""
        self._lost_ours = False
        self.left_for: str | None = None
        """The mode of the newest departure, None where the vehicle was disarmed."""
        self.ignored: Counter[str] = Counter()
        self.vehicles: set[int] = set()
        """Systems that have told of an autopilot."""
        self.misfits: dict[tuple[int, int], str] = {}
        self._mode_results: deque[CommandResult] = deque(maxlen=8)
        self._first: tuple[int, int] | None = None
        self._sent: deque[bytes] = deque(maxlen=SENT_KEPT)
        self.texts: deque[str] = deque(maxlen=8)
        self.firmware: str | None = None

    @property
    def up(self) -> bool:
        """Whether a vehicle is pinned."""
        return self.peer is not None

    @property
    def in_our_mode(self) -> bool:
        """Whether the vehicle obeys setpoints: armed, and its own heartbeat names the guided mode."""
        return self.up and self.armed and self.mode == self.adapter.guided_mode

    @property
    def mode_name(self) -> str:
        """The vehicle's mode for people."""
        return "unknown" if self.mode is None else self.adapter.mode_names.get(self.mode, f"mode {self.mode}")

    @property
    def boot_time(self) -> float | None:
        """The vehicle's newest time since boot, s, None before it was heard."""
        return None if self._boot_ms is None else self._boot_ms / 1000

    def missing(self, now: float) -> list[str]:
        """What the vehicle must tell before it can be flown, and does not."""
        motion = self.motion.at(now)
        return sorted(name for name in self.adapter.needs if getattr(motion, name) is None)

    def heartbeat_age(self, now: float) -> float:
        """Seconds since the vehicle last told its mode."""
        return now - self.heard_at

    def receive(self, message: Message, now: float, source: Hashable) -> bool:
        """Take one message in; tells whether it is of the pinned vehicle. Nobody else moves anything here."""
        ids = (message.get_srcSystem(), message.get_srcComponent())
        if self.peer is not None and ids == (self.encoder.system, self._settings.component_id):
            self.ignored["echo" if bytes(message.get_msgbuf()) in self._sent else "twin"] += 1
            return False
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self._note_vehicle(message, ids)
        if kind == "HEARTBEAT" and (self.peer is None or self._moved(ids, now)):
            self._consider(message, ids, source, now)
        if self.peer is None or ids != self.peer.ids or source != self.peer.source:
            if kind == "HEARTBEAT" and self.peer is not None and message.autopilot != dialect.MAV_AUTOPILOT_INVALID:
                self.ignored["other_vehicle"] += 1
            return False
        self.streams.heard(message.get_msgId())
        handle = _HANDLERS.get(kind)
        if handle is not None:
            handle(self, message, now)
        return True

    @property
    def strangers(self) -> Collection[int]:
        """Systems of other vehicles; nobody is known to be one before ours is found."""
        return () if self._first is None else self.vehicles - {self._first[0]}

    def _note_vehicle(self, heartbeat: Message, ids: tuple[int, int]) -> None:
        """A radio with a heartbeat of its own is no vehicle."""
        flies = ids[1] == AUTOPILOT_COMPONENT and heartbeat.autopilot not in NO_AUTOPILOT
        if flies and len(self.vehicles) < MOST_VEHICLES:
            self.vehicles.add(ids[0])

    def greet(self, source: Hashable) -> None:
        """Speak to somebody who signs as we do, by a clock far behind ours (an autopilot without GPS has none): he
        takes our timestamp over, and can be believed from then on. Nobody else is, once the vehicle was heard."""
        if self._first is None:
            self.reply_to = source

    def encode(self, message: Message) -> bytes:
        """One frame in our name, remembered so that an echo of it is not taken for somebody else."""
        frame = self.encoder.encode(message)
        self._sent.append(frame)
        return frame

    def lose(self) -> None:
        """The vehicle has fallen silent: let go of it."""
        self._lost_ours = self.in_our_mode
        self.peer, self.mode, self.armed = None, None, False
        self.commands.clear()

    def poll(self, now: float) -> list[Message]:
        """The messages due now: our heartbeat, commands, texts. Called by the healthy tick only."""
        messages = self.heartbeats_due(now)
        messages += self._replies
        self._replies.clear()
        if self.peer is not None:
            self._note_results()
            for request in self.streams.poll(now):
                self.commands.send(request)
            messages += self.commands.poll(self.peer.ids, now) + self.round_trip.poll(now)
            messages += self.announcer.texts(now)
        return messages

    def take_mode_results(self) -> list[CommandResult]:
        """Answers to mode requests since the last call."""
        results = list(self._mode_results)
        self._mode_results.clear()
        return results

    def drop_mode_requests(self) -> None:
        """Ask for no mode any more: it was reached, or the operator has chosen another."""
        self.commands.drop(dialect.MAV_CMD_DO_SET_MODE)
        self._mode_results.clear()

    def farewell(self) -> list[Message]:
        """Give the vehicle its own stream rates back; nobody waits for the answer."""
        sender = CommandSender()
        messages: list[Message] = []
        for command in self.streams.give_back():
            sender.clear()
            sender.send(command)
            messages += sender.poll(self.vehicle_ids, 0.0)
        return messages

    @property
    def vehicle_ids(self) -> tuple[int, int]:
        """(system, component) to address; (0, 0) reaches everybody when there is no vehicle."""
        return self.peer.ids if self.peer else (0, 0)

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

    def _moved(self, ids: tuple[int, int], now: float) -> bool:
        """Whether our vehicle may have come back from another address: silent for long, and the same ids."""
        return self.peer is not None and ids == self.peer.ids and self.heartbeat_age(now) > LOST_AFTER / 2

    def _consider(self, message: Message, ids: tuple[int, int], source: Hashable, now: float) -> None:
        """Pin the sender of this heartbeat if it is the vehicle that the mission means; else note why not."""
        if message.autopilot == dialect.MAV_AUTOPILOT_INVALID or message.type == dialect.MAV_TYPE_GCS:
            return
        adapter = next((one for one in self._adapters if _fits(one, message)), None)
        reason = self._misfit(message, ids, adapter)
        if reason is not None or adapter is None:
            if reason is not None and len(self.misfits) < 16:
                self.misfits[ids] = reason
            if message.get_msgbuf()[0] != V2_MAGIC:
                self.reply_to = source  # our MAVLink 2 heartbeat makes many autopilots switch over
            return
        returning = self.peer is not None
        self.peer, self._first = Peer(source, *ids), ids
        self.reply_to, self.encoder.system = source, ids[0]
        if not returning:
            self.adapter, self.pinned_at, self.on_ground = adapter, now, None
            self.streams = StreamRequests({**adapter.streams, **self._more_streams})
            self.commands.send(Command(dialect.MAV_CMD_REQUEST_MESSAGE, (dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION,)))

    def _misfit(self, message: Message, ids: tuple[int, int], adapter: Autopilot | None) -> str | None:
        wanted = self._settings.system_id
        if self._first is not None and ids != self._first:
            return f"system {ids[0]} is not the vehicle heard first, system {self._first[0]}"
        if wanted is not None and ids[0] != wanted:
            return f"system {ids[0]} is not the mission's vehicle.system_id {wanted}"
        if adapter is None:
            known = " or ".join(one.name for one in self._adapters)
            return f"system {ids[0]} is {describe_vehicle(message)}, the mission is for {known}"
        if message.get_msgbuf()[0] != V2_MAGIC:
            return f"system {ids[0]} speaks MAVLink 1 only: set its port to MAVLink 2 (ArduPilot: SERIALn_PROTOCOL = 2)"
        return None

    def _note_results(self) -> None:
        """Refused streams are not asked for again; answers to mode requests wait for whoever asked."""
        for result in self.commands.take_results():
            if result.command.number == dialect.MAV_CMD_DO_SET_MODE:
                self._mode_results.append(result)
            elif result.command.number == dialect.MAV_CMD_SET_MESSAGE_INTERVAL and result.refused:
                self.streams.denied(result.command)

    def _on_heartbeat(self, message: Message, now: float) -> None:
        armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        self._tells_mode(message.custom_mode, armed, now)
        self.heartbeats += 1

    def _on_current_mode(self, message: Message, now: float) -> None:
        """Proves the mode and the link as a heartbeat does: PX4 sends those once a second only, and some are lost."""
        if message.custom_mode:
            self._tells_mode(message.custom_mode, self.armed, now)

    def _tells_mode(self, mode: int, armed: bool, now: float) -> None:
        """The vehicle's mode, and whether that takes it out of our hands."""
        was_ours, self._lost_ours = self.in_our_mode or self._lost_ours, False
        self.heard_at, self.mode, self.armed = now, mode, armed
        if was_ours and not self.in_our_mode:
            self.departures += 1
            self.left_for = None if mode == self.adapter.guided_mode else self.mode_name

    def _on_battery(self, message: Message, now: float) -> None:
        self.battery = float(message.battery_remaining) if message.battery_remaining >= 0 else None

    def _on_landed(self, message: Message, now: float) -> None:
        self.on_ground = message.landed_state in NOT_FLYING

    def _on_boot_time(self, message: Message, now: float) -> None:
        """A boot time that steps back is a reboot; the counter's own wrap after 49.7 days is not."""
        newest = message.time_boot_ms
        if self._boot_ms is None or _later(newest, self._boot_ms) >= -1000 * REBOOT_STEP:
            self._boot_ms, self._doubtful_ms = newest, None
            self.boot_clock.heard(newest / 1000, now)
        elif self._doubtful_ms is None or _later(newest, self._doubtful_ms) <= 0:
            self._doubtful_ms = newest  # one frame that came late by another way is no reboot; the next one tells
        else:
            self._boot_ms, self._doubtful_ms = newest, None
            self.reboots += 1
            self.streams.restart()

    def _on_ack(self, message: Message, now: float) -> None:
        self.commands.acknowledge(message, (self.encoder.system, self._settings.component_id), now)

    def _on_text(self, message: Message, now: float) -> None:
        text = message.text if isinstance(message.text, str) else message.text.decode("ascii", "replace")
        self.texts.append(text)

    def _on_timesync(self, message: Message, now: float) -> None:
        """Answer a request (tc1 = 0) with our clock, in ns, mirroring the asker's; else it may be an answer to ours."""
        if message.tc1:
            self.round_trip.heard(message.ts1, now)
        elif len(self._replies) < 4:
            self._replies.append(dialect.MAVLink_timesync_message(int(now * 1e9) or 1, message.ts1))

    def _on_version(self, message: Message, now: float) -> None:
        version = message.flight_sw_version
        self.firmware = f"{version >> 24}.{version >> 16 & 255}.{version >> 8 & 255}"


def _later(boot_ms: int, before_ms: int) -> int:
    """Milliseconds from one boot time to another, through the 32-bit wrap."""
    return (boot_ms - before_ms + 2**31) % 2**32 - 2**31


def _fits(adapter: Autopilot, heartbeat: Message) -> bool:
    return heartbeat.autopilot == adapter.autopilot and heartbeat.type in adapter.vehicle_types


def describe_vehicle(heartbeat: Message) -> str:
    """Autopilot and vehicle type of a HEARTBEAT in words."""
    autopilot = dialect.enums["MAV_AUTOPILOT"].get(heartbeat.autopilot)
    kind = dialect.enums["MAV_TYPE"].get(heartbeat.type)
    names = (entry.name.split("_", 2)[-1].lower() if entry else "unknown" for entry in (autopilot, kind))
    return " ".join(names)


_HANDLERS = {
    "HEARTBEAT": Session._on_heartbeat,
    "CURRENT_MODE": Session._on_current_mode,
    "SYS_STATUS": Session._on_battery,
    "EXTENDED_SYS_STATE": Session._on_landed,
    "SYSTEM_TIME": Session._on_boot_time,
    "ATTITUDE": Session._on_boot_time,
    "COMMAND_ACK": Session._on_ack,
    "STATUSTEXT": Session._on_text,
    "TIMESYNC": Session._on_timesync,
    "AUTOPILOT_VERSION": Session._on_version,
}
HANDLED = frozenset(getattr(dialect, f"MAVLINK_MSG_ID_{name}") for name in (*_HANDLERS, "ATTITUDE", "VFR_HUD"))
"""Ids of the messages that a session or the motion sensor reads."""
