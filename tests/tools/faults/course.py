"""A lockstep flight over a faulty link. Every sent setpoint is parsed and checked."""

import copy
import tempfile
from collections.abc import Callable, Hashable, Mapping
from dataclasses import replace
from functools import cache
from itertools import pairwise
from math import hypot, isfinite, nan
from pathlib import Path
from typing import Any

from circnav_sim.config import parse_vehicle
from circnav_sim.vehicle import MAIN, Truth, Vehicle
from circnav_sim.vehicle import RANGING as RADIO

from circnav_mav.guidance.types import Direction, RangeSample
from circnav_mav.mav.signing import Signing
from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import RANGING, VEHICLE, Pilot, TickRecord
from circnav_mav.pilot.mission_state import STEERING, Phase
from tests.flight.lockstep import CONFIG, UNIX, clockwise_turns, true_radius
from tests.frames import output
from tests.tools.fault_link import DOWN, UP, FaultLink
from tests.tools.fault_link.frames import frames
from tests.tools.fault_link.link import Intruder
from tests.tools.faults.judge import (
    GUIDED,
    Allowed,
    Witness,
    broken_rule,
    is_heartbeat,
    is_safe,
    is_setpoint,
)

PATIENT = ("limits.coast_s=70.0", "limits.duration_s=100000.0")
BAND = 0.05
"""Largest radius error on a held circle, as a share of the radius."""
SETTLED = 110.0
STEADY = 30.0
LATEST = 400.0
SOURCE = "sim"
STRANGER = ("10.9.9.9", 6666)
TRUTH_EVERY = 0.1
PX4_PATIENCE = {"px4_copter": 1.0, "px4_plane": 0.5}
"""Timeouts of PX4 without setpoints, s: COM_OF_LOSS_T in OFFBOARD (copter), COM_RC_LOSS_T for
sticks (plane)."""

Arrival = tuple[bytes, str, Hashable]
"""Datagram, name of its link, and address of its sender."""
Keys = tuple[bytes | None, bytes | None]
"""Signing keys of the application and of the vehicle."""


class SampleRecorder:
    """Wrapper of the estimator that records each accepted sample once, if it is not older than the
    last one."""

    def __init__(self, estimator: Any) -> None:
        self._estimator = estimator
        self.newest: RangeSample | None = None
        self.backward = 0

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "_estimator":
            raise AttributeError(name)
        return getattr(self._estimator, name)

    def reset(self) -> None:
        self.newest = None
        self._estimator.reset()

    def restamp(self) -> None:
        self.newest = None
        self._estimator.restamp()

    def observe(self, sample: RangeSample) -> Any:
        if self.newest is not None and sample.stamp <= self.newest.stamp:
            self.backward += 1
        self.newest = sample
        return self._estimator.observe(sample)


