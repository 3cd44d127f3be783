"""A vehicle in real time on a UDP port of this process, for an application in a process of its own."""

import select
import socket
from collections.abc import Iterator
from pathlib import Path

from sim.config import load_vehicle
from sim.vehicle import Vehicle

ROOT = Path(__file__).parents[2]
SETPOINT = 84
LONGEST_WAIT = 0.05


class VehicleOnPort:
    """The vehicle of a mission, and the application that it is flown by: whoever spoke last. Time is the caller's."""

    def __init__(self, mission: Path) -> None:
        self.vehicle = Vehicle(load_vehicle(mission))
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self._peer: tuple[str, int] | None = None
        self.port: int = self._socket.getsockname()[1]

    @property
    def heard(self) -> bool:
        """Whether the application has spoken."""
        return self._peer is not None

    def fly(self, now: float) -> Iterator[bytes]:
        """Carry the vehicle on to a time of its own, s; the frames that it sends, each when it has left."""
        self.vehicle.advance(now)
        for frame in self.vehicle.outgoing():
            if self._peer is not None:
                self._socket.sendto(frame, self._peer)
                yield frame

    def listen(self, now: float, at_most: float = LONGEST_WAIT) -> bytes | None:
        """Wait for the application, no longer than the vehicle has nothing to do, nor than s; what came of it."""
        wait = min(self.vehicle.next_event - now, at_most, LONGEST_WAIT)
        if not select.select([self._socket], [], [], max(wait, 0.0))[0]:
            return None
        data, self._peer = self._socket.recvfrom(65535)
        return data

    def close(self) -> None:
        self._socket.close()
