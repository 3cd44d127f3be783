"""TCP: a client that connects again."""

import errno
import socket
from collections import Counter
from collections.abc import Hashable

from circnav_mav.runtime.endpoint import MOST_BYTES, Endpoint, LinkError, explain, resolve

RETRY = 1.0
"""Time between two attempts to open it again, s."""
HALF_OPEN = 3.0
"""Time, s, without acknowledgement after which a TCP connection counts as gone."""
CONNECT_PATIENCE = 5.0


class TcpLink:
    """A client of a TCP server (SITL: port 5760); reconnects once a second after the other side has gone."""

    def __init__(self, text: str, endpoint: Endpoint) -> None:
        self.troubles: Counter[str] = Counter()
        self._retry_at = float("-inf")
        self._socket: socket.socket | None = None
        try:
            self._family, self._address = resolve(endpoint)  # once: a lookup may block or fail
            self._socket = socket.socket(self._family, socket.SOCK_STREAM)
            self._socket.settimeout(CONNECT_PATIENCE)
            self._socket.connect(self._address)
        except (OSError, UnicodeError) as error:
            self.close()
            raise LinkError(f"endpoint {text}: {explain(error)}", nobody=not isinstance(error, UnicodeError)) from None
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
        except OSError as error:
            self._drop(now, explain(error))
            return []
        if not data:
            self._drop(now, "closed by the other side")
            return []
        return [(data, self._address)]

    def send(self, data: bytes, to: Hashable) -> None:
        """Send to the server; a full buffer loses the bytes rather than delay the loop."""
        if self._socket is None:
            return
        try:
            self._socket.send(data)
        except OSError as error:
            self.troubles[explain(error)] += 1

    def close(self) -> None:
        """Close the connection."""
        if self._socket is not None:
            self._socket.close()

    def _drop(self, now: float, why: str) -> None:
        self.troubles[why] += 1
        self.close()
        self._socket, self._retry_at = None, now + RETRY

    def _reconnect(self, now: float) -> None:
        if now < self._retry_at:
            return
        self._retry_at = now + RETRY
        attempt = socket.socket(self._family, socket.SOCK_STREAM)
        _prepare(attempt)
        if attempt.connect_ex(self._address) in (0, errno.EINPROGRESS):
            self._socket = attempt
        else:
            attempt.close()


def _prepare(connection: socket.socket) -> None:
    """Never wait, never gather: a setpoint leaves at once. A peer that vanished without a word is noticed by what it
    does not acknowledge, for we say something every second."""
    connection.setblocking(False)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1000 * HALF_OPEN))
