"""Steps of the loop of a recorded flight: exact from a run folder, reconstructed from a plain tlog. Also lists the
senders in a plain tlog."""

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
from circnav_mav.pilot.loop_step import HELD_BACK, STEPS, LoopStep, requests_from
from circnav_mav.runlog.tlog import message_id, read_tlog, read_unbroken

LINKS = {"v": "vehicle", "r": "ranging"}
DISORDER = 100_000
"""Largest step back of a timestamp, us, that counts as disorder of a logger's two threads, not as a clock that was
set."""
USUAL = 1_000_000
"""Largest step forward, us, that is accepted without checking the timestamp after it."""
LONGEST_SILENCE = 3_600_000_000
"""Longest gap in a log, us. A larger step forward means that the clock was set, such as from 1970 to now."""


def recorded_steps(folder: Path) -> Iterator[LoopStep]:
    """Yield the steps of a run folder, up to the first damage or the end of either file. Raises OSError."""
    frames = (frame for _, frame in read_unbroken(folder / "flight.tlog"))
    with closing(read_lines(folder / STEPS, errors="replace")) as lines:
        rows = csv.reader(lines)
        try:
            next(rows, ())
            for row in rows:
                yield _step(row, frames)
        except (ValueError, TypeError, KeyError, csv.Error):
            # Frames are assigned to steps by their count. After a damaged line, the assignment is unknown.
            return


def _step(row: list[str], frames: Iterator[bytes]) -> LoopStep:
    """Return the step of a row of steps.csv, with its frames from the tlog. Raises ValueError or KeyError for a damaged
    row or missing frames."""

    def take(count: int) -> list[bytes]:
        taken = list(islice(frames, count))
        if len(taken) < count:
            raise ValueError("the log ends")
        return taken

    time_us, datagrams, sent, hello, interrupt, attached, requests, exchanged = row
    parts, held_back = (datagram.partition("*") for datagram in datagrams.split()), sent == HELD_BACK
    return LoopStep(
        int(time_us) / 1e6,
        received=[(LINKS[source[:1]], source, take(int(count))) for source, _, count in parts],
        sent=take(0 if held_back else int(sent or 0)),
        hello=take(int(hello or 0)),
        attached=take(int(attached or 0)),
        requests=requests_from(requests),
        exchanged=take(int(exchanged or 0)),
        interrupt=interrupt,
        held_back=held_back,
    )


def tlog_steps(path: Path, ours: int, clock: "LogClock | None" = None) -> Iterator[LoopStep]:
    """Yield steps reconstructed from a plain tlog. Frames with the same timestamp are received together, on one link.

    ours: component id of circnav, whose frames are left out because circnav sent them. clock: records where the clock
    of the timestamps was set. Step times start at the first timestamp and never decrease. Raises OSError.
    """
    clock = LogClock() if clock is None else clock
    together = groupby(read_tlog(path), key=lambda record: record[0])
    stamped = ((stamp, [frame for _, frame in group]) for stamp, group in together)
    end: tuple[int | None, list[bytes]] = (None, [])
    for (stamp, frames), (following, _) in pairwise(chain(stamped, [end])):
        assert stamp is not None
        time = clock.at(stamp, following)
        # A vehicle that sends MAVLink 1 cannot be flown, because it might ignore our MAVLink 2. A replay sends nothing,
        # and the recorded frames have the same content in either version.
        received = [as_version_2(frame) for frame in frames if frame[6 if frame[0] == V2 else 4] != ours]
        if received:
            yield LoopStep(time, [("vehicle", "tlog", received)])