class Course:
    """A pilot and a vehicle with a fault link between them, and the record of the flight."""

    def __init__(
        self,
        profile: str,
        overrides: tuple[str, ...] = (),
        *,
        stream: bool = False,
        keys: Keys = (None, None),
    ) -> None:
        mission = load_mission(CONFIG / f"{profile}.toml", (*PATIENT, *overrides))
        assert mission.file.sim is not None
        if stream:
            link = mission.file.link.model_copy(update={"endpoint": "tcp:127.0.0.1:5760"})
            mission = replace(mission, file=mission.file.model_copy(update={"link": link}))
        self.stream = stream
        self.profile = profile
        self._settings = mission
        self._key = keys[0]
        self.signing: Signing | None = None
        self._start_pilot()
        self.vehicle = _vehicle(mission.file.sim, profile, keys[1])
        self.wall: float = UNIX
        self.vehicle_wall: float | None = UNIX
        self.allowed = Allowed.of(mission)
        self.link = FaultLink()
        self.witness = Witness(profile, keys[0])
        self.source = SOURCE
        self.intruders: list[Intruder] = []
        """Attackers at another address. In each step their frames arrive at the application before
        the vehicle's frames."""
        self.forgeable = False
        """True if the attacker may be accepted as the vehicle: a limit documented in
        docs/safety.md."""
        self.way_home = 0.0
        self._drift: float | None = None
        self.clock: Callable[[float], float] = float
        self.now = 0.0
        self.forget()

    def _start_pilot(self) -> None:
        """Start or restart the application. A restart continues the signing timestamp."""
        before = self.signing
        self.signing = None if self._key is None else Signing(self._key)
        if before is not None and self.signing is not None:
            self.signing.resume(before.timestamp)
        self.pilot = Pilot(self._settings, self.signing)
        self.spy = SampleRecorder(self.pilot.tracker.estimator)
        self.pilot.tracker.estimator = self.spy  # type: ignore[assignment]

    def restart(self) -> None:
        """Kill the application and start it again at once."""
        self._start_pilot()
        self.witness.stood_still()

    @property
    def radius(self) -> float:
        return self.pilot.settings.orbit.radius

    def forget(self) -> None:
        """Reset the record of the flight."""
        self.truths: list[Truth] = []
        self.ticks: list[TickRecord] = []
        self.broken: list[str] = []
        self.worst_age = 0.0
        self.worst_told_age = 0.0
        self.steered_at: list[float] = []
        self.safe_at: float | None = None
        self._next_truth = self.now

    def fly(self, until: float, watch: Callable[["Course"], None] | None = None) -> "Course":
        """Run to a time, or until the pilot has finished."""
        while self.now < until and not self.pilot.done:
            tick = max(self.pilot.scheduler.due - (self.clock(self.now) - self.now), self.now)
            self._step(min(self.vehicle.next_event, tick, self.link.next_due, until))
            if watch is not None:
                watch(self)
        return self

    def stall(self, seconds: float, *, lost: bool = False) -> None:
        """Stop the application for a time, then let it continue. Frames that arrive meanwhile wait
        in its socket, or are lost."""
        until = self.now + seconds
        waiting: list[Arrival] = []
        while self.now < until:
            self.now = min(max(self.vehicle.next_event, self.now), until)
            self.vehicle.advance(self.now)
            arrived = self._arrivals()
            waiting += [] if lost else arrived
            self._look()
        self.stood_still(seconds)
        self._give(waiting, waited=True)
        if sum(map(is_heartbeat, frames(self._answer()))) > 1:
            self._breaks("heartbeats made up for after standing still")

    def stood_still(self, seconds: float) -> None:
        """Inform the witness of a pause. After 1 s or more, another controller may have taken over
        the vehicle."""
        if seconds >= 1.0:
            self.witness.stood_still()

    def interrupt(self) -> None:
        """End the flight by a signal. If circnav has control, the next setpoint must be the safe
        setpoint."""
        pilot = self.pilot
        steering = (
            pilot.mission.phase in STEERING
            and pilot.session.vehicle.in_our_mode
            and not self.witness.unproved
        )
        pilot.interrupt(self.clock(self.now), "SIGTERM")
        out = self._answer()
        if steering and not any(is_safe(frame) for frame in frames(out) if is_setpoint(frame)):
            self._breaks("no safe setpoint at once after the signal")

    def _step(self, due: float) -> None:
        self.now = max(due, self.now)
        if self.signing is not None:
            self.signing.advance(self.wall + self.now)
        if self.vehicle_wall is not None:
            self.vehicle.set_time(self.vehicle_wall + self.now)
        self.vehicle.advance(self.now)
        self._give(self._arrivals())
        self._answer()
        self._look()

    def _give(self, arrived: list[Arrival], *, waited: bool = False) -> None:
        for data, link, source in arrived:
            self.pilot.receive(data, self.clock(self.now), source, link)
            # the witness ignores the vehicle while setpoints are sent to another address
            if source == self.source and self.pilot.session.reply_to in (None, source):
                self.witness.receive(data, waited=waited)

    def _arrivals(self) -> list[Arrival]:
        """Return the datagrams that reach the application now, and deliver the intruders' frames to
        the vehicle."""
        arrived: list[Arrival] = [
            (data, VEHICLE, STRANGER)
            for intruder in self.intruders
            for _, data in intruder(self.now)
        ]
        for frame in self.vehicle.outgoing(MAIN):
            self.link.push(DOWN, frame, self.now)
        arrived += [(data, VEHICLE, self.source) for data in self.link.take(DOWN, self.now)]
        for way, data in self.link.intrusions(self.now):
            if way == DOWN:
                arrived.append((data, VEHICLE, self.source))
            else:
                self.vehicle.receive(data)
        if self.pilot.settings.ranging_apart:
            arrived += [(frame, RANGING, self.source) for frame in self.vehicle.outgoing(RADIO)]
        return arrived

    def _answer(self) -> bytes:
        pilot = self.pilot
        out = output(pilot, self.clock(self.now))
        pilot.take_frames()
        records = pilot.take_records()
        self.ticks += records
        self._judge(out, records)
        for data in frames(out) if self.link.tampers else (out,) if out else ():
            self.link.push(UP, data, self.now)
        for data in self.link.take(UP, self.now):
            self.vehicle.receive(data, stream=self.stream)
        return out

    def _judge(self, out: bytes, records: list[TickRecord]) -> None:
        """Check the rules that apply in every cell."""
        outcome = self.pilot.mission.outcome
        for frame in filter(is_setpoint, frames(out)):
            if (rule := broken_rule(frame, self.allowed)) is not None:
                self._breaks(rule)
            if outcome is not None and not is_safe(frame):
                self._breaks(f"steered after the end: {outcome.reason}")
            if self.pilot.session.reply_to == STRANGER and not self.forgeable:
                self._breaks("setpoint sent to another sender's address")
            self._judge_time()
        for record in records:
            self._judge_record(record)

    def _judge_record(self, record: TickRecord) -> None:
        if record.drift_x is not None and record.drift_y is not None:
            self._drift = hypot(record.drift_x, record.drift_y)
        if record.yaw_rate_sent is not None:
            engaged = record.phase is Phase.ENGAGED
            (self._judge_age if engaged else self._judge_holding)(record)

    def _breaks(self, rule: str) -> None:
        self.broken.append(f"{self.now:.2f} s: {rule}")

    def _judge_time(self) -> None:
        pilot = self.pilot
        session = self.pilot.session
        before = pilot.mission.phase is Phase.READY and session.adapter.wants_setpoints_in(
            session.vehicle.mode
        )
        if not session.vehicle.in_our_mode and not before:
            mode = session.vehicle.mode_name
            self._breaks(f"setpoint while {mode}, {pilot.mission.phase.value}")
        if self.witness.taken or self.witness.unproved:
            seen = (
                "the operator's mode was seen"
                if self.witness.taken
                else "standing still, no heartbeat since"
            )
            self._breaks(f"setpoint after {seen}")
        if pilot.mission.phase in STEERING:
            self.steered_at.append(self.now)
        elif not before and self.safe_at is None:
            self.safe_at = self.now

    def _judge_age(self, record: TickRecord) -> None:
        age = record.range_age
        if age is None or self.spy.newest is None or not isfinite(age):
            self._breaks("steered without a range")
            return
        self.worst_told_age = max(self.worst_told_age, age)
        self.worst_age = max(self.worst_age, self.now - self.spy.newest.stamp)

    def _judge_holding(self, record: TickRecord) -> None:
        """Check the turn rate while ranges are missing. Without an estimated drift it must be
        V/r_d. With a drift it must be a turn rate that occurs on the circle in this drift, within
        0.1 V/r_d for the airspeed error. V is then the configured or the actual speed, because
        PX4's copter loses 8 % of its speed in the turn."""
        V = self.allowed.speed
        drift = 0.0
        slack = 1e-6
        slow = fast = V
        if self._drift is not None:
            drift = self._drift
            slack = 0.1 * V / self.radius
            slow, fast = sorted((V, max(self.vehicle.truth.ground_speed, 0.5 * V)))
        least, most = (
            (slow - drift) ** 2 / (slow * self.radius),
            (fast + drift) ** 2 / (fast * self.radius),
        )
        asked = self.pilot.settings.orbit.direction.turn_sign * (
            nan if record.demanded is None else record.demanded
        )
        if (
            not min(least, self.allowed.yaw_rate) - slack
            <= asked
            <= min(most, self.allowed.yaw_rate) + slack
        ):
            self._breaks(
                f"{record.phase.value} steers {asked}, not {least:.6f} .. {most:.6f} rad/s"
            )

    def _look(self) -> None:
        if self.now >= self._next_truth:
            self.truths.append(self.vehicle.truth)
            self._next_truth = self.now + TRUTH_EVERY

    @property
    def timed_out(self) -> bool:
        """True if PX4 left the guided mode because it received no setpoint within its timeout. This
        ends the mission like a takeover."""
        patience = PX4_PATIENCE.get(self.profile)
        left = next(
            (truth.time for truth in self.truths if truth.mode != GUIDED[self.profile]), None
        )
        if patience is None or left is None:
            return False
        received = [time for time, _ in self.vehicle.setpoint_log if left - 5 < time < left]
        return max(b - a for a, b in pairwise([left - 5, *received, left])) > patience - TRUTH_EVERY

    def errors(self, since: float, until: float) -> list[tuple[float, float]]:
        """Return pairs of time (s) and radius error (share of the radius) between two times."""
        return [
            (truth.time, true_radius(truth) / self.radius - 1)
            for truth in self.truths
            if since <= truth.time <= until
        ]

    def goes_round_as_wanted(self, seconds: float) -> bool:
        """Return True if the track of the last seconds circles the target in the direction of the
        mission."""
        turns = clockwise_turns(
            [truth for truth in self.truths if truth.time >= self.now - seconds]
        )
        return (
            turns > 0 if self.pilot.settings.orbit.direction is Direction.CLOCKWISE else turns < 0
        )


