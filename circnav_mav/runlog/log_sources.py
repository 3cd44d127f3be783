"""Who speaks in a plain tlog: the vehicles, and the sources of ranges with what a mission picks them by."""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Decoder, Message
from circnav_mav.mav.identity import describe_vehicle
from circnav_mav.mav.ranging.interface import RangingSettings, Reject
from circnav_mav.mav.ranging.reader import RangeReader
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from circnav_mav.mav.statustext import plain_text
from circnav_mav.pilot import Pilot
from circnav_mav.runlog.loop_steps import LoopStep
from circnav_mav.runlog.tlog import message_id

HEARTBEAT = dialect.MAVLINK_MSG_ID_HEARTBEAT
Ids = tuple[int, int]


@dataclass(frozen=True, slots=True)
class RangeSource:
    """A source of ranges. message: the mission's name of it. marks: the values of its message's marks."""

    message: str
    system: int
    component: int
    marks: tuple[str, ...]


@dataclass(slots=True)
class RangeCounts:
    """What became of the ranges of one source. ignored: those that fit the mission but came beside another source's."""

    messages: int = 0
    taken: int = 0
    ignored: int = 0


@dataclass(slots=True)
class LogSources:
    """Listens to the steps that a pilot replays. vehicle: the one that the pilot took last. vehicles: what each
    autopilot is. ranging: the sources of ranges, those that do not fit the mission included."""

    settings: RangingSettings
    vehicle: Ids | None = None
    vehicles: dict[Ids, str] = field(default_factory=dict)
    heartbeats: Counter[Ids] = field(default_factory=Counter)
    ranging: dict[RangeSource, RangeCounts] = field(default_factory=dict)

    def watch(self, steps: Iterable[LoopStep], pilot: Pilot) -> Iterator[LoopStep]:
        """The steps as they are, on their way to the pilot."""
        wanted = frozenset({HEARTBEAT, *(one.id for one in RANGING_MESSAGES.values())})
        decoder, reader = Decoder(wanted=wanted), RangeReader(self.settings)
        for step in steps:
            for frame in (frame for _, _, frame in step.received if message_id(frame) in wanted):
                for message in decoder.decode(frame):
                    self._count(message, reader, step.time)
            yield step
            if pilot.session.up:
                self.vehicle = pilot.session.vehicle_ids

    @property
    def candidates(self) -> list[RangeSource]:
        """The sources that fit the mission, where there is more than one and no word of it which one is meant."""
        named = self.settings.system is not None or self.settings.component is not None
        fit = [source for source, counts in self.ranging.items() if counts.taken or (counts.ignored and not named)]
        return fit if len(fit) > 1 else []

    @property
    def distinguishing_keys(self) -> list[str]:
        """The keys of the mission in which the candidates differ."""
        candidates = self.candidates
        differs: dict[str, set[int] | set[str]] = {
            "component_id": {one.component for one in candidates},
            "system_id": {one.system for one in candidates},
        }
        keys = RANGING_MESSAGES[self.settings.message].marks.values()
        differs |= {key: {one.marks[at] for one in candidates} for at, key in enumerate(keys)}
        return [f"ranging.{key}" for key, values in differs.items() if len(values) > 1]

    def _count(self, message: Message, reader: RangeReader, now: float) -> None:
        ids = (message.get_srcSystem(), message.get_srcComponent())
        if message.get_msgId() == HEARTBEAT:
            if message.autopilot != dialect.MAV_AUTOPILOT_INVALID and message.type != dialect.MAV_TYPE_GCS:
                self.vehicles[ids] = describe_vehicle(message)
                self.heartbeats[ids] += 1
            return
        name, kind = next(item for item in RANGING_MESSAGES.items() if item[1].id == message.get_msgId())
        marks = tuple(plain_text(str(value)) for value in kind.mark_values(message).values())
        if kind.for_anything and name != self.settings.message and not kind.picked(message, self.settings):
            return  # values of any kind come under names
        counts = self.ranging.setdefault(RangeSource(name, *ids, marks), RangeCounts())
        foreign = reader.rejected[Reject.WRONG_SOURCE.value]
        counts.messages += 1
        counts.taken += reader.read(message, now) is not None
        counts.ignored += reader.rejected[Reject.WRONG_SOURCE.value] - foreign
