"""Fly a pilot against the bundled vehicle in the product's own lockstep, with faults between
them."""

import copyreg
import itertools
import math
import statistics
import struct
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from pathlib import Path

from circnav_sim.config import parse_vehicle
from circnav_sim.vehicle import Truth, Vehicle

from circnav_mav.mav.signing import Signing
from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import VEHICLE, Outcome, OutputMode, Pilot, TickRecord
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runtime.links import Link
from circnav_mav.runtime.lockstep import Lockstep
from circnav_mav.runtime.runner import run_step
from tests.rig import decode, flown_for_long
from tests.tools.fault_link.frames import frames, message_id
from tests.tools.fault_link.pipe import Pipe

# makes deepcopy of a flight possible
copyreg.pickle(struct.Struct, lambda unpacker: (struct.Struct, (unpacker.format,)))

CONFIG = Path(__file__).parents[2] / "config"
UNIX = 1_790_000_000.0
"""Unix time at the start of a flight, s."""
SETPOINT_IDS = {84, 82, 69}  # SET_POSITION_TARGET_LOCAL_NED, SET_ATTITUDE_TARGET, MANUAL_CONTROL


@dataclass
class Flight:
    """A running flight in the product's lockstep, with its records. down, up: link impairment of
    received and sent frames; None: no delay and no loss. signing: signing state of the pilot.
    vehicle_clock: error of the vehicle's wall clock, s; None: the vehicle has no clock."""

    pilot: Pilot
    vehicle: Vehicle
    truths: list[Truth] = field(default_factory=list)
    ticks: list[TickRecord] = field(default_factory=list)
    sent: list[tuple[float, bytes]] = field(default_factory=list)
    others: list[tuple[bytes, Hashable]] = field(default_factory=list)
    """Frames from another sender, with its address, received on the vehicle's link in every
    step."""
    hears: Callable[[bytes, float], bool] = lambda frame, now: True
    down: Pipe | None = None
    up: Pipe | None = None
    signing: Signing | None = None
    vehicle_clock: float | None = None
    now: float = 0.0
    next_truth: float = 0.0

    def __post_init__(self) -> None:
        self.clock = Lockstep(self.vehicle)
        links = self.clock.links(ranging_apart=self.pilot.settings.ranging_apart)
        self.links = {name: Wire(self, link, name) for name, link in links.items()}

    def fly(self, until: float, watch: Callable[["Flight"], None] | None = None) -> "Flight":
        """Run pilot and vehicle to a time, stepping from event to event. `watch` is called after
        each step."""
        while self.now < until and not self.pilot.done:
            arrivals = [pipe.next_due for pipe in (self.down, self.up) if pipe is not None]
            self._step(min(self.pilot.scheduler.due, until, *arrivals))
            if watch is not None:
                watch(self)
        return self

    @property
    def outcome(self) -> Outcome:
        """Outcome of the mission, which must have ended."""
        assert self.pilot.mission.outcome is not None
        return self.pilot.mission.outcome

    @property
    def setpoint_times(self) -> list[float]:
        """Times at which setpoints were sent."""
        return [
            time for time, data in self.sent if any(id in SETPOINT_IDS for id in message_ids(data))
        ]

    @property
    def texts(self) -> list[str]:
        """STATUSTEXTs that were sent."""
        sent = [message for _, data in self.sent for message in decode(data)]
        return [message.text for message in sent if message.get_type() == "STATUSTEXT"]

    def _step(self, moment: float) -> None:
        due = UNIX + max(min(self.vehicle.next_event, moment), self.now)
        if self.signing is not None:
            self.signing.advance(due)
        if self.vehicle_clock is not None:
            self.vehicle.set_time(due + self.vehicle_clock)
        self.clock.advance(moment)
        self.now = self.clock.now()
        before = len(self.sent)
        self._keep(run_step(self.pilot, self.links, self.clock, self.now, self._signal()))
        for data in through(self.up, [data for _, data in self.sent[before:]], self.now):
            self.vehicle.receive(data)
        if self.now >= self.next_truth:
            self.truths.append(self.vehicle.truth)
            self.next_truth = self.now + 0.1

    def _signal(self) -> str | None:
        """Return the signal received in this step, or None."""
        return None

    def _keep(self, step: LoopStep) -> None:
        self.ticks += self.pilot.take_records()