@cache
def settled(
    profile: str,
    overrides: tuple[str, ...] = (),
    *,
    stream: bool = False,
    keys: Keys = (None, None),
    seconds: float = SETTLED,
) -> Course:
    """Return a flight that has kept its circle over a good link for some time. Copy it before
    use."""
    course = Course(profile, overrides, stream=stream, keys=keys).fly(seconds)
    while max(abs(error) for _, error in course.errors(course.now - STEADY, course.now)) > BAND / 2:
        course.fly(course.now + STEADY)
        assert course.now < LATEST, f"{profile}: no steady circle"
    assert course.pilot.mission.phase is Phase.ENGAGED, course.pilot.mission.outcome
    course.forget()
    return course


def on_the_circle(
    profile: str,
    overrides: tuple[str, ...] = (),
    *,
    stream: bool = False,
    keys: Keys = (None, None),
    seconds: float = SETTLED,
) -> Course:
    """Return a copy of the flight that has settled on its circle in at least these seconds."""
    return copy.deepcopy(settled(profile, overrides, stream=stream, keys=keys, seconds=seconds))


def _vehicle(table: Mapping[str, Any], profile: str, key: bytes | None) -> Vehicle:
    if key is None:
        return Vehicle(parse_vehicle(table, profile))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "vehicle.key"
        path.write_bytes(key)
        return Vehicle(parse_vehicle({**table, "signing": {"key_file": str(path)}}, profile))
