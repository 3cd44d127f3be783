"""Replay of a recorded flight through a pilot. The vehicle does not respond to new commands: its
path is as flown."""

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from math import inf
from operator import attrgetter

import numpy as np
from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.types import SAME_TIME
from circnav_mav.mav.frames import YawRate
from circnav_mav.mav.framing import split_frames
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import Pilot, TickRecord
from circnav_mav.pilot.controller import FlownCommands
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runlog.ticks import NAMES, WORDS, Column, Ticks, Truth
from circnav_mav.runlog.tlog import message_id

SETPOINT_IDS = frozenset((
    dialect.MAVLINK_MSG_ID_MANUAL_CONTROL, dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
    dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
))  # fmt: skip
"""Message ids of setpoints."""
STEERING = attrgetter("orbit", "tuning", "estimator", "ranging", "turn_gain", "file.orbit")
"""Values of a mission that determine the turn commands of a pilot."""
COMPARED = ("r", "r_dot", "demanded", "turn_rate")

Sent = list[tuple[float, bytes]]


@dataclass(slots=True)
class ReplayResult:
    """Result of a replay.

    ticks: ticks of the replay.
    sent, was_sent: (time, frame) sent in the replay and in the log, in order.
    steps, frames: number of replayed steps and frames.
    until: time of the last step, s.
    ended: time when the pilot was done, s, or None. Later steps are ignored.
    """

    ticks: list[TickRecord] = field(default_factory=list)
    sent: Sent = field(default_factory=list)
    was_sent: Sent = field(default_factory=list)
    steps: int = 0
    frames: int = 0
    until: float = 0.0
    ended: float | None = None

    @property
    def setpoints(self) -> Sent:
        """Setpoints of the replay."""
        return [(time, frame) for time, frame in self.sent if message_id(frame) in SETPOINT_IDS]

    @property
    def was_setpoints(self) -> Sent:
        """Setpoints in the log."""
        return [(time, frame) for time, frame in self.was_sent if message_id(frame) in SETPOINT_IDS]

    @property
    def identical(self) -> bool:
        """True if all sent frames equal those in the log, in bytes and time."""
        return self.sent == self.was_sent

    @property
    def first_difference(self) -> float | None:
        """Time of the first sent frame that differs, s, or None."""
        pairs = zip_longest(self.sent, self.was_sent, fillvalue=(inf, b""))
        return next((min(one[0], other[0]) for one, other in pairs if one != other), None)


def replay(pilot: Pilot, steps: Iterable[LoopStep], *, ticking: bool = False) -> ReplayResult:
    """Feed steps to a pilot at their times. ticking: also run ticks when they are due, for a log
    that does not contain all steps."""
    done = ReplayResult()
    for step in steps:
        # 10.0: longest time for which ticks continue in a gap of a plain tlog, s.
        received_until = min(step.time, done.until + 10.0)
        while ticking and done.steps and pilot.scheduler.due < received_until and not pilot.done:
            _step(pilot, pilot.scheduler.due, done)
        if not pilot.done:
            _feed(pilot, step)
            _step(pilot, step.time, done, held_back=step.held_back)
            pilot.take_frames()
        done.was_sent += [(step.time, frame) for frame in step.sent + step.hello]
        done.frames += len(step.received_frames)
        done.steps += 1
        done.until = step.time
    return done


def _feed(pilot: Pilot, step: LoopStep) -> None:
    """Give a pilot the inputs of a step."""
    for link, source, frames in step.received:
        for frame in frames:
            pilot.receive(frame, step.time, source, link)
    for request in step.requests:
        pilot.request_circle(request, step.time)
    if step.interrupt and pilot.mission.outcome is None:
        pilot.interrupt(step.time, step.interrupt)


def _step(pilot: Pilot, now: float, done: ReplayResult, *, held_back: bool = False) -> None:
    def send(data: bytes) -> bool:
        if not held_back:
            done.sent += [(now, frame) for frame in split_frames(data)]
        return not held_back

    pilot.step(now, send)
    if pilot.settings.ranging_apart:
        done.sent += [(now, frame) for frame in split_frames(pilot.hello(now))]
    done.ticks += pilot.take_records()
    done.ended = now if pilot.done else None


