"""Steps of the loop of a recorded flight: exact from a run folder, reconstructed from a plain
tlog."""

import csv
from collections.abc import Hashable, Iterator
from contextlib import closing
from itertools import groupby, islice
from pathlib import Path

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.foreign import read_lines
from circnav_mav.mav.codec import Decoder, Ids, Message, ids
from circnav_mav.mav.framing import V2
from circnav_mav.pilot.loop_step import HELD_BACK, STEPS, LoopStep, requests_from
from circnav_mav.runlog.run_folder import RunError
from circnav_mav.runlog.tlog import find_damage, message_id, read_tlog, read_unbroken

LINKS = {"v": "vehicle", "r": "ranging"}
HEARTBEAT = dialect.MAVLINK_MSG_ID_HEARTBEAT
SENDING_COMPONENT = 6
"""Position of the sender's component id in a MAVLink 2 frame."""


def recorded_steps(folder: Path) -> Iterator[LoopStep]:
    """Yield the steps of a run folder, up to the first damage or to the end of steps.csv or
    flight.tlog. Raises OSError."""
    frames = (frame for _, frame in read_unbroken(folder / "flight.tlog"))
    with closing(read_lines(folder / STEPS, errors="replace")) as lines:
        rows = csv.reader(lines)
        try:
            next(rows, ())
            for row in rows:
                yield _step(row, frames)
        except (ValueError, TypeError, KeyError, csv.Error):
            # Each row of steps.csv holds only the number of its frames. After a damaged row, the
            # frames of later rows are unknown.
            return


def _step(row: list[str], frames: Iterator[bytes]) -> LoopStep:
    """Return the step of a row of steps.csv, with its frames from the tlog. Raises ValueError or
    KeyError for a damaged row or missing frames."""

    def take(count: int) -> list[bytes]:
        taken = list(islice(frames, count))
        if len(taken) < count:
            raise ValueError("the log ends")
        return taken

    time_us, datagrams, sent, hello, interrupt, attached, requests, exchanged = row
    parts = (datagram.partition("*") for datagram in datagrams.split())
    held_back = sent == HELD_BACK
    return LoopStep(
        int(time_us) / 1e6,
        received=[
            (LINKS[source[:1]], _source(source), take(int(count))) for source, _, count in parts
        ],
        sent=take(0 if held_back else int(sent or 0)),
        hello=take(int(hello or 0)),
        attached=take(int(attached or 0)),
        requests=requests_from(requests),
        exchanged=take(int(exchanged or 0)),
        interrupt=interrupt,
        held_back=held_back,
    )


def _source(number: str) -> Hashable:
    """Return the source of a number in steps.csv: an address, host and port, if the number has a
    part for the port."""
    host, point, port = number.partition(".")
    return (host, port) if point else number


def check_tlog(path: Path) -> None:
    """Check that a plain tlog is undamaged, and holds MAVLink 2 frames of one vehicle with
    timestamps of one clock. Raises RunError, OSError."""
    decoder = Decoder(wanted=frozenset((HEARTBEAT,)))
    newest: int | None = None
    vehicles: set[Ids] = set()
    for stamp, frame in read_tlog(path):
        if frame[0] != V2:
            raise RunError(
                f"{path}: has MAVLink 1 frames: only a tlog of MAVLink 2 can be replayed"
            )
        # -100_000: largest accepted step back of a timestamp, us. The two threads of a logger write
        # frames slightly out of order. A larger step back means another clock.
        # 3_600_000_000: largest accepted gap, us. A larger step forward means that the clock was
        # set, for example from 1970 to the present.
        before = stamp if newest is None else newest
        if not -100_000 <= stamp - before <= 3_600_000_000:
            jump = (stamp - before) / 1e6
            raise RunError(
                f"{path}: its clock jumps by {jump:+.1f} s: only a tlog of one clock can be"
                " replayed"
            )
        newest = max(before, stamp)
        if message_id(frame) == HEARTBEAT:
            vehicles.update(map(ids, filter(_is_autopilot, decoder.decode(frame))))
    if len(vehicles) > 1:
        names = ", ".join(f"{system}/{component}" for system, component in sorted(vehicles))
        raise RunError(
            f"{path}: has the autopilots {names}: only a tlog of one vehicle can be replayed"
        )
    if newest is not None and (damage := find_damage(path)) is not None:
        raise RunError(f"{path}: {damage}: only an undamaged tlog can be replayed")


def _is_autopilot(heartbeat: Message) -> bool:
    no_autopilot = heartbeat.autopilot == dialect.MAV_AUTOPILOT_INVALID
    return not no_autopilot and heartbeat.type != dialect.MAV_TYPE_GCS


def tlog_steps(path: Path, ours: int) -> Iterator[LoopStep]:
    """Yield steps reconstructed from a plain tlog. Frames with the same timestamp are received
    together, on one link.

    ours: component id of circnav, whose frames are left out because circnav sent them. Step times
    start at the first timestamp and never decrease. Raises OSError.
    """
    first: int | None = None
    newest = 0
    for stamp, records in groupby(read_tlog(path), key=lambda record: record[0]):
        first = stamp if first is None else first
        newest = max(newest, stamp)
        received = [frame for _, frame in records if frame[SENDING_COMPONENT] != ours]
        if received:
            yield LoopStep((newest - first) / 1e6, [("vehicle", "tlog", received)])
