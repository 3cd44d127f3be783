"""Endpoints and their sockets: every address or connection heard is a link of its own, as on an autopilot's ports.

udpin:HOST:PORT, udpout:HOST:PORT or tcpin:HOST:PORT, with or without slashes.
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
    """An endpoint that cannot be used, in one line."""


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
            f'"{text}" is not an endpoint, write udpin:127.0.0.1:14550, udpout:HOST:PORT or tcpin:HOST:PORT'
        )
    kind, host, port = match[1], match[2], int(match[3])
    if not 0 < port < 65536:
        raise EndpointError(f'"{text}": port {port} is outside 1 .. 65535')
    return Endpoint(kind, host, port)


class UdpWire:
    """A UDP port (udpin: answers whoever speaks) or a fixed peer (udpout: speaks first).

    Links are named `first`, then `first-2`, `first-3` in the order they were heard.
    """

    stream = False

    def __init__(self, endpoint: Endpoint, first: str, most_peers: int) -> None:
        self._first = first
        self._most_peers = most_peers
        self._peers = {(socket.gethostbyname(endpoint.host), endpoint.port): first} if endpoint.kind == "udpout" else {}
        self._socket = bound(socket.SOCK_DGRAM, endpoint)

    def receive(self) -> list[Datagram]:
        """Everything that has arrived: (link name, bytes)."""
        heard = []
        for _ in range(BATCH):
            try:
                data, peer = self._socket.recvfrom(BIGGEST)
            except BlockingIOError:
                break
            except OSError:
                continue  # an earlier datagram bounced: the peer is not (yet) there
            if peer in self._peers or len(self._peers) < self._most_peers:
                heard.append((self._name(peer), data))
        return heard

    def send(self, link: str, frames: list[bytes]) -> None:
        for peer in [peer for peer, name in self._peers.items() if name == link]:
            for frame in frames:
                with contextlib.suppress(OSError):  # as on any radio: what is not received is lost
                    self._socket.sendto(frame, peer)

    def links(self) -> list[str]:
        return list(self._peers.values())

    def sockets(self) -> list[socket.socket]:
        return [self._socket]

    def close(self) -> None:
        self._socket.close()

    def _name(self, peer: tuple[str, int]) -> str:
        if peer not in self._peers:
            self._peers[peer] = self._first if not self._peers else f"{self._first}-{len(self._peers) + 1}"
        return self._peers[peer]


class TcpWire:
    """A listening TCP port; each connection is a link, named as those of a UDP port. Frames may come in pieces."""

    stream = True

    def __init__(self, endpoint: Endpoint, first: str) -> None:
        self._first = first
        self._listener = bound(socket.SOCK_STREAM, endpoint)
        self._listener.listen()
        self._open: dict[str, socket.socket] = {}
        self._count = 0

    def receive(self) -> list[Datagram]:
        heard = self._accept()
        for name, connection in list(self._open.items()):
            try:
                data = connection.recv(BIGGEST)
            except BlockingIOError:
                continue
            except OSError:
                data = b""
            if data:
                heard.append((name, data))
            else:
                self._drop(name)
        return heard

    def send(self, link: str, frames: list[bytes]) -> None:
        connection = self._open.get(link)
        if connection is None or not frames:
            return
        try:
            connection.sendall(b"".join(frames))
        except OSError:
            self._drop(link)  # gone, or so slow that half a frame is out: it has to reconnect

    def links(self) -> list[str]:
        return list(self._open)

    def sockets(self) -> list[socket.socket]:
        return [self._listener, *self._open.values()]

    def close(self) -> None:
        for connection in (*self._open.values(), self._listener):
            connection.close()

    def _accept(self) -> list[Datagram]:
        """A new connection is heard as nothing at all: that opens its link."""
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
    """The endpoint opened; raises EndpointError in one line when it cannot be."""
    try:
        return TcpWire(endpoint, first) if endpoint.kind == "tcpin" else UdpWire(endpoint, first, most_peers)
    except OSError as error:
        raise EndpointError(f"{endpoint}: cannot be opened: {(error.strerror or str(error)).lower()}") from error


def bound(kind: socket.SocketKind, endpoint: Endpoint) -> socket.socket:
    """A socket at the endpoint, of any port for udpout."""
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
