"""Complete fleet in one process, in lockstep. Every member has its own pilot, bundled vehicle and
clock.

The members run in the order of simulated time, so the result is identical on every computer.
"""

import heapq
from cmath import rect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from math import cos, radians, sin
from pathlib import Path
from random import Random

import numpy as np
from circnav_sim.config import parse_vehicle
from circnav_sim.vehicle import Truth, Vehicle

from circnav_mav.extras.fleet.link import FleetLink, LocalNetwork
from circnav_mav.extras.fleet.listener import FleetListener
from circnav_mav.extras.fleet.report import State
from circnav_mav.extras.fleet.settings import table_of
from circnav_mav.mission.load import load_mission
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import Pilot
from circnav_mav.runtime.listeners import Listeners
from circnav_mav.runtime.lockstep import Lockstep
from circnav_mav.runtime.recorder import Recorder
from circnav_mav.runtime.runner import Loop
from circnav_mav.runtime.status import AlarmLog

START_APART_DEG = 12.0
"""Angle between the starts of successive members, seen from the target, deg. It is small because
the fleet starts from one airfield."""
SAMPLE_EVERY = 0.2
"""Time between two samples of the true tracks, s."""


def member_overrides(
    path: str | Path,
    member: int,
    overrides: Sequence[str],
    size: int,
    compass: float = 0.0,
) -> list[str]:
    """Return the overrides of a member's mission: the overrides of the whole fleet, then id, height
    layer, seed and start. compass: standard deviation of the members' compass errors, deg."""
    mission = load_mission(path, overrides)
    file = mission.file
    sim = mission.file.sim or {}
    layer = table_of(mission).layer_m * (member - 1) if file.vehicle.kind != "rover" else 0.0
    seed = sim.get("seed", 0)
    start = sim.get("start", {})
    target = sim.get("target", {})
    turn = START_APART_DEG * (member - 1)
    # Horizontal positions as complex numbers: north + i east.
    center = complex(target.get("north_m", 0.0), target.get("east_m", 0.0))
    place = complex(start.get("north_m", -200.0), start.get("east_m", 0.0))
    place = center + (place - center) * rect(1.0, radians(turn))
    altitude = start.get("altitude_m")
    found = [
        f'name="{file.name}-{member}"',
        f"fleet.id={member}",
        f"fleet.size={max(size, 2)}",
        f"sim.seed={seed * 1000 + member}",
        f"sim.start.north_m={place.real:.3f}",
        f"sim.start.east_m={place.imag:.3f}",
        f"sim.start.heading_deg={start.get('heading_deg', 0.0) + turn:.1f}",
    ]
    if compass:
        error = Random(f"{seed}:compass:{member}").gauss(0.0, compass)
        found.append(f"sim.sensors.heading_bias_deg={error:.2f}")
    if altitude is not None:
        found.append(f"sim.start.altitude_m={altitude + layer:.1f}")
    if file.orbit.height_above_target_m is not None:
        found.append(f"orbit.height_above_target_m={file.orbit.height_above_target_m + layer:.1f}")
    return [*overrides, *found]


@dataclass
class Tracks:
    """True tracks.

    time: s.
    east, north, height: position of every member relative to the target, m.
    state: state of every member.
    flying: True for each member that circnav steers.
    drift: true drift, east and north, m/s.
    radius, sense, speed: circle of the mission, m and m/s.
    """

    radius: float
    speed: float
    sense: int
    time: list[float] = field(default_factory=list)
    east: list[list[float]] = field(default_factory=list)
    north: list[list[float]] = field(default_factory=list)
    height: list[list[float]] = field(default_factory=list)
    state: list[list[State]] = field(default_factory=list)
    flying: list[list[bool]] = field(default_factory=list)
    drift: list[tuple[float, float]] = field(default_factory=list)


