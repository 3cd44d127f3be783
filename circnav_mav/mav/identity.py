"""Identity of our vehicle: ids and address of the sender of the first HEARTBEAT that fits the
mission."""

from collections import Counter
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, NamedTuple

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.interface import Autopilot
from circnav_mav.mav.codec import Ids, Message, ids
from circnav_mav.mav.framing import V2
from circnav_mav.timers import Since

MAVLINK_1_ONLY = "sends MAVLink 1 only: set its port to MAVLink 2 (ArduPilot: SERIALn_PROTOCOL = 2)"
AUTOPILOT_COMPONENT = dialect.MAV_COMP_ID_AUTOPILOT1
OUR_COMPONENTS = range(
    dialect.MAV_COMP_ID_ONBOARD_COMPUTER, dialect.MAV_COMP_ID_ONBOARD_COMPUTER4 + 1
)
"""Component ids that circnav may use."""
NO_AUTOPILOT = (dialect.MAV_AUTOPILOT_INVALID, dialect.MAV_AUTOPILOT_GENERIC)
MOVES_AFTER = 1.5
"""Silence of the vehicle's address, s, after which the vehicle may move to another address. Any
message of the vehicle's system from the old address ends the silence."""
FLOODED = 3.0
"""Time after the last dropped bytes, s, at which a flood is over."""
UNKNOWN_RATE = 64_000.0
"""Limit of the bytes per second from untrusted senders while the vehicle is connected. Several
other vehicles send less. Untrusted senders at this limit use 2 % of the processor time, and the
socket still receives the vehicle's frames."""
UNKNOWN_BURST = 32_000.0
"""Limit of the bytes that untrusted senders may send at once after a pause."""
# Names, in messages to the operator, of the trusted sender whose ids a second sender uses.
VEHICLE_NAME = "the vehicle"
OUR_NAME = "circnav"
RADIO_NAME = "the ranging radio"


class Sender(NamedTuple):
    """Sender of a message: its MAVLink ids and its address."""

    system: int
    component: int
    source: Hashable

    @property
    def ids(self) -> Ids:
        return (self.system, self.component)

    def __str__(self) -> str:
        return f"{self.system}/{self.component} at {address_text(self.source)}"


