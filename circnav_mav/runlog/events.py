"""Events of a run as texts: changes of phase, mode and law, rejected ranges, alarms, STATUSTEXT
messages."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Ids, ids
from circnav_mav.mav.identity import OUR_COMPONENTS
from circnav_mav.mav.statustext import TextReader, plain_text
from circnav_mav.runlog.run_folder import Run
from circnav_mav.runlog.ticks import Ticks
from circnav_mav.runlog.tlog import read_messages

OURS = "circnav message"
ALARM = "alarm"
SEVERE = {"vehicle message": 3, OURS: 4}
"""Largest MAV_SEVERITY of a severe message, by kind of event: ERROR for the vehicle, WARNING for
circnav. A smaller number is more severe."""


@dataclass(frozen=True, slots=True)
class Event:
    """One event.

    time: run time, s.
    kind: phase, mode, law, rejected, alarm (when it began), vehicle message, circnav message.
    severe: True for alarms, for vehicle messages of ERROR or worse, and for circnav messages of
        WARNING or worse.
    """

    time: float
    kind: str
    text: str
    severe: bool = False


def events(run: Run) -> list[Event]:
    """Return all events of a run, sorted by time. Raises RunError, OSError."""
    seen = (
        Event(alarm["time_s"], ALARM, plain_text(alarm["text"]), True)
        for alarm in run.summary.get("alarms", ())
    )
    return sorted([*_changes(run.ticks), *seen, *_texts(run)], key=lambda event: event.time)


def _changes(ticks: Ticks) -> Iterator[Event]:
    for kind, words in sorted(ticks.words.items()):
        before = None
        for time, word in zip(ticks.time, words, strict=True):
            if word != before:
                yield Event(float(time), kind, plain_text(word))
            before = word
    steps = np.diff(ticks.numbers["rejected"], prepend=0.0)
    for at in np.flatnonzero(steps > 0):
        yield Event(float(ticks.time[at]), "rejected", f"ranges rejected: {steps[at]:.0f}")


def _texts(run: Run) -> list[Event]:
    reader = TextReader()
    found = list[Event]()
    newest: dict[Ids, int] = {}
    for stamp, message in read_messages(
        run.folder / "flight.tlog", {dialect.MAVLINK_MSG_ID_STATUSTEXT}
    ):
        sender = ids(message)
        who = OURS if sender[1] in OUR_COMPONENTS else "vehicle message"
        text, before = reader.read(message)
        text = text.removeprefix("circnav: ")  # the prefix of circnav's own texts
        if before is None:
            newest[sender] = len(found)
            found.append(
                Event((stamp - run.epoch_us) / 1e6, who, text, message.severity <= SEVERE[who])
            )
        else:
            found[newest[sender]] = replace(found[newest[sender]], text=text)
    return found
