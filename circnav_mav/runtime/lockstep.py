"""Simulated time: a vehicle in this process and the pilot alternate and exchange MAVLink bytes.
Time advances only when both are done, so a flight is bit-identical on any computer. A finite speed
only adds waits."""

from collections import Counter
from collections.abc import Hashable
from math import ceil, inf, isfinite
from typing import Protocol

from circnav_mav.pilot import RANGING, VEHICLE
from circnav_mav.runtime.clock import Clock, steady
from circnav_mav.runtime.links import Link

MAIN = "main"
RADIO = "ranging"
"""Link names of the emulated vehicle."""
SOURCE = "sim"
ON_TIME = 1e-3
"""Run time, s, by which a wait may end early and still count as complete."""


class Vehicle(Protocol):
    """Interface of the emulator."""

    @property
    def next_event(self) -> float:
        """Simulated time of its next event, s."""

    def advance(self, until: float) -> None:
        """Simulate up to this time, s."""

    def receive(self, data: bytes, link: str) -> None:
        """Process data that was sent to one of its links."""

    def outgoing(self, link: str) -> list[bytes]:
        """Return the frames sent on a link since the last call."""


class Lockstep(Clock):
    """Clock of simulated time. Advancing it advances the vehicle."""

    longest_wait = inf

    def __init__(self, vehicle: Vehicle, speed: float = inf, *, others: bool = False) -> None:
        """speed: simulated seconds per real second, infinite for as fast as possible. others: True
        if there are real links too, such as a radio. Then simulated time follows real time, also
        across a pause."""
        super().__init__(speed)
        self._vehicle = vehicle
        self._others = others
        self._now = 0.0

    def links(self, *, ranging_apart: bool) -> dict[str, Link]:
        """Return the vehicle's links by the pilot's names. ranging_apart: include the separate
        ranging link."""
        names = {VEHICLE: MAIN} | ({RANGING: RADIO} if ranging_apart else {})
        return {ours: VehicleLink(self._vehicle, theirs) for ours, theirs in names.items()}

    def now(self) -> float:
        """Return the simulated seconds since the start of the run."""
        return self._now

    real = now
    """Execution time, in simulated seconds: a step of a simulated flight takes no time."""

    def until(self, moment: float) -> float:
        """Return the real seconds until the next event, or until `moment` if earlier; 0 if the
        speed is infinite."""
        return (
            max((self.next_event(moment) - self._paced()) / self.speed, 0.0)
            if isfinite(self.speed)
            else 0.0
        )

    def advance(self, moment: float) -> None:
        """Advance to the next event, or to `moment` if earlier. With real links, advance to the
        paced time instead.

        At a finite speed, do not pass the paced time: a signal may have ended the wait early.
        """
        due = self.next_event(moment)
        if self._others:
            due = max(self._paced(), self._now)
        elif isfinite(self.speed):
            early = due - self._paced()
            if early > ON_TIME:
                due = max(due - early, self._now)
            # Longest delay that a paced run makes up for, in real time, s. The rest of a longer
            # delay is skipped.
            self._start += max(-early / self.speed - 0.5, 0.0)
        micros = ceil(due * 1e6)
        micros += (
            micros / 1e6 < due
        )  # rounded down, the time would stay before the due tick forever
        self._now = micros / 1e6
        self._vehicle.advance(self._now)

    def next_event(self, moment: float) -> float:
        """Return the time of the next event, or `moment` if earlier, s."""
        return max(min(self._vehicle.next_event, moment), self._now)

    def _paced(self) -> float:
        """Return the simulated time that corresponds to the real time."""
        return (steady() - self._start) * self.speed


class VehicleLink:
    """Pilot's end of a link of the vehicle."""

    def __init__(self, vehicle: Vehicle, name: str) -> None:
        self.troubles: Counter[str] = Counter()
        self._vehicle = vehicle
        self._name = name

    def fileno(self) -> None:
        """Return None: no descriptor to wait for."""

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """Return the whole frames that the vehicle has sent, one per datagram."""
        return [(frame, SOURCE) for frame in self._vehicle.outgoing(self._name)]

    def send(self, data: bytes, to: Hashable) -> None:
        self._vehicle.receive(data, self._name)

    def close(self) -> None:
        """Do nothing: no resource is open."""
