"""Simulated time: a vehicle in this process and the pilot, one step at a time, with MAVLink bytes between them. It goes
on only when both have answered: a flight is the same to the last digit on any computer. A pace only waits."""

from collections import Counter
from collections.abc import Hashable
from math import ceil, inf, isfinite
from typing import Protocol

from circnav_mav.pilot import RANGING, VEHICLE
from circnav_mav.runtime.clock import Clock, steady
from circnav_mav.runtime.links import Link

MAIN, RADIO = "main", "ranging"
"""The vehicle's own names of its links."""
SOURCE = "sim"
ON_TIME = 1e-3
"""Time of the run, s, by which a wait may end early and still count as waited to its end."""
MOST_LATE = 0.5
"""Real time, s, that a paced run catches up after it was held up. The rest is left out, as after a night's sleep."""


class Vehicle(Protocol):
    """What the emulator offers."""

    @property
    def next_event(self) -> float:
        """Simulated time at which it does something next, s."""

    def advance(self, until: float) -> None:
        """Fly to a simulated time, s."""

    def receive(self, data: bytes, link: str) -> None:
        """Take in what was sent to it on one of its links."""

    def outgoing(self, link: str) -> list[bytes]:
        """The frames that it has sent on a link since the last call."""


class Lockstep(Clock):
    """The clock of such a flight; it carries the vehicle along."""

    longest_wait = inf

    def __init__(self, vehicle: Vehicle, speed: float = inf, *, others: bool = False) -> None:
        """speed: simulated seconds per real second; infinite: as fast as the computer allows. others: whether something
        else is heard too, such as a real radio: then time keeps up with it, and skips over what a pause held up."""
        super().__init__(speed)
        self._vehicle, self._others = vehicle, others
        self._now = 0.0

    def links(self, *, ranging_apart: bool) -> dict[str, Link]:
        """The vehicle's links as the pilot has them."""
        names = {VEHICLE: MAIN} | ({RANGING: RADIO} if ranging_apart else {})
        return {ours: VehicleLink(self._vehicle, theirs) for ours, theirs in names.items()}

    def now(self) -> float:
        """Simulated seconds since the start of the run."""
        return self._now

    real = now
    """Simulated seconds, too: no step of a simulated flight takes any time."""

    def until(self, moment: float) -> float:
        """Real seconds to wait for the next thing that happens, at a moment at the latest; 0 without a pace."""
        return max((self.next_event(moment) - self._paced()) / self.speed, 0.0) if isfinite(self.speed) else 0.0

    def advance(self, moment: float) -> None:
        """On to the next thing that happens, at a moment at the latest; less far if the pace has not come there yet,
        as when a signal cut the wait short."""
        due = self.next_event(moment)
        if self._others:
            due = max(self._paced(), self._now)
        elif isfinite(self.speed):
            early = due - self._paced()
            if early > ON_TIME:
                due = max(due - early, self._now)
            self._start += max(-early / self.speed - MOST_LATE, 0.0)
        micros = ceil(due * 1e6)
        micros += micros / 1e6 < due  # a product rounded down would be a time before the tick that is due, for ever
        self._now = micros / 1e6
        self._vehicle.advance(self._now)

    def next_event(self, moment: float) -> float:
        """Return the time of the next thing that happens, s, a moment at the latest."""
        return max(min(self._vehicle.next_event, moment), self._now)

    def _paced(self) -> float:
        """Simulated time that the pace has come to."""
        return (steady() - self._start) * self.speed


class VehicleLink:
    """One of the vehicle's links, from our side."""

    def __init__(self, vehicle: Vehicle, name: str) -> None:
        self.troubles: Counter[str] = Counter()
        self._vehicle, self._name = vehicle, name

    def fileno(self) -> None:
        """There is nothing to wait on."""

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """Whole frames that the vehicle has sent, each a datagram."""
        return [(frame, SOURCE) for frame in self._vehicle.outgoing(self._name)]

    def send(self, data: bytes, to: Hashable) -> None:
        self._vehicle.receive(data, self._name)

    def close(self) -> None:
        """Nothing is open."""
