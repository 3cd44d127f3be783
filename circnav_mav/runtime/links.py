"""Endpoints: UDP, TCP and serial, in the spellings of mavutil (`udpin:host:port`) and MAVSDK (`udpin://host:port`).

A link never raises while it is open: an unreachable network or a vanished device is silence, counted, and tried again.
"""

import errno
import os
import socket
import termios
from collections.abc import Hashable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

MOST_DATAGRAMS = 512
"""Datagrams taken in one call, so that a flood cannot keep the loop from its tick."""
MOST_BYTES = 1 << 15
"""Bytes taken in one call, up to the end of a datagram: what is left stays in the socket for the next turn of the loop,
which follows at once. A radio brings a hundredth of that in 50 ms, a simulator at twenty times real time some 20 kB; to
decode it takes 5 ms, and 0.1 s of frames that somebody made up to take long, where 0.5 s without a step is a stall."""
LOCAL_PORT = 14691
"""Our local port for `udpout`: PX4 latches onto the first client port it hears, so a restart must use the same."""
RETRY = 1.0
HALF_OPEN = 3.0
"""Time, s, without acknowledgement after which a TCP connection counts as gone."""
LOST = (OSError, ValueError, termios.error)
"""What a serial device raises that is vanishing. pyserial's own error is an OSError; it passes on that of the terminal,
which is none, where the device goes while it is being opened."""
CONNECT_PATIENCE = 5.0


class LinkError(Exception):
    """An endpoint that cannot be opened, in one line. `nobody` tells a peer that refuses from a local mistake."""

    def __init__(self, text: str, *, nobody: bool = False) -> None:
        super().__init__(text)
        self.nobody = nobody


