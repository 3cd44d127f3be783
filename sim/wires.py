"""Endpoints and their sockets. Every peer address or connection is a link, as on an autopilot's
ports.

Forms of an endpoint: udpin:HOST:PORT, udpout:HOST:PORT or tcpin:HOST:PORT, with or without slashes.
"""

import contextlib
import re
import socket
from typing import NamedTuple

PATTERN = re.compile(r"(udpin|udpout|tcpin):(?://)?([^:/]+):(\d+)/?")
Datagram = tuple[str, bytes]
BIGGEST = 65_535
BATCH = 1_000
MOST_PEERS = 32


class EndpointError(ValueError):
    """An endpoint that cannot be used. The message is one line."""


class Endpoint(NamedTuple):
    kind: str
    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.kind}:{self.host}:{self.port}"


def parse_endpoint(text: str) -> Endpoint:
    match = PATTERN.fullmatch(text.strip())
    if match is None:
        raise EndpointError(
            f'"{text}" is not an endpoint, write udpin:127.0.0.1:14550, udpout:HOST:PORT or'
            " tcpin:HOST:PORT"
        )
    kind = match[1]
    host = match[2]
    port = int(match[3])
    if not 0 < port < 65536:
        raise EndpointError(f'"{text}": port {port} is outside 1 to 65535')
    return Endpoint(kind, host, port)


class UdpWire:
    """A UDP port. With udpin, it sends to every peer that has sent to it. With udpout, it sends to
    a fixed peer and sends first.

    Links are named `first`, then `first-2`, `first-3`, in the order of their first datagrams.
    """

    stream = False

    def __init__(self, endpoint: Endpoint, first: str, most_peers: int) -> None:
        self._first = first
        self._most_peers = most_peers
        self._peers = (
            {(socket.gethostbyname(endpoint.host), endpoint.port): first}
            if endpoint.kind == "udpout"
            else {}
        )
        self._socket = bound(socket.SOCK_DGRAM, endpoint)

    def receive(self) -> list[Datagram]:
        """Return the received datagrams: (link name, bytes)."""
        received = []
        for _ in range(BATCH):
            try:
                data, peer = self._socket.recvfrom(BIGGEST)
            except BlockingIOError:
                break
            except OSError:
                continue  # an earlier datagram was refused: the peer has not opened its port yet
            if peer in self._peers or len(self._peers) < self._most_peers:
                received.append((self._name(peer), data))
        return received

    def send(self, link: str, frames: list[bytes]) -> None:
        for peer in [peer for peer, name in self._peers.items() if name == link]:
            for frame in frames:
                with contextlib.suppress(OSError):  # as on a radio, a datagram may be lost
                    self._socket.sendto(frame, peer)

    def links(self) -> list[str]:
        return list(self._peers.values())

    def sockets(self) -> list[socket.socket]:
        return [self._socket]

    def close(self) -> None:
        self._socket.close()

    def _name(self, peer: tuple[str, int]) -> str:
        if peer not in self._peers:
            self._peers[peer] = (
                self._first if not self._peers else f"{self._first}-{len(self._peers) + 1}"
            )
        return self._peers[peer]


class TcpWire:
    """A listening TCP port. Each connection is a link, named as for UDP. Frames may arrive in
    pieces."""

    stream = True

    def __init__(self, endpoint: Endpoint, first: str) -> None:
        self._first = first
        self._listener = bound(socket.SOCK_STREAM, endpoint)
        self._listener.listen()
        self._open: dict[str, socket.socket] = {}
        self._count = 0

    def receive(self) -> list[Datagram]:
        received = self._accept()
        for name, connection in list(self._open.items()):
            try:
                data = connection.recv(BIGGEST)
            except BlockingIOError:
                continue
            except OSError:
                data = b""
            if data:
                received.append((name, data))
            else:
                self._drop(name)
        return received

    def send(self, link: str, frames: list[bytes]) -> None:
        connection = self._open.get(link)
        if connection is None or not frames:
            return
        try:
            connection.sendall(b"".join(frames))
        except OSError:
            self._drop(link)  # closed, or so slow that a frame was cut; the peer has to reconnect

    def links(self) -> list[str]:
        return list(self._open)

    def sockets(self) -> list[socket.socket]:
        return [self._listener, *self._open.values()]

    def close(self) -> None:
        for connection in (*self._open.values(), self._listener):
            connection.close()

    def _accept(self) -> list[Datagram]:
        """Accept a new connection and return it with empty data, which opens its link."""
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return []
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._count += 1
        name = self._first if self._count == 1 else f"{self._first}-{self._count}"
        self._open[name] = connection
        return [(name, b"")]

    def _drop(self, name: str) -> None:
        self._open.pop(name).close()


Wire = UdpWire | TcpWire


def open_wire(endpoint: Endpoint, first: str, most_peers: int = MOST_PEERS) -> Wire:
    """Open an endpoint. Raises EndpointError."""
    try:
        return (
            TcpWire(endpoint, first)
            if endpoint.kind == "tcpin"
            else UdpWire(endpoint, first, most_peers)
        )
    except OSError as error:
        raise EndpointError(
            f"{endpoint}: cannot be opened: {(error.strerror or str(error)).lower()}"
        ) from error


def bound(kind: socket.SocketKind, endpoint: Endpoint) -> socket.socket:
    """Return a socket bound to the endpoint, or to any port for udpout."""
    made = socket.socket(socket.AF_INET, kind)
    if kind == socket.SOCK_STREAM:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind(("", 0) if endpoint.kind == "udpout" else (endpoint.host, endpoint.port))
    except OSError:
        made.close()
        raise
    made.setblocking(False)
    return made