@dataclass(slots=True)
class LogClock:
    """Run time from the timestamps (us) of a plain tlog, whose clock may have been set during the flight.

    A step of the clock counts as no time, and a single wrong timestamp is ignored. steps: (run time, size) of each
    step, s. single: error of each single wrong timestamp, s.
    """

    steps: list[tuple[float, float]] = field(default_factory=list)
    single: list[float] = field(default_factory=list)
    _newest: int | None = None
    _run: int = 0

    def at(self, stamp: int, following: int | None) -> float:
        """Return the run time of a timestamp, s. following: the timestamp after it, None at the end of the log."""
        newest = stamp if self._newest is None else self._newest
        moved = stamp - newest
        # A timestamp far off is either a damaged record or a clock that was set. The timestamp after it decides: if it
        # continues from the old time, the record was damaged. If it stays at the new time, the clock was set.
        alone = following is not None and _is_single(moved, following - newest)
        if -DISORDER <= moved <= USUAL or (0 < moved <= LONGEST_SILENCE and not alone):
            self._newest, self._run = newest + max(moved, 0), self._run + max(moved, 0)
        elif alone:
            self.single.append(moved / 1e6)
        else:
            self.steps.append((self._run / 1e6, moved / 1e6))
            self._newest = stamp
        return self._run / 1e6

    def __str__(self) -> str:
        """Describe the problems of the timestamps. Empty for none."""
        problems = []
        if self.steps:
            at, size = max(self.steps, key=lambda step: abs(step[1]))
            how_many = "1 time" if len(self.steps) == 1 else f"{len(self.steps)} times, at most"
            problems.append(f"the log's clock jumps {how_many} by {size:+.1f} s (at {at:.1f} s); the jump is ignored")
        if self.single:
            how_many = (
                "1 single timestamp is"
                if len(self.single) == 1
                else f"{len(self.single)} single timestamps are, at most,"
            )
            problems.append(f"{how_many} off by {max(self.single, key=abs):+.1f} s")
        return "; ".join(problems)


def _is_single(moved: int, then: int) -> bool:
    """True if a timestamp is far off, but the next one continues from the timestamp before it. moved, then: these two
    timestamps minus the one before them, us."""
    return -DISORDER <= then <= LONGEST_SILENCE and (moved < 0 or then < moved - DISORDER)


HEARTBEAT = dialect.MAVLINK_MSG_ID_HEARTBEAT
_OF_ANOTHER = (Reject.WRONG_SOURCE.value, Reject.OTHER_SENSOR.value, Reject.AMBIGUOUS.value)
"""Reasons to reject a range whose source fits the mission, but is not, or not yet, the chosen source."""


@dataclass(slots=True)
class RangeCounts:
    """Counts of the ranges of a source. ignored: ranges that fit the mission while another source was used."""

    messages: int = 0
    taken: int = 0
    ignored: int = 0


@dataclass(slots=True)
class LogSources:
    """Senders in the steps that a pilot replays. vehicle: ids of the vehicle that the pilot last used. vehicles:
    description of each autopilot. ranging: counts by mission name of the message and by source, including sources that
    do not fit the mission."""

    settings: RangingSettings
    vehicle: Ids | None = None
    vehicles: dict[Ids, str] = field(default_factory=dict)
    heartbeats: Counter[Ids] = field(default_factory=Counter)
    ranging: dict[tuple[str, RangeSource], RangeCounts] = field(default_factory=dict)
    ambiguous: int = 0
    """Ranges rejected because several sources fit the mission."""

    def watch(self, steps: Iterable[LoopStep], pilot: Pilot) -> Iterator[LoopStep]:
        """Yield the steps unchanged and count their senders."""
        wanted = frozenset({HEARTBEAT, *(one.id for one in RANGING_MESSAGES.values())})
        decoder, reader = Decoder(wanted=wanted), RangeReader(self.settings)
        for step in steps:
            for frame in (frame for frame in step.received_frames if message_id(frame) in wanted):
                for message in decoder.decode(frame):
                    self._count(message, reader, step.time)
            yield step
            if pilot.session.up:
                self.vehicle = pilot.session.vehicle_ids

    @property
    def candidates(self) -> list[RangeSource]:
        """Sources that fit the mission, if several do and the mission does not select one."""
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
            return  # a general message: other names carry other quantities
        counts = self.ranging.setdefault((name, RangeSource.of(message, kind)), RangeCounts())
        fits = name == self.settings.message and kind.picked(message, self.settings)
        ignored = sum(reader.rejected[reason] for reason in _OF_ANOTHER)
        counts.messages += 1
        counts.taken += reader.read(message, now) is not None
        self.ambiguous = reader.rejected[Reject.AMBIGUOUS.value]
        counts.ignored += fits and sum(reader.rejected[reason] for reason in _OF_ANOTHER) - ignored