class Link(Protocol):
    """One open endpoint."""

    errors: int

    def fileno(self) -> int | None:
        """File descriptor to wait on, None while there is none."""
        ...

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """What has come in, each with its source."""
        ...

    def send(self, data: bytes, to: Hashable) -> None:
        """Send to a source that was heard; None: to the endpoint's own peer, if it names one."""
        ...

    def close(self) -> None:
        """Let go of the endpoint."""
        ...


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A parsed endpoint: kind is `udpin`, `udpout`, `tcp` or `serial`; port is the baud rate of a serial line."""

    kind: str
    host: str
    port: int


def parse_endpoint(text: str) -> Endpoint:
    """Read an endpoint in either spelling. Raises LinkError."""
    kind, sign, rest = text.partition(":")
    kind = {"udp": "udpin", "tcpout": "tcp"}.get(kind, kind)
    rest = rest.removeprefix("//")
    if not sign or kind not in ("udpin", "udpout", "tcp", "serial"):
        raise LinkError(
            f"endpoint {text!r}: write udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:PATH:BAUD"
            " (udp: is udpin:)"
        )
    host, sign, port = rest.replace(",", ":").rpartition(":")
    if not sign or not host or not port.isdecimal():
        missing, form = ("baud rate", "PATH:BAUD") if kind == "serial" else ("port", "HOST:PORT")
        wrong = "host is missing" if rest.isdecimal() else f"{missing} is missing or not a number"
        raise LinkError(f"endpoint {text!r}: {wrong}, write {kind}:{form}")
    lowest = 0 if kind == "udpin" else 1
    if kind != "serial" and not lowest <= int(port) <= 65535:
        raise LinkError(f"endpoint {text!r}: port must be {lowest} to 65535")
    return Endpoint(kind, host, int(port))


def open_link(text: str) -> Link:
    """Open an endpoint. Raises LinkError."""
    endpoint = parse_endpoint(text)
    if endpoint.kind == "serial":
        return SerialLink(text, endpoint)
    if endpoint.kind == "tcp":
        return TcpLink(text, endpoint)
    return UdpLink(text, endpoint)


class UdpLink:
    """`udpin` waits on a port and answers whom the pilot has chosen; `udpout` speaks to one address."""

    def __init__(self, text: str, endpoint: Endpoint) -> None:
        self.errors = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        try:
            address = (socket.gethostbyname(endpoint.host), endpoint.port)
            self._peer = address if endpoint.kind == "udpout" else None
            if self._peer is None:
                self._socket.bind(address)
            else:
                self._bind_local()
        except OSError as error:
            self._socket.close()
            raise LinkError(f"endpoint {text}: {_explain(error)}") from None

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._socket.getsockname()[1])

    def fileno(self) -> int | None:
        """File descriptor to wait on."""
        return self._socket.fileno()

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """The datagrams that have come in, each with its sender."""
        datagrams: list[tuple[bytes, Hashable]] = []
        room = MOST_BYTES
        while len(datagrams) < MOST_DATAGRAMS and room > 0:
            try:
                data, source = self._socket.recvfrom(65536)
            except BlockingIOError:
                break
            except OSError:
                self.errors += 1
                break
            datagrams.append((data, source))
            room -= len(data)
        return datagrams

    def send(self, data: bytes, to: Hashable) -> None:
        """Send one datagram to the chosen peer, or to the address of `udpout`."""
        address: Any = self._peer or to
        if address is None:
            return
        try:
            self._socket.sendto(data, address)
        except OSError:
            self.errors += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _bind_local(self) -> None:
        try:
            self._socket.bind(("", LOCAL_PORT))
        except OSError:
            self._socket.bind(("", 0))


class TcpLink:
    """A client of a TCP server (SITL: port 5760); reconnects once a second after the other side has gone."""

    def __init__(self, text: str, endpoint: Endpoint) -> None:
        self.errors = 0
        self._retry_at = float("-inf")
        self._socket: socket.socket | None = None
        try:
            self._address = (socket.gethostbyname(endpoint.host), endpoint.port)  # once: a lookup may block or fail
            self._socket = socket.create_connection(self._address, timeout=CONNECT_PATIENCE)
        except OSError as error:
            raise LinkError(f"endpoint {text}: {_explain(error)}", nobody=True) from None
        _prepare(self._socket)

    def fileno(self) -> int | None:
        """File descriptor to wait on, None between connections."""
        return self._socket.fileno() if self._socket else None

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """The bytes that have come in. End of file closes the connection; a later call opens it again."""
        if self._socket is None:
            self._reconnect(now)
            return []
        try:
            data = self._socket.recv(MOST_BYTES)
        except (BlockingIOError, InterruptedError):
            return []
        except OSError:
            data = b""
        if not data:
            self._drop(now)
            return []
        return [(data, self._address)]

    def send(self, data: bytes, to: Hashable) -> None:
        """Send to the server; a full buffer loses the bytes rather than delay the loop."""
        if self._socket is None:
            return
        try:
            self._socket.send(data)
        except OSError:
            self.errors += 1

    def close(self) -> None:
        """Close the connection."""
        if self._socket is not None:
            self._socket.close()

    def _drop(self, now: float) -> None:
        self.errors += 1
        self.close()
        self._socket, self._retry_at = None, now + RETRY

    def _reconnect(self, now: float) -> None:
        if now < self._retry_at:
            return
        self._retry_at = now + RETRY
        attempt = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        _prepare(attempt)
        if attempt.connect_ex(self._address) in (0, errno.EINPROGRESS):
            self._socket = attempt
        else:
            attempt.close()


class SerialLink:
    """A serial line through pyserial; reopened once a second after the device has vanished."""

    def __init__(self, text: str, endpoint: Endpoint) -> None:
        self.errors = 0
        self._endpoint = endpoint
        self._retry_at = float("-inf")
        try:
            import serial
        except ImportError:
            raise LinkError(f"endpoint {text}: needs the package pyserial: pip install 'circnav-mav[serial]'") from None
        self._serial = serial
        try:
            self._port: Any = self._open()
        except LOST as error:
            raise LinkError(f"endpoint {text}: {_explain(error)}") from None

    def fileno(self) -> int | None:
        """File descriptor to wait on, None while the device is gone."""
        return int(self._port.fileno()) if self._port else None

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """The bytes that have come in."""
        if self._port is None:
            self._reopen(now)
            return []
        try:
            data = self._port.read(MOST_BYTES)
        except LOST:
            self.errors += 1
            self.close()
            self._port, self._retry_at = None, now + RETRY
            return []
        return [(data, self._endpoint.host)] if data else []

    def send(self, data: bytes, to: Hashable) -> None:
        """Send; a full buffer loses the bytes rather than delay the loop."""
        if self._port is None:
            return
        try:
            os.write(self._port.fileno(), data)
        except LOST:
            self.errors += 1

    def close(self) -> None:
        """Close the device; one that has vanished may refuse that, too."""
        if self._port is not None:
            with suppress(*LOST):
                self._port.close()

    def _open(self) -> Any:
        return self._serial.Serial(self._endpoint.host, self._endpoint.port, timeout=0, write_timeout=0)

    def _reopen(self, now: float) -> None:
        if now < self._retry_at:
            return
        self._retry_at = now + RETRY
        try:
            self._port = self._open()
        except LOST:
            self._port = None


def _prepare(connection: socket.socket) -> None:
    """Never wait, never gather: a setpoint leaves at once. A peer that vanished without a word is noticed by what it
    does not acknowledge, for we say something every second."""
    connection.setblocking(False)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1000 * HALF_OPEN))


def _explain(error: Exception) -> str:
    """An OS error with what to do about it."""
    code = error.args[0] if isinstance(error, termios.error) else getattr(error, "errno", None)
    if code == errno.EADDRINUSE:
        return "port is in use by another program: close it, or choose another port"
    if code == errno.ECONNREFUSED:
        return "nobody listens there (connection refused)"
    if code == errno.ENOENT:
        return "no such device"
    if isinstance(error, socket.gaierror):
        return "host name is not known"
    said = error.args[-1] if isinstance(error, termios.error) else getattr(error, "strerror", None)
    return str(said or error).lower()