class Member:
    """One member in flight."""

    def __init__(
        self,
        mission: Mission,
        link: FleetLink,
        recorder: Recorder,
        listeners: Listeners,
        pilot: Pilot,
    ) -> None:
        assert mission.file.sim is not None
        self.mission = mission
        self.pilot = pilot
        self.listeners = listeners
        self.link = link
        self.recorder = recorder
        self.alarms: AlarmLog | None = None
        self.vehicle = Vehicle(parse_vehicle(mission.file.sim, "sim"))
        self.clock = Lockstep(self.vehicle)
        links = self.clock.links(ranging_apart=pilot.settings.ranging_apart)
        self.fleet = next(one for one in listeners.attached if isinstance(one, FleetListener))
        self.loop = Loop(pilot, links, self.clock, recorder, listeners)

    @property
    def next_event(self) -> float:
        """Time of the next step, s."""
        return self.clock.next_event(self.loop.due)

    def place(self, time: float) -> tuple[Truth, float, float]:
        """Return the truth, and the position relative to the target (east, north, m) extrapolated
        to a time."""
        truth = self.vehicle.truth
        ahead = time - truth.time
        east = truth.east - truth.target_east + ahead * truth.ground_speed * sin(truth.course)
        north = truth.north - truth.target_north + ahead * truth.ground_speed * cos(truth.course)
        return truth, east, north


class FleetFlight:
    """Fleet in flight."""

    def __init__(self, members: Iterable[Member], network: LocalNetwork) -> None:
        self.members = list(members)
        self.network = network
        orbit = self.members[0].mission.orbit
        self.tracks = Tracks(orbit.radius, orbit.speed, orbit.direction.turn_sign)
        self.now = 0.0

    def fly(
        self,
        until: float = float("inf"),
        watch: Callable[["FleetFlight"], None] = lambda flight: None,
        stopped: Callable[[], str | None] = lambda: None,
    ) -> "FleetFlight":
        """Fly until a time (s) or until all members have ended. watch: called after each sample.
        stopped: returns the name of a signal that ends the flight, or None."""
        queue = [
            (member.next_event, i) for i, member in enumerate(self.members) if not member.loop.over
        ]
        heapq.heapify(queue)
        while queue and queue[0][0] <= until:
            due, i = heapq.heappop(queue)
            while self.tracks_due <= due:
                self._sample(self.tracks_due)
                watch(self)
            self.now = due
            member = self.members[i]
            member.loop.step(stopped())
            if not member.loop.over:
                heapq.heappush(queue, (member.next_event, i))
        return self

    @property
    def tracks_due(self) -> float:
        """Time of the next sample, s."""
        return len(self.tracks.time) * SAMPLE_EVERY

    def _sample(self, time: float) -> None:
        tracks = self.tracks
        places = [member.place(time) for member in self.members]
        truth = places[0][0]
        tracks.time.append(time)
        tracks.east.append([east for _, east, _ in places])
        tracks.north.append([north for _, _, north in places])
        tracks.height.append([truth.target_down - truth.down for truth, _, _ in places])
        tracks.state.append([member.fleet.state for member in self.members])
        tracks.flying.append([member.pilot.mission.steering for member in self.members])
        self._measure_ranges()
        target = self.members[0].vehicle.config.target
        tracks.drift.append(
            (
                truth.wind_east - target.velocity_east_mps,
                truth.wind_north - target.velocity_north_mps,
            )
        )

    def _measure_ranges(self) -> None:
        """Let the radio of every member measure the distances to the other members, if the mission
        uses them."""
        first = table_of(self.members[0].mission).ranging
        if first is None:
            return
        tracks = self.tracks
        places = np.column_stack([tracks.east[-1], tracks.north[-1], tracks.height[-1]])
        for one, member in zip(places, self.members, strict=True):
            for other, node in zip(places, self.members, strict=True):
                if node is not member:
                    ident = node.fleet.spacing.settings.member
                    member.vehicle.range_node(first + ident, float(np.linalg.norm(one - other)))
