"""A flight as the steps of its loop: exactly those of a run folder, and those that a plain tlog can stand for; and who
speaks in a plain tlog."""

import csv
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from itertools import chain, groupby, islice, pairwise
from pathlib import Path

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.foreign import read_lines
from circnav_mav.mav.codec import Decoder, Ids, Message, ids
from circnav_mav.mav.framing import V2, as_version_2
from circnav_mav.mav.identity import describe_vehicle
from circnav_mav.mav.ranging.interface import RangingSettings, Reject
from circnav_mav.mav.ranging.reader import RangeReader
from circnav_mav.mav.ranging.sources import RangeSource
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from circnav_mav.pilot import Pilot
from circnav_mav.pilot.loop_step import HELD_BACK, LoopStep, requests_from
from circnav_mav.runlog.tlog import message_id, read_tlog, read_unbroken

LINKS = {"v": "vehicle", "r": "ranging"}
MOST_FRAMES = 10_000
"""More than a datagram of any size can hold."""
DISORDER = 100_000
"""Time, us, by which a stamp may lie before the last: two threads of a logger, and no clock that was set."""
USUAL = 1_000_000
"""Time, us, from one stamp to the next beyond which the stamp after it must agree."""
LONGEST_SILENCE = 3_600_000_000
"""Time, us, that a log may be silent; a longer way ahead is a clock that was set, as from 1970 to now."""


def recorded_steps(folder: Path) -> Iterator[LoopStep]:
    """The steps of a run folder, up to where its files were cut off or damaged. Raises OSError."""
    frames = (frame for _, frame in read_unbroken(folder / "flight.tlog"))
    with closing(read_lines(folder / "turns.csv", errors="replace")) as lines:
        rows = csv.reader(lines)
        try:
            next(rows, ())
            for row in rows:
                yield _step(row, frames)
        except (ValueError, KeyError, csv.Error):
            return  # frames are counted off one by one: behind a damaged line nobody knows whose they are


def has_requests(folder: Path) -> bool:
    """True if a run folder is of a version that records requests for another circle. Raises OSError."""
    with (folder / "turns.csv").open(encoding="utf-8", errors="replace") as file:
        return "requests" in file.readline()


def _step(row: list[str], frames: Iterator[bytes]) -> LoopStep:
    """A line of turns.csv with its frames out of the tlog. Raises ValueError, KeyError for what the recorder never
    wrote, and where the frames are not all there."""

    def take(count: int) -> list[bytes]:
        taken = list(islice(frames, min(count, MOST_FRAMES)))
        if len(taken) < count:
            raise ValueError("the log ends")
        return taken

    time_us, datagrams, said, hello, interrupt, *later = row
    parts, held_back = (datagram.partition("*") for datagram in datagrams.split()), said == HELD_BACK
    return LoopStep(
        int(time_us) / 1e6,
        heard=[(LINKS[source[:1]], source, take(int(count))) for source, _, count in parts],
        said=take(0 if held_back else int(said or 0)),
        hello=take(int(hello or 0)),
        attached=take(int(later[0] or 0) if later else 0),
        requests=requests_from(later[1]) if len(later) > 1 else [],
        exchanged=take(int(later[2] or 0) if len(later) > 2 else 0),
        interrupt=interrupt,
        held_back=held_back,
    )


def tlog_steps(path: Path, ours: int, clock: "LogClock | None" = None) -> Iterator[LoopStep]:
    """The steps that a plain tlog stands for: frames of one stamp come in together, on one link.

    ours: our own component id, whose frames went out and did not come in. clock: notes where the clock of the stamps
    was set. Times count from the first stamp and never go back. Raises OSError.
    """
    clock = LogClock() if clock is None else clock
    together = groupby(read_tlog(path), key=lambda record: record[0])
    stamped = ((stamp, [frame for _, frame in group]) for stamp, group in together)
    end: tuple[int | None, list[bytes]] = (None, [])
    for (stamp, frames), (following, _) in pairwise(chain(stamped, [end])):
        assert stamp is not None
        time = clock.at(stamp, following)
        # A vehicle that sends MAVLink 1 cannot be flown, because it may not read our MAVLink 2. In a replay nothing is
        # sent to it, and its recorded frames say the same in either version.
        received = [as_version_2(frame) for frame in frames if frame[6 if frame[0] == V2 else 4] != ours]
        if received:
            yield LoopStep(time, [("vehicle", "tlog", received)])


