"""Flies a pilot against the bundled vehicle in lockstep: real MAVLink bytes, one manual clock, no sockets, no waiting."""

from collections.abc import Callable
from dataclasses import dataclass, field

from circnav_mav.pilot import RANGING, VEHICLE, Pilot, TickRecord
from sim.vehicle import Truth, Vehicle

LINKS = {"main": VEHICLE, "ranging": RANGING}


@dataclass
class Flight:
    """What was seen of a flight."""

    pilot: Pilot
    vehicle: Vehicle
    truths: list[Truth] = field(default_factory=list)
    ticks: list[TickRecord] = field(default_factory=list)
    sent: list[tuple[float, bytes]] = field(default_factory=list)
    now: float = 0.0

    def fly(self, until: float, watch: Callable[["Flight"], None] | None = None, links: tuple[str, ...] = ("main",)) -> None:
        """Run both to a time, stepping from event to event; `watch` is called after each step."""
        pilot, vehicle = self.pilot, self.vehicle
        truth_at = self.now
        while self.now < until and not pilot.done:
            due = min(vehicle.next_event, max(pilot.next_tick, self.now), until)
            self.now = max(due, self.now)
            vehicle.advance(self.now)
            for link in links:
                for frame in vehicle.outgoing(link):
                    pilot.receive(frame, self.now, "sim", LINKS[link])
            out = pilot.step(self.now)
            if out:
                vehicle.receive(out)
                self.sent.append((self.now, out))
            if "ranging" in links and (hello := pilot.hello(self.now)):
                vehicle.receive(hello, "ranging")
            self.ticks += pilot.take_records()
            pilot.take_frames()
            if self.now >= truth_at:
                self.truths.append(vehicle.truth)
                truth_at += 0.1
            if watch is not None:
                watch(self)