def address_text(source: Hashable) -> str:
    """Return a socket address in endpoint notation, or any other source as text."""
    if not isinstance(source, tuple):
        return str(source)
    host, port = source[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def host_of(source: Hashable) -> Hashable:
    """Return the host of a socket address, or any other source unchanged."""
    return source[0] if isinstance(source, tuple) else source


@dataclass(frozen=True, slots=True)
class LinkSettings:
    """system_id: system id of the vehicle, None for the first vehicle that fits the mission.
    component_id: component id of circnav, of OUR_COMPONENTS."""

    system_id: int | None = None
    component_id: int = OUR_COMPONENTS[0]


class SecondSenders:
    """Second senders: each uses the identity of a trusted sender, but another address.

    The trusted sender is the vehicle, circnav itself or the ranging radio.
    """

    def __init__(self) -> None:
        self._newest: dict[str, tuple[Sender, Sender, float]] = {}
        """Second sender, trusted sender and time of the last message, s, by identity."""

    def received(self, name: str, rival: Sender, trusted: Sender, now: float) -> None:
        self._newest[name] = (rival, trusted, now)

    def recent(self, now: float) -> list[str]:
        """Return one line per identity for the operator."""
        # 5.0: time, s, for which a second sender is reported after its last message, longer than
        # heartbeat gaps on a lossy link.
        return [
            f"{name} has a second sender: {rival} is rejected, {trusted} is used"
            for name, (rival, trusted, at) in self._newest.items()
            if now - at <= 5.0
        ]


class Allowance:
    """Byte budget for untrusted senders, so that a flood does not block the vehicle's messages."""

    def __init__(self) -> None:
        self._left = UNKNOWN_BURST
        self._at = 0.0
        self.dropped = 0
        """Bytes that were dropped."""
        self._since_dropped = Since()

    def flood(self, now: float) -> int:
        """Return the total of the dropped bytes, 0 if none was dropped within the last FLOODED
        seconds."""
        return self.dropped if self._since_dropped.age(now) < FLOODED else 0

    def take(self, size: int, now: float) -> bool:
        """Return True if this number of bytes may be read, and deduct it from the budget."""
        self._left = min(self._left + UNKNOWN_RATE * (now - self._at), UNKNOWN_BURST)
        self._at = now
        if size > self._left:
            self.dropped = self.dropped + size
            self._since_dropped.restart(now)
            return False
        self._left -= size
        return True


class _Relation(Enum):
    """Relation of a sender to the vehicle."""

    VEHICLE = "ids and address of the vehicle"
    TWIN = "ids of the vehicle, another address"
    UNKNOWN = "other ids, or no vehicle was found yet"


class _Kind(Enum):
    """Kind of a message."""

    AUTOPILOT = "heartbeat of an autopilot"
    NO_AUTOPILOT = "heartbeat of a radio, gimbal or companion"
    OTHER = "no heartbeat"


def _kind_of(message: Message) -> _Kind:
    if message.get_type() != "HEARTBEAT":
        return _Kind.OTHER
    invalid = message.autopilot == dialect.MAV_AUTOPILOT_INVALID
    return _Kind.NO_AUTOPILOT if invalid else _Kind.AUTOPILOT


class Identity:
    """The vehicle's ids and address, the address to reply to, and the reasons why other senders are
    rejected.

    While messages of the vehicle's system arrive from its address, no other address is accepted.
    After a silence the vehicle may send from another address if its time since boot is as expected.
    Before the flight, a lost vehicle is accepted again without this proof, because it may have been
    switched off.
    """

    def __init__(self, settings: LinkSettings, adapters: tuple[Autopilot, ...]) -> None:
        """adapters: adapters of the vehicles that the mission allows. The first vehicle that fits
        (the pinned vehicle) selects its adapter."""
        self._settings = settings
        self._adapters = adapters
        self.adapter = adapters[0]
        self.home: Sender | None = None
        """The vehicle and its address, kept while it is silent; None before it was found."""
        self.peer: Sender | None = None
        """`home` while the vehicle reports its mode, otherwise None."""
        self.reply_to: Hashable = None
        self.stays = False
        """True once the vehicle was steered. From then on another address needs proof after any
        silence."""
        self.since = 0.0
        """Time at which the vehicle was found, or found again after a silence, s."""
        self._since_received = Since()
        """Since the newest message of the vehicle's system from its address."""
        self._proven: tuple[Hashable, float] = (None, float("-inf"))
        """Newest other address that was proven to be the vehicle's, and the time of the proof,
        s."""
        self.ignored: Counter[str] = Counter()
        self.vehicles: dict[int, Hashable] = {}
        """Address of the newest autopilot heartbeat, by system id."""
        self.misfits: dict[Ids, str] = {}
        self.second_senders = SecondSenders()

    @property
    def other_vehicles(self) -> Mapping[int, Hashable]:
        """Addresses of other vehicles by system id; empty before our vehicle was found."""
        home = self.home
        return (
            {}
            if home is None
            else {one: at for one, at in self.vehicles.items() if one != home.system}
        )

    def say_hello(self, source: Hashable, now: float) -> None:
        """Send circnav's frames to the address of a sender that cannot be accepted yet, unless the
        vehicle has another address.

        These frames may make the sender acceptable. A MAVLink 1 sender may switch to MAVLink 2. A
        sender whose signing clock is behind, for example without GPS, adopts the timestamp of
        circnav's frames.
        """
        if self._may_be_at(source, now):
            self.reply_to = source

    def receive(
        self,
        message: Message,
        source: Hashable,
        now: float,
        *,
        continues: Callable[[Message, float], bool],
    ) -> bool:
        """Return True if a message is from our vehicle. Only a HEARTBEAT pins the vehicle, or moves
        it to another address.

        Heartbeats of other vehicles and messages of second senders with the vehicle's ids are
        counted. continues: True if a message carries the expected time since boot.
        """
        who = Sender(*ids(message), source)
        kind = _kind_of(message)
        relation = self._relation(who)
        for step in self._STEPS[relation, kind]:
            step(self, message, who, now)
        silent = self._since_received.age(now) > MOVES_AFTER
        if relation is _Relation.TWIN and silent and continues(message, now):
            self._proven = (source, now)
        return who == self.peer and kind is not _Kind.NO_AUTOPILOT

    def _relation(self, who: Sender) -> "_Relation":
        home = self.home
        if home is None or who.ids != home.ids:
            return _Relation.UNKNOWN
        return _Relation.VEHICLE if who.source == home.source else _Relation.TWIN

    # --- steps of the table

    def _ignore(self, message: Message, who: Sender, now: float) -> None:
        """Count the heartbeat of a radio, gimbal or companion that has the vehicle's ids (default
        1/1), often behind the same router. It reports mode 0 and disarmed, which looks like a
        takeover."""
        self.ignored["no_autopilot"] += 1

    def _note(self, message: Message, who: Sender, now: float) -> None:
        """Note the address of an autopilot, and end the silence of the vehicle's address."""
        is_autopilot = message.get_type() == "HEARTBEAT" and message.autopilot not in NO_AUTOPILOT
        if is_autopilot and who.component == AUTOPILOT_COMPONENT:
            self.vehicles[who.system] = who.source
        home = self.home
        if home is not None and (who.system, who.source) == (home.system, home.source):
            self._since_received.restart(now)

    def _pin(self, message: Message, who: Sender, now: float) -> None:
        """Pin the sender of a heartbeat, or move the vehicle to its address, if that is allowed."""
        ours = self.peer is None or who.ids == self.peer.ids
        if ours and who != self.peer and self._may_be_at(who.source, now):
            self._consider(message, who, now)

    def _reject(self, message: Message, who: Sender, now: float) -> None:
        """Report a second sender that was not pinned."""
        home = self.home
        if home is not None and who.source != home.source:
            self.second_senders.received(VEHICLE_NAME, who, home, now)

    def _reject_unless_silent(self, message: Message, who: Sender, now: float) -> None:
        """Report a second sender. A vehicle that changes its address sends a few messages before
        its first heartbeat. They do not indicate a second sender."""
        if self._since_received.age(now) <= MOVES_AFTER:
            self._reject(message, who, now)

    def _count(self, message: Message, who: Sender, now: float) -> None:
        """Count the heartbeat of another vehicle."""
        if self.peer is not None and who != self.peer:
            self.ignored["other_vehicle"] += 1

    _STEPS: ClassVar = {
        (_Relation.VEHICLE, _Kind.AUTOPILOT): (_note, _pin),
        (_Relation.VEHICLE, _Kind.NO_AUTOPILOT): (_ignore,),
        (_Relation.VEHICLE, _Kind.OTHER): (_note,),
        (_Relation.TWIN, _Kind.AUTOPILOT): (_note, _pin, _reject, _count),
        (_Relation.TWIN, _Kind.NO_AUTOPILOT): (_reject,),
        (_Relation.TWIN, _Kind.OTHER): (_reject_unless_silent,),
        (_Relation.UNKNOWN, _Kind.AUTOPILOT): (_note, _pin, _count),
        (_Relation.UNKNOWN, _Kind.NO_AUTOPILOT): (_note,),
        (_Relation.UNKNOWN, _Kind.OTHER): (_note,),
    }

    def change_method(self, adapter: Autopilot) -> None:
        """Steer the pinned vehicle by another method from now on, also if it is found again."""
        self._adapters = (adapter,)
        self.adapter = adapter

    def _may_be_at(self, source: Hashable, now: float) -> bool:
        """True if the vehicle may send from this address."""
        if self.home is None or source == self.home.source:
            return True
        if self._since_received.age(now) <= MOVES_AFTER:
            return False
        address, at = self._proven
        found_again = self.peer is None and not self.stays
        # 2.0: time, s, for which a proof of the vehicle's identity is valid, two heartbeat
        # intervals of PX4.
        return found_again or (source == address and now - at <= 2.0)

    def _consider(self, heartbeat: Message, who: Sender, now: float) -> None:
        """Pin the sender of this heartbeat if it is the mission's vehicle. Otherwise record the
        reason."""
        if heartbeat.type == dialect.MAV_TYPE_GCS:
            return
        adapter = next((one for one in self._adapters if _fits(one, heartbeat)), None)
        reason = self._misfit(heartbeat, who, adapter, now)
        if reason or adapter is None:
            # 16: limit of the rejected senders in the operator's message, which bounds the memory
            # that a hostile link can fill.
            if len(self.misfits) < 16:
                self.misfits[who.ids] = reason
            return
        if self.peer is None:
            self.adapter = adapter
            self.since = now
        self.home = self.peer = who
        self.reply_to = who.source
        self._since_received.restart(now)

    def _misfit(
        self, heartbeat: Message, who: Sender, adapter: Autopilot | None, now: float
    ) -> str:
        """Return the human-readable reason why this sender is not our vehicle. Empty for our
        vehicle."""
        wanted = self._settings.system_id
        system = f"system {who.system}"
        if who.system == 0:  # 0 is the broadcast address
            return f"{system} is no id of a vehicle: set its system id to 1 to 255"
        if self.home is not None and who.ids != self.home.ids:
            return f"{system} is not the vehicle received first, system {self.home.system}"
        if wanted is not None and who.system != wanted:
            return f"{system} is not the mission's vehicle.system_id {wanted}"
        if adapter is None:
            known = " or ".join(one.name for one in self._adapters)
            return f"{system} is {describe_vehicle(heartbeat)}, the mission is for {known}"
        if self.home is not None and adapter is not self.adapter:
            return f"{system} is {describe_vehicle(heartbeat)} now, not the vehicle received first"
        if heartbeat.get_msgbuf()[0] != V2:
            self.say_hello(
                who.source, now
            )  # our MAVLink 2 heartbeat makes many autopilots switch over
            return f"{system} {MAVLINK_1_ONLY}"
        return ""


def _fits(adapter: Autopilot, heartbeat: Message) -> bool:
    return (
        heartbeat.autopilot == adapter.firmware.autopilot
        and heartbeat.type in adapter.vehicle_types
    )


def describe_vehicle(heartbeat: Message) -> str:
    """Return autopilot and vehicle type of a HEARTBEAT, human-readable."""
    kinds = (("MAV_AUTOPILOT", heartbeat.autopilot), ("MAV_TYPE", heartbeat.type))
    entries = (dialect.enums[name].get(value) for name, value in kinds)
    return " ".join(
        entry.name.split("_", 2)[-1].lower() if entry else "unknown" for entry in entries
    )
