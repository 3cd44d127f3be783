"""The fault link over UDP: applications speak to its port, it speaks to the vehicle, and back."""

import contextlib
import select
import socket
import time
from collections.abc import Callable

from ..wires import BATCH, BIGGEST, Endpoint, EndpointError, bound, parse_endpoint, resolved
from .link import DOWN, UP, FaultLink

LONGEST_SLEEP = 0.05


class Proxy:
    """Two UDP ports with a fault link between them. Each end answers whoever spoke last, or the one it was given."""

    def __init__(self, listen: str, forward: str, link: FaultLink) -> None:
        """listen: where applications are awaited (udpin) or called (udpout); forward: the vehicle's side."""
        self._link = link
        self._sockets: dict[str, socket.socket] = {}
        self._peers: dict[str, tuple[str, int] | None] = {}
        for direction, endpoint in ((UP, parse_endpoint(listen)), (DOWN, parse_endpoint(forward))):
            try:
                self._sockets[direction], self._peers[direction] = _open(endpoint)
            except EndpointError:
                self.close()
                raise

    def run(self, stopped: Callable[[], bool]) -> None:
        """Pass datagrams on until `stopped()`."""
        started = time.monotonic()
        while not stopped():
            now = time.monotonic() - started
            for direction, port in self._sockets.items():
                self._hear(direction, port, now)
            for way, data in self._link.intrusions(now):
                self._send(way, data)
            for way in (UP, DOWN):
                for data in self._link.take(way, now):
                    self._send(way, data)
            wait = self._link.next_due - now
            select.select(list(self._sockets.values()), [], [], max(0.0, min(wait, LONGEST_SLEEP)))

    def close(self) -> None:
        for port in self._sockets.values():
            port.close()

    def _hear(self, direction: str, port: socket.socket, now: float) -> None:
        """What comes in at the applications' port goes up, what comes in at the vehicle's goes down."""
        for _ in range(BATCH):
            try:
                data, self._peers[direction] = port.recvfrom(BIGGEST)
            except BlockingIOError:
                return
            except OSError:
                continue  # an earlier datagram bounced
            self._link.push(direction, data, now)

    def _send(self, way: str, data: bytes) -> None:
        """What goes up leaves by the vehicle's port."""
        by = DOWN if way == UP else UP
        peer = self._peers[by]
        if peer is not None:
            with contextlib.suppress(OSError):  # nobody there: as on any line, it is lost
                self._sockets[by].sendto(data, peer)


def _open(endpoint: Endpoint) -> tuple[socket.socket, tuple[str, int] | None]:
    if endpoint.kind == "tcpin":
        raise EndpointError(f"{endpoint}: the fault link speaks UDP only: udpin:HOST:PORT or udpout:HOST:PORT")
    peer = resolved(endpoint) if endpoint.kind == "udpout" else None
    return bound(socket.SOCK_DGRAM, endpoint), peer
