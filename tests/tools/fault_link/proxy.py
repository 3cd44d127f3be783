"""The fault link over UDP, between an application's port and the vehicle's port."""

import select
import sys
import time
from collections.abc import Callable

from circnav_sim.wires import EndpointError, Wire, open_wire, parse_endpoint

from .link import DOWN, UP, FaultLink

LONGEST_SLEEP = 0.05


class Proxy:
    """Two UDP ports with a fault link between them. Each port sends to its newest sender, or to its
    configured peer."""

    def __init__(self, listen: str, forward: str, link: FaultLink) -> None:
        """listen: endpoint on the application's side, udpin or udpout; forward: endpoint on the
        vehicle's side."""
        self._link = link
        self._wires: dict[str, Wire] = {}
        self._peers: dict[str, str] = {}
        for direction, endpoint in ((UP, parse_endpoint(listen)), (DOWN, parse_endpoint(forward))):
            try:
                if endpoint.kind == "tcpin":
                    raise EndpointError(
                        f"{endpoint}: the fault link supports UDP only: udpin:HOST:PORT or"
                        " udpout:HOST:PORT"
                    )
                self._wires[direction] = open_wire(endpoint, direction, sys.maxsize)
            except EndpointError:
                self.close()
                raise
            self._peers[direction] = direction

    def run(self, stopped: Callable[[], bool]) -> None:
        """Forward datagrams until `stopped()` returns True."""
        started = time.monotonic()
        while not stopped():
            now = time.monotonic() - started
            # datagrams received on the application's port are sent to the vehicle
            for direction, wire in self._wires.items():
                for self._peers[direction], data in wire.receive():
                    self._link.push(direction, data, now)
            for way, data in self._link.intrusions(now):
                self._send(way, data)
            for way in (UP, DOWN):
                for data in self._link.take(way, now):
                    self._send(way, data)
            wait = self._link.next_due - now
            sockets = [socket for wire in self._wires.values() for socket in wire.sockets()]
            select.select(sockets, [], [], max(0.0, min(wait, LONGEST_SLEEP)))

    def close(self) -> None:
        for wire in self._wires.values():
            wire.close()

    def _send(self, way: str, data: bytes) -> None:
        """Send a datagram: to the vehicle from the vehicle's port, to the application from the
        application's port. Without a peer the datagram is lost."""
        by = DOWN if way == UP else UP
        self._wires[by].send(self._peers[by], [data])