@dataclass
class Wire:
    """A link of the vehicle with the flight's faults. Sent frames are delivered after the step."""

    flight: Flight
    link: Link
    name: str

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        frames = through(self.flight.down, [frame for frame, _ in self.link.receive(now)], now)
        received: list[tuple[bytes, Hashable]] = [
            (frame, "sim") for frame in frames if self.flight.hears(frame, now)
        ]
        return received + (self.flight.others if self.name == VEHICLE else [])

    def send(self, data: bytes, to: Hashable) -> None:
        if self.name == VEHICLE:
            self.flight.sent.append((self.flight.now, data))


def through(pipe: Pipe | None, data: list[bytes], now: float) -> list[bytes]:
    """Push datagrams into a pipe and return the datagrams due by now."""
    if pipe is None:
        return data
    for datagram in data:
        pipe.push(datagram, now)
    return pipe.take(now)


def flight(
    mission: str, *overrides: str, law: str | None = None, output: OutputMode = OutputMode.FLY
) -> Flight:
    """Return a flight of a file in config/, ready to start. If the mission's law is "auto" and
    `law` is None, the flight uses the law `smooth`, because such a test does not depend on the
    law."""
    # The emulator need not send its true state: the pilot ignores it, and tests read the vehicle.
    overrides = ("sim.truth.rate_hz=0", *overrides)
    loaded = load_mission(CONFIG / f"{mission}.toml", overrides)
    if law is not None or loaded.file.guidance.law == "auto":
        loaded = load_mission(
            CONFIG / f"{mission}.toml", (*overrides, f'guidance.law="{law or "smooth"}"')
        )
    assert loaded.file.sim is not None
    pilot = Pilot(loaded, output_mode=output)
    # The vehicle has flown for long before the test begins, unless it starts on the ground.
    if loaded.file.sim["start"].get("armed", True):
        flown_for_long(pilot)
    return Flight(pilot, Vehicle(parse_vehicle(loaded.file.sim, mission)))


def tangent(distance: float) -> tuple[str, ...]:
    """Return overrides with a start at a distance (m) from the target, at a right angle to it, in
    the clockwise direction."""
    return f"sim.start.north_m={distance}", "sim.start.east_m=0.0", "sim.start.heading_deg=90.0"


def message_ids(data: bytes) -> list[int]:
    """Return the ids of the MAVLink 2 frames in some output."""
    return list(map(message_id, frames(data)))


def true_radius(truth: Truth) -> float:
    """Return the horizontal distance to the target, m."""
    return math.hypot(truth.north - truth.target_north, truth.east - truth.target_east)


def last_third(flown: Flight) -> list[Truth]:
    """Return the truth over the last third of the flight."""
    return [truth for truth in flown.truths if truth.time >= flown.now * 2 / 3]


def mean_radius(truths: list[Truth]) -> float:
    """Return the mean horizontal distance to the target, m."""
    return sum(map(true_radius, truths)) / len(truths)


def rms_error(truths: list[Truth], desired: float) -> float:
    """Return the root mean square of the radius error, m."""
    return math.sqrt(sum((true_radius(truth) - desired) ** 2 for truth in truths) / len(truths))


def unrest(flown: Flight) -> float:
    """Return the standard deviation of the commanded turn rate over the last third, deg/s."""
    turns = [
        tick.turn_rate
        for tick in flown.ticks
        if tick.time > flown.now * 2 / 3 and tick.turn_rate is not None
    ]
    return math.degrees(statistics.pstdev(turns))


def clockwise_turns(truths: list[Truth]) -> float:
    """Return the number of laps round the target, positive clockwise as seen from above, from the
    track only."""
    swept = 0.0
    for a, b in itertools.pairwise(truths):
        an = a.north - a.target_north
        ae = a.east - a.target_east
        bn = b.north - b.target_north
        be = b.east - b.target_east
        swept += math.atan2(an * be - ae * bn, an * bn + ae * be)
    return swept / (2 * math.pi)
