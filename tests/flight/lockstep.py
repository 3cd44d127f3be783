"""Flies a pilot against the bundled vehicle in lockstep: real MAVLink bytes, one manual clock, no sockets."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import RANGING, VEHICLE, Pilot, TickRecord
from sim.config import parse_vehicle
from sim.faults.pipe import Pipe
from sim.vehicle import Truth, Vehicle

CONFIG = Path(__file__).parents[2] / "config"
LINKS = {"main": VEHICLE, "ranging": RANGING}
SETPOINT_IDS = {84, 82}  # SET_POSITION_TARGET_LOCAL_NED, SET_ATTITUDE_TARGET


@dataclass
class Flight:
    """A flight under way, with what was seen of it. down, up: what the link does to what we hear and say; None:
    nothing, at once."""

    pilot: Pilot
    vehicle: Vehicle
    truths: list[Truth] = field(default_factory=list)
    ticks: list[TickRecord] = field(default_factory=list)
    sent: list[tuple[float, bytes]] = field(default_factory=list)
    hears: Callable[[bytes, float], bool] = lambda frame, now: True
    down: Pipe | None = None
    up: Pipe | None = None
    now: float = 0.0
    next_truth: float = 0.0

    def fly(self, until: float, watch: Callable[["Flight"], None] | None = None) -> "Flight":
        """Run both to a time, stepping from event to event; `watch` is called after each step."""
        while self.now < until and not self.pilot.done:
            arrivals = [pipe.next_due for pipe in (self.down, self.up) if pipe is not None]
            self._step(min(self.vehicle.next_event, max(self.pilot.next_tick, self.now), until, *arrivals))
            if watch is not None:
                watch(self)
        return self

    def _step(self, due: float) -> None:
        pilot, vehicle = self.pilot, self.vehicle
        self.now = max(due, self.now)
        vehicle.advance(self.now)
        links = LINKS if pilot.settings.ranging_apart else {"main": VEHICLE}
        for sim_link, link in links.items():
            for frame in through(self.down, vehicle.outgoing(sim_link), self.now):
                if self.hears(frame, self.now):
                    pilot.receive(frame, self.now, "sim", link)
        out = pilot.step(self.now)
        for data in through(self.up, [out] if out else [], self.now):
            vehicle.receive(data)
        if out:
            self.sent.append((self.now, out))
        self.ticks += pilot.take_records()
        pilot.take_frames()
        if self.now >= self.next_truth:
            self.truths.append(vehicle.truth)
            self.next_truth = self.now + 0.1

    @property
    def setpoint_times(self) -> list[float]:
        """When setpoints were sent."""
        return [time for time, data in self.sent if any(id in SETPOINT_IDS for id in message_ids(data))]


def through(pipe: Pipe | None, data: list[bytes], now: float) -> list[bytes]:
    """What comes out of a pipe by now, after some more has gone in."""
    if pipe is None:
        return data
    for datagram in data:
        pipe.push(datagram, now)
    return pipe.take(now)


def flight(mission: str, *overrides: str, law: str | None = None) -> Flight:
    """A flight of a file in config/, ready to go. Where a mission says "auto" and no law is named, it flies `smooth`:
    what is tested then does not depend on the law, and costs a fifth of the time."""
    loaded = load_mission(CONFIG / f"{mission}.toml", overrides)
    if law is not None or loaded.file.guidance.law == "auto":
        loaded = load_mission(CONFIG / f"{mission}.toml", (*overrides, f'guidance.law="{law or "smooth"}"'))
    assert loaded.file.sim is not None
    return Flight(Pilot(loaded.pilot_settings()), Vehicle(parse_vehicle(loaded.file.sim, mission)))


def message_ids(data: bytes) -> list[int]:
    """Ids of the MAVLink 2 frames in some output."""
    ids, at = [], 0
    while at < len(data):
        ids.append(int.from_bytes(data[at + 7 : at + 10], "little"))
        at += data[at + 1] + 12
    return ids


def true_radius(truth: Truth) -> float:
    """Horizontal distance to the target, m."""
    return math.hypot(truth.north - truth.target_north, truth.east - truth.target_east)


def last_third(flown: Flight) -> list[Truth]:
    """The truth over the last third of the flight."""
    return [truth for truth in flown.truths if truth.time >= flown.now * 2 / 3]


def mean_radius(truths: list[Truth]) -> float:
    """Mean horizontal distance to the target, m."""
    return sum(map(true_radius, truths)) / len(truths)


def rms_error(truths: list[Truth], desired: float) -> float:
    """Root mean square of the radius error, m."""
    return math.sqrt(sum((true_radius(truth) - desired) ** 2 for truth in truths) / len(truths))


def clockwise_turns(truths: list[Truth]) -> float:
    """Turns flown round the target, clockwise seen from above positive: north to east, from the track alone."""
    swept = 0.0
    for a, b in itertools.pairwise(truths):
        an, ae = a.north - a.target_north, a.east - a.target_east
        bn, be = b.north - b.target_north, b.east - b.target_east
        swept += math.atan2(an * be - ae * bn, an * bn + ae * be)
    return swept / (2 * math.pi)