def without_timeouts(mission: Mission) -> Mission:
    """Return the mission for a plain tlog: without timeouts, and with a single link."""
    file = mission.file
    changes = {
        "limits": file.limits.model_copy(update={"duration_s": inf, "coast_s": inf}),
        "link": file.link.model_copy(update={"wait_s": inf, "endpoint": "udpin"}),
        "ranging": file.ranging.model_copy(update={"endpoint": None}),
    }
    return replace(mission, file=file.model_copy(update=changes))


def flown_commands(mission: Mission, flown: Mission, was: Ticks) -> FlownCommands | None:
    """Return the commands of the flight. None if the replay steers by the same mission as the
    flight."""
    if STEERING(mission) == STEERING(flown):
        return None
    sent = was.numbers["yaw_rate_sent"]
    known = np.isfinite(sent)
    times = was.time[known].tolist()
    rates = sent[known].tolist()

    def sent_at(now: float) -> YawRate | None:
        newest = bisect_right(times, now + SAME_TIME) - 1
        # Largest age of the command that the flight had sent, s. A tick of the replay may lie
        # between two ticks of the flight. The flight sends commands more often than this.
        if newest < 0 or now - times[newest] > 0.5:
            return None
        return YawRate(rates[newest])

    return sent_at


@dataclass(frozen=True, slots=True)
class Difference:
    """Difference of a column between flight and replay: RMS and largest, in its unit, over the
    common ticks."""

    column: str
    rms: float
    largest: float
    ticks: int


def differences(was: Ticks, would: Ticks) -> list[Difference]:
    """Return the differences of the COMPARED columns, over ticks of equal time."""
    _, here, there = np.intersect1d(
        np.round(was.time * 1e6), np.round(would.time * 1e6), return_indices=True
    )
    found = []
    for column in COMPARED:
        gap = would.numbers[column][there] - was.numbers[column][here]
        gap = gap[~np.isnan(gap)]
        if len(gap):
            found.append(
                Difference(
                    column, float(np.sqrt(np.mean(gap**2))), float(np.max(np.abs(gap))), len(gap)
                )
            )
    return found


def as_ticks(records: list[TickRecord]) -> Ticks:
    """Return tick records as columns, as read from a ticks.csv."""

    def column(name: str) -> Column:
        return np.array(
            [np.nan if (v := getattr(record, name)) is None else float(v) for record in records]
        )

    words = {name: [str(getattr(record, name)) for record in records] for name in WORDS - {"phase"}}
    words["phase"] = [record.phase.value for record in records]
    return Ticks({name: column(name) for name in NAMES - WORDS}, words)


def truth_errors(ticks: Ticks, truth: Truth) -> dict[str, float]:
    """Return the RMS errors of the estimates in the steering ticks, against the simulator's truth:
    r and position (m) and r_dot (m/s). An error without estimates is left out."""
    steered = np.array([phase == "engaged" for phase in ticks.words["phase"]], bool)
    steered &= (ticks.time >= truth.time[0]) & (ticks.time <= truth.time[-1])
    time = ticks.time[steered]
    x, y = (
        np.interp(time, truth.time, offset)
        for offset in (truth.east - truth.target_east, truth.north - truth.target_north)
    )
    rate = np.gradient(truth.radius, truth.time) if len(truth.time) > 1 else truth.radius
    number = {name: ticks.numbers[name][steered] for name in ("r", "r_dot", "x", "y")}
    errors = {
        "r": number["r"] - np.hypot(x, y),
        "r_dot": number["r_dot"] - np.interp(time, truth.time, rate),
        "position": np.hypot(number["x"] - x, number["y"] - y),
    }
    return {
        name: float(np.sqrt(np.nanmean(error**2)))
        for name, error in errors.items()
        if not np.isnan(error).all()
    }
