"""Who speaks in a plain tlog: the vehicles, and the senders of ranges with what a mission picks them by."""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Decoder, Message
from circnav_mav.mav.ranging import RANGING_MESSAGES, RangeReader, RangingSettings, Reject
from circnav_mav.mav.session import describe_vehicle
from circnav_mav.mav.statustext import plain_text
from circnav_mav.pilot import Pilot
from circnav_mav.runlog.loop_steps import Turn
from circnav_mav.runlog.tlog import message_id

MARKS = {"distance_sensor": ("id", "orientation"), "ranging_beacon": ("beacon_id",), "named_value_float": ("name",)}
"""The fields by which a mission picks the sensor, by the mission's name of the message."""
KEYS = {"id": "sensor_id"}
"""Where the mission's key is called otherwise than the field."""
HEARTBEAT = dialect.MAVLINK_MSG_ID_HEARTBEAT
Ids = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Sender:
    """A sender of ranges. message: the mission's name of it. marks: the values of the message's MARKS."""

    message: str
    system: int
    component: int
    marks: tuple[str, ...]


@dataclass(slots=True)
class Heard:
    """What became of the ranges of one sender. ignored: those that fit the mission but came beside another sender's."""

    messages: int = 0
    taken: int = 0
    ignored: int = 0


@dataclass(slots=True)
class Witness:
    """Listens to the turns that a pilot replays. vehicle: the one that the pilot took last. vehicles: what each
    autopilot is and its heartbeats. senders: of ranges, those that do not fit the mission included."""

    settings: RangingSettings
    vehicle: Ids | None = None
    vehicles: dict[Ids, str] = field(default_factory=dict)
    heartbeats: Counter[Ids] = field(default_factory=Counter)
    senders: dict[Sender, Heard] = field(default_factory=dict)

    def watch(self, turns: Iterable[Turn], pilot: Pilot) -> Iterator[Turn]:
        """The turns as they are, on their way to the pilot."""
        wanted = frozenset({HEARTBEAT, *(one.id for one in RANGING_MESSAGES.values())})
        decoder, reader = Decoder(wanted=wanted), RangeReader(self.settings)
        for turn in turns:
            for frame in (frame for _, _, frame in turn.heard if message_id(frame) in wanted):
                for message in decoder.decode(frame):
                    self._hear(message, reader, turn.time)
            yield turn
            if pilot.session.up:
                self.vehicle = pilot.session.vehicle_ids

    @property
    def rivals(self) -> list[Sender]:
        """The senders that fit the mission, where there is more than one and no word of it which one is meant."""
        named = self.settings.system is not None or self.settings.component is not None
        fit = [sender for sender, heard in self.senders.items() if heard.taken or (heard.ignored and not named)]
        return fit if len(fit) > 1 else []

    @property
    def choosing(self) -> list[str]:
        """The keys of the mission in which the rivals differ."""
        rivals = self.rivals
        differs: dict[str, set[int] | set[str]] = {
            "component_id": {one.component for one in rivals},
            "system_id": {one.system for one in rivals},
        }
        marks = MARKS[self.settings.message]
        differs |= {KEYS.get(mark, mark): {one.marks[at] for one in rivals} for at, mark in enumerate(marks)}
        return [f"ranging.{key}" for key, values in differs.items() if len(values) > 1]

    def _hear(self, message: Message, reader: RangeReader, now: float) -> None:
        ids = (message.get_srcSystem(), message.get_srcComponent())
        if message.get_msgId() == HEARTBEAT:
            if message.autopilot != dialect.MAV_AUTOPILOT_INVALID and message.type != dialect.MAV_TYPE_GCS:
                self.vehicles[ids] = describe_vehicle(message)
                self.heartbeats[ids] += 1
            return
        kind = next(name for name, one in RANGING_MESSAGES.items() if one.id == message.get_msgId())
        marks = tuple(plain_text(str(getattr(message, mark))) for mark in MARKS[kind])
        if kind == "named_value_float" and kind != self.settings.message and marks != (self.settings.name,):
            return  # values of any kind come under names
        heard = self.senders.setdefault(Sender(kind, *ids, marks), Heard())
        foreign = reader.rejected[Reject.WRONG_SOURCE.value]
        heard.messages += 1
        heard.taken += reader.read(message, now) is not None
        heard.ignored += reader.rejected[Reject.WRONG_SOURCE.value] - foreign
