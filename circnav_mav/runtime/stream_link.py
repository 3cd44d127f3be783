"""A stream of bytes that may end and is opened again: a TCP connection, a serial line."""

import errno
import os
import socket
import termios
from collections import Counter
from collections.abc import Callable, Hashable
from contextlib import suppress
from typing import Any

from circnav_mav.runtime.endpoint import MOST_BYTES, Endpoint, LinkError, explain, resolve

RETRY = 1.0
"""Time between two attempts to open it again, s."""
LOST = (OSError, ValueError, termios.error)
"""What a serial device raises that is vanishing. pyserial's own error is an OSError; it passes on that of the terminal,
which is none, where the device goes while it is being opened."""
HALF_OPEN = 3.0
"""Time, s, without acknowledgement after which a TCP connection counts as gone."""
CONNECT_PATIENCE = 5.0


class StreamLink:
    """A socket or a pyserial port; opened again once a second after the other side has gone."""

    def __init__(self, source: Hashable, port: Any, reopen: Callable[[], Any], read: Callable[[Any], bytes]) -> None:
        """source: what bytes of it come from. reopen, read: never wait, and raise one of LOST. read: b"" where nothing
        has come in."""
        self.troubles: Counter[str] = Counter()
        self._source, self._port, self._reopen, self._read = source, port, reopen, read
        self._retry_at = float("-inf")

    def fileno(self) -> int | None:
        return int(self._port.fileno()) if self._port else None

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """The bytes that have come in. Its end closes it; a later call opens it again."""
        if self._port is None:
            if now >= self._retry_at:
                self._retry_at = now + RETRY
                with suppress(*LOST):
                    self._port = self._reopen()
            return []
        try:
            data = self._read(self._port)
        except LOST as error:
            self.troubles[explain(error)] += 1
            self.close()
            self._port, self._retry_at = None, now + RETRY
            return []
        return [(data, self._source)] if data else []

    def send(self, data: bytes, to: Hashable) -> None:
        """Send; a full buffer loses the bytes rather than delay the loop."""
        if self._port is None:
            return
        try:
            os.write(self._port.fileno(), data)
        except LOST as error:
            self.troubles[explain(error)] += 1

    def close(self) -> None:
        """Close it; a device that has vanished may refuse that, too."""
        if self._port is not None:
            with suppress(*LOST):
                self._port.close()


def open_tcp(text: str, endpoint: Endpoint) -> StreamLink:
    """A client of a TCP server (SITL: port 5760). Raises LinkError."""
    connection = None
    try:
        family, address = resolve(endpoint)  # once: a lookup may block or fail
        connection = socket.socket(family, socket.SOCK_STREAM)
        connection.settimeout(CONNECT_PATIENCE)
        connection.connect(address)
    except (OSError, UnicodeError) as error:
        if connection is not None:
            connection.close()
        raise LinkError(f"endpoint {text}: {explain(error)}", nobody=not isinstance(error, UnicodeError)) from None
    _prepare(connection)
    return StreamLink(address, connection, lambda: _connect(family, address), _received)


def _connect(family: socket.AddressFamily, address: Any) -> socket.socket:
    """A connection on its way up."""
    attempt = socket.socket(family, socket.SOCK_STREAM)
    _prepare(attempt)
    if (code := attempt.connect_ex(address)) not in (0, errno.EINPROGRESS):
        attempt.close()
        raise OSError(code, os.strerror(code))
    return attempt


def _prepare(connection: socket.socket) -> None:
    """Never wait, never gather: a setpoint leaves at once. A peer that vanished without a word is noticed by what it
    does not acknowledge, for we say something every second."""
    connection.setblocking(False)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1000 * HALF_OPEN))


def _received(connection: socket.socket) -> bytes:
    try:
        data = connection.recv(MOST_BYTES)
    except BlockingIOError:
        return b""
    if not data:
        raise ConnectionError("closed by the other side")
    return data


def open_serial(text: str, endpoint: Endpoint) -> StreamLink:
    """A serial line through pyserial. Raises LinkError."""
    try:
        import serial
    except ImportError:
        raise LinkError(f"endpoint {text}: needs the package pyserial: pip install pyserial") from None

    def open_port() -> Any:
        return serial.Serial(endpoint.host, endpoint.port, timeout=0, write_timeout=0)

    try:
        port = open_port()
    except LOST as error:
        raise LinkError(f"endpoint {text}: {explain(error)}") from None
    return StreamLink(endpoint.host, port, open_port, lambda port: bytes(port.read(MOST_BYTES)))
