"""A flight as the turns of its loop: exactly those of a run folder, and those that a plain tlog can stand for."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, groupby, islice, pairwise
from pathlib import Path

from circnav_mav.runlog.log_clock import LogClock
from circnav_mav.runlog.tlog import read_tlog, read_unbroken

LINKS = {"v": "vehicle", "r": "ranging"}
HELD_BACK = "held"
"""In the place of a count: nothing of what there was to say was sent."""
MOST_FRAMES = 10_000
"""More than a datagram of any size can hold."""


@dataclass(frozen=True, slots=True)
class Turn:
    """One turn of the loop: (link, source, frame) of all that came in, our own frames, why it was interrupted, and
    whether what there was to say was not sent."""

    time: float
    heard: tuple[tuple[str, str, bytes], ...]
    said: tuple[bytes, ...] = ()
    interrupt: str = ""
    held_back: bool = False


def recorded_turns(folder: Path) -> Iterator[Turn]:
    """The turns of a run folder, up to where its files were cut off or damaged. Raises OSError."""
    frames = (frame for _, frame in read_unbroken(folder / "flight.tlog"))
    with (folder / "turns.csv").open(newline="", encoding="utf-8", errors="replace") as file:
        rows = csv.reader(file)
        try:
            next(rows, ())
            for row in rows:
                turn = _turn(row, frames)
                if turn is None:
                    return
                yield turn
        except (ValueError, KeyError, csv.Error):
            return


def _turn(row: list[str], frames: Iterator[bytes]) -> Turn | None:
    """A line of turns.csv with its frames out of the tlog; None if they are not all there. Raises ValueError, KeyError
    for what the recorder never wrote."""
    time_us, datagrams, said, hello, interrupt = row
    sources = []
    for datagram in datagrams.split():
        source, _, count = datagram.partition("*")
        sources += [source] * min(int(count), MOST_FRAMES)
    heard = tuple((LINKS[source[:1]], source, frame) for source, frame in zip(sources, frames, strict=False))
    held_back = said == HELD_BACK
    ours = (0 if held_back else int(said or 0)) + int(hello or 0)
    spoken = tuple(islice(frames, ours))
    if len(heard) < len(sources) or len(spoken) < ours:
        return None
    return Turn(int(time_us) / 1e6, heard, spoken, interrupt, held_back)


def plain_turns(path: Path, ours: int, clock: LogClock | None = None) -> Iterator[Turn]:
    """The turns that a plain tlog stands for: frames of one stamp come in together, on one link.

    ours: our own component id, whose frames went out and did not come in. clock: takes down where the stamps' own clock
    was set. Times count from the first stamp and never go back. Raises OSError.
    """
    clock = LogClock() if clock is None else clock
    together = groupby(read_tlog(path), key=lambda record: record[0])
    stamped = ((stamp, [frame for _, frame in group]) for stamp, group in together)
    end: tuple[int | None, list[bytes]] = (None, [])
    for (stamp, frames), (following, _) in pairwise(chain(stamped, [end])):
        assert stamp is not None
        time = clock.at(stamp, following)
        heard = tuple(("vehicle", "tlog", frame) for frame in frames if _component(frame) != ours)
        if heard:
            yield Turn(time, heard)


def _component(frame: bytes) -> int:
    return frame[6] if frame[0] == 0xFD else frame[4]
