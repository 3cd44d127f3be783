"""Simulated time: an emulated vehicle in this process and `Pilot` alternate and exchange MAVLink
bytes. Simulated time advances only when both have processed their data, so a flight is
bit-identical on any computer. A finite simulation speed only adds waits."""

from collections import Counter
from collections.abc import Hashable
from math import ceil, inf, isfinite
from typing import Protocol

from circnav_mav.pilot import RANGING, VEHICLE
from circnav_mav.runtime.clock import Clock, steady
from circnav_mav.runtime.links import Link

MAIN = "main"
"""Name of the emulated autopilot's link."""
RADIO = "ranging"
"""Name of the emulated radio's separate link."""
SOURCE = "sim"
ON_TIME = 1e-3
"""Simulated time, s, by which a wait may end early. A wait that ends earlier was interrupted by a
signal."""


class Vehicle(Protocol):
    """Interface of the emulated vehicle."""

    @property
    def next_event(self) -> float:
        """Simulated time of the next event of the vehicle, s."""

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
        if there are real links too, such as a radio. Then simulated time follows real time, even
        across a pause of this process."""
        super().__init__(speed)
        self._vehicle = vehicle
        self._others = others
        self.simulated = not others
        self._now = 0.0

    def links(self, *, ranging_apart: bool) -> dict[str, Link]:
        """Return the links of the vehicle, by the names that `Pilot` uses. ranging_apart: include
        the separate ranging link."""
        names = {VEHICLE: MAIN} | ({RANGING: RADIO} if ranging_apart else {})
        return {ours: VehicleLink(self._vehicle, theirs) for ours, theirs in names.items()}

    def now(self) -> float:
        """Return the simulated seconds since the start of the run."""
        return self._now

    real = now
    """Clock for measuring execution time. It returns simulated time, so a step of a simulated
    flight takes no time."""

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
        paced time instead (real time multiplied by the speed).

        At a finite speed, do not advance beyond the paced time: a signal may have ended the wait
        early.
        """
        due = self.next_event(moment)
        if self._others:
            due = max(self._paced(), self._now)
        elif isfinite(self.speed):
            early = due - self._paced()
            if early > ON_TIME:
                due = max(due - early, self._now)
            # 0.5: longest delay that the run catches up, s of real time. The rest of a longer delay
            # is skipped.
            self._start += max(-early / self.speed - 0.5, 0.0)
        micros = ceil(due * 1e6)
        micros += micros / 1e6 < due  # a time rounded down would stay before the due tick forever
        self._now = micros / 1e6
        self._vehicle.advance(self._now)

    def next_event(self, moment: float) -> float:
        """Return the time of the next event, or `moment` if earlier, s."""
        return max(min(self._vehicle.next_event, moment), self._now)

    def _paced(self) -> float:
        """Return the paced time: real time since the start, multiplied by the speed, s."""
        return (steady() - self._start) * self.speed


class VehicleLink:
    """End of a link to the emulated vehicle, on the side of `Pilot`."""

    def __init__(self, vehicle: Vehicle, name: str) -> None:
        self.troubles: Counter[str] = Counter()
        self._vehicle = vehicle
        self._name = name

    def fileno(self) -> None:
        """Return None: no descriptor to wait for."""

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """Return the complete frames that the vehicle has sent, one per datagram."""
        return [(frame, SOURCE) for frame in self._vehicle.outgoing(self._name)]

    def send(self, data: bytes, to: Hashable) -> None:
        self._vehicle.receive(data, self._name)

    def close(self) -> None:
        """Do nothing: no resource is open."""