@dataclass(slots=True)
class LogClock:
    """Run time from the stamps (us) of a plain tlog, whose clock may have been set while it was written. A step of the
    clock takes no time; a lone stamp that is far off moves nothing. steps: (run time, size) of each step, s. lone: how
    far, s, the lone ones were off."""

    steps: list[tuple[float, float]] = field(default_factory=list)
    lone: list[float] = field(default_factory=list)
    _newest: int | None = None
    _run: int = 0

    def at(self, stamp: int, following: int | None) -> float:
        """Run time, s, of a stamp. following: the stamp after it, None at the end of the log."""
        newest = stamp if self._newest is None else self._newest
        moved = stamp - newest
        # One stamp alone cannot tell a clock that was set from a damaged record: the stamp after it decides. Where it
        # goes on from the old time, the far one was damaged; where it stays at the new time, the clock was set.
        alone = following is not None and _is_lone(moved, following - newest)
        if -DISORDER <= moved <= USUAL or (0 < moved <= LONGEST_SILENCE and not alone):
            self._newest, self._run = newest + max(moved, 0), self._run + max(moved, 0)
        elif alone:
            self.lone.append(moved / 1e6)
        else:
            self.steps.append((self._run / 1e6, moved / 1e6))
            self._newest = stamp
        return self._run / 1e6

    def __str__(self) -> str:
        """What was wrong with the stamps, in words; empty where nothing was."""
        problems = []
        if self.steps:
            at, size = max(self.steps, key=lambda step: abs(step[1]))
            how_many = "1 time" if len(self.steps) == 1 else f"{len(self.steps)} times, at most"
            problems.append(f"its clock steps {how_many} by {size:+.1f} s (at {at:.1f} s), which is taken for no time")
        if self.lone:
            how_many = "1 lone stamp is" if len(self.lone) == 1 else f"{len(self.lone)} lone stamps are, at most,"
            problems.append(f"{how_many} off by {max(self.lone, key=abs):+.1f} s")
        return "; ".join(problems)


def _is_lone(moved: int, then: int) -> bool:
    """Whether the stamp after a far one goes on where the last one stood. Both count from the last one, us."""
    return -DISORDER <= then <= LONGEST_SILENCE and (moved < 0 or then < moved - DISORDER)


HEARTBEAT = dialect.MAVLINK_MSG_ID_HEARTBEAT
_OF_ANOTHER = (Reject.WRONG_SOURCE.value, Reject.OTHER_SENSOR.value, Reject.AMBIGUOUS.value)
"""Reasons for which a range that fits the mission is ignored beside another source."""


@dataclass(slots=True)
class RangeCounts:
    """What became of the ranges of one source. ignored: those that fit the mission but came beside another source's."""

    messages: int = 0
    taken: int = 0
    ignored: int = 0


@dataclass(slots=True)
class LogSources:
    """Listens to the steps that a pilot replays. vehicle: the one that the pilot took last. vehicles: what each
    autopilot is. ranging: the sources of ranges with the mission's name of their message, those that do not fit the
    mission included."""

    settings: RangingSettings
    vehicle: Ids | None = None
    vehicles: dict[Ids, str] = field(default_factory=dict)
    heartbeats: Counter[Ids] = field(default_factory=Counter)
    ranging: dict[tuple[str, RangeSource], RangeCounts] = field(default_factory=dict)
    ambiguous: int = 0
    """Ranges that were not used because several sources fit the mission."""

    def watch(self, steps: Iterable[LoopStep], pilot: Pilot) -> Iterator[LoopStep]:
        """The steps as they are, on their way to the pilot."""
        wanted = frozenset({HEARTBEAT, *(one.id for one in RANGING_MESSAGES.values())})
        decoder, reader = Decoder(wanted=wanted), RangeReader(self.settings)
        for step in steps:
            for frame in (frame for frame in step.frames_heard if message_id(frame) in wanted):
                for message in decoder.decode(frame):
                    self._count(message, reader, step.time)
            yield step
            if pilot.session.up:
                self.vehicle = pilot.session.vehicle_ids

    @property
    def candidates(self) -> list[RangeSource]:
        """The sources that fit the mission, where there is more than one and no word of it which one is meant."""
        named = self.settings.system_id is not None or self.settings.component_id is not None
        fit = [source for (_, source), counts in self.ranging.items() if counts.taken or (counts.ignored and not named)]
        return fit if len(fit) > 1 else []

    def _count(self, message: Message, reader: RangeReader, now: float) -> None:
        sender = ids(message)
        if message.get_msgId() == HEARTBEAT:
            if message.autopilot != dialect.MAV_AUTOPILOT_INVALID and message.type != dialect.MAV_TYPE_GCS:
                self.vehicles[sender] = describe_vehicle(message)
                self.heartbeats[sender] += 1
            return
        name, kind = next(item for item in RANGING_MESSAGES.items() if item[1].id == message.get_msgId())
        if kind.for_anything and name != self.settings.message and not kind.picked(message, self.settings):
            return  # values of any kind come under names
        counts = self.ranging.setdefault((name, RangeSource.of(message, kind)), RangeCounts())
        fits = name == self.settings.message and kind.picked(message, self.settings)
        ignored = sum(reader.rejected[reason] for reason in _OF_ANOTHER)
        counts.messages += 1
        counts.taken += reader.read(message, now) is not None
        self.ambiguous = reader.rejected[Reject.AMBIGUOUS.value]
        counts.ignored += fits and sum(reader.rejected[reason] for reason in _OF_ANOTHER) - ignored
