"""Links: UDP, TCP and serial lines behind one face. A link never raises while it is open: an unreachable network or a
vanished device is silence, counted in words, and tried again."""

import errno
import os
import socket
import termios
from collections import Counter
from collections.abc import Callable, Hashable, Iterable
from contextlib import suppress
from functools import lru_cache
from ipaddress import IPv6Address, ip_address, ip_network
from typing import Any, Protocol

from circnav_mav.mav.identity import spelt
from circnav_mav.runtime.endpoint import Endpoint, LinkError, explain, parse_endpoint, resolve

MOST_BYTES = 1 << 15
"""Bytes taken in one call, up to the end of a datagram: what is left stays in the socket for the next turn of the loop,
which follows at once. A radio brings a hundredth of that in 50 ms, a simulator at twenty times real time some 20 kB; to
decode it takes 5 ms, and 0.05 s of frames that somebody made up to take long, where 0.5 s without a step is a stall."""
MOST_DATAGRAMS = 512
"""Datagrams taken in one call, so that a flood cannot keep the loop from its tick."""
LONGEST = 8192
"""Of a datagram that is read, bytes: five times what routers put into one. Longer ones are somebody's flood."""
RECEIVE_BUFFER = 1 << 18
"""Of the socket, bytes; Linux counts the overhead, and doubles it. Room for 600 short datagrams, 0.2 s of a simulator
at twenty times real time. In a flood that cannot be read as fast as it comes something is lost in any case, and what
waits in a longer queue is only late: with 1 MB every range, and a takeover, came 1 s late."""
_MOST_HOSTS = 256
"""Hosts whose verdict is kept: bounds the memory that a flood of addresses can fill."""
MOST_TROUBLES, NOT_HEARD = 4, "ignored: sent by others"
"""Kinds of trouble from which on what others make up is no longer told one by one."""
LOCAL_PORT = 14691
"""Our local port for `udpout`: PX4 latches onto the first client port it hears, so a restart must use the same."""
RETRY = 1.0
"""Time between two attempts to open it again, s."""
LOST = (OSError, ValueError, termios.error)
"""What a serial device raises that is vanishing. pyserial's own error is an OSError; it passes on that of the terminal,
which is none, where the device goes while it is being opened."""
HALF_OPEN = 3.0
"""Time, s, without acknowledgement after which a TCP connection counts as gone."""
CONNECT_PATIENCE = 5.0
"""Time, s, that a TCP peer gets to answer; chosen."""


class Link(Protocol):
    """One open endpoint."""

    troubles: Counter[str]
    """What went wrong since it was opened, in words, and how often."""

    def fileno(self) -> int | None:
        """File descriptor to wait on, None while there is none."""

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """What has come in, each with its source."""

    def send(self, data: bytes, to: Hashable) -> None:
        """Send to a source that was heard; None: to the endpoint's own peer, if it names one."""

    def close(self) -> None:
        """Let go of the endpoint."""


def note(troubles: Counter[str], words: str, others: str) -> None:
    """Count a trouble; under `others` where there are many kinds already."""
    troubles[words if words in troubles or len(troubles) < MOST_TROUBLES else others] += 1


def open_link(text: str, peers: Iterable[str] = ()) -> Link:
    """Open an endpoint. peers: addresses and networks that `udpin` hears, none for all. Raises LinkError."""
    endpoint = parse_endpoint(text)
    try:
        if endpoint.kind == "serial":
            return _open_serial(endpoint)
        return _open_tcp(endpoint) if endpoint.kind == "tcp" else UdpLink(endpoint, peers)
    except ImportError:
        raise LinkError(f"endpoint {text}: needs the package pyserial, not serial: pip install pyserial") from None
    except LOST as error:
        nobody = endpoint.kind == "tcp" and not isinstance(error, UnicodeError)
        raise LinkError(f"endpoint {text}: {explain(error)}", nobody=nobody) from None


class UdpLink:
    """`udpin` waits on a port and answers whom the pilot has chosen; `udpout` speaks to one address and hears no other:
    a vehicle that still speaks to LOCAL_PORT must not be heard while another one is commanded."""

    def __init__(self, endpoint: Endpoint, peers: Iterable[str]) -> None:
        """peers: addresses and networks that `udpin` hears, none for all. Raises OSError, UnicodeError."""
        self.troubles: Counter[str] = Counter()
        networks = [ip_network(peer, strict=False) for peer in peers]
        self._accepts = lru_cache(_MOST_HOSTS)(lambda host: not networks or any(_ip(host) in one for one in networks))
        family, address = resolve(endpoint)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        self._peer = address if endpoint.kind == "udpout" else None
        try:
            if self._peer is None:
                self._socket.bind(address)
            else:
                self._bind_local()
        except OSError:
            self._socket.close()
            raise

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._socket.getsockname()[1])

    def fileno(self) -> int | None:
        return self._socket.fileno()

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """The datagrams that have come in, each with its sender."""
        datagrams: list[tuple[bytes, Hashable]] = []
        room = MOST_BYTES
        for _ in range(MOST_DATAGRAMS):
            try:
                data, source = self._socket.recvfrom(LONGEST + 1)
            except BlockingIOError:
                break
            except OSError as error:
                self.troubles[explain(error)] += 1
                break
            room -= len(data)
            if not (self._accepts(source[0]) if self._peer is None else _same(self._peer, source)):
                self._refuse(f"ignored: sent by {spelt(source)}")
            elif len(data) > LONGEST:
                self._refuse(f"ignored: longer than {LONGEST} bytes, from {spelt(source)}")
            else:
                datagrams.append((data, source))
            if room <= 0:
                break
        return datagrams

    def send(self, data: bytes, to: Hashable) -> None:
        """Send one datagram to the chosen peer, or to the address of `udpout`."""
        address: Any = self._peer or to
        if address is None:
            return
        try:
            self._socket.sendto(data, address)
        except OSError as error:
            self.troubles[explain(error)] += 1

    def close(self) -> None:
        self._socket.close()

    def _refuse(self, words: str) -> None:
        """Count what somebody else has sent, and what is too long."""
        note(self.troubles, words, NOT_HEARD)

    def _bind_local(self) -> None:
        try:
            self._socket.bind(("", LOCAL_PORT))
        except OSError:
            self._socket.bind(("", 0))


def _ip(host: str) -> Any:
    """The address of a sender; one of IPv4 that came in on an IPv6 socket is what it was."""
    address = ip_address(host)
    return (address.ipv4_mapped or address) if isinstance(address, IPv6Address) else address


def _same(peer: Any, source: Any) -> bool:
    """Whether these are one address. This computer answers as 127.0.0.1 to whoever spoke to 0.0.0.0, or to its own
    name, which many systems resolve to 127.0.1.1."""
    return bool(peer[1] == source[1]) and (peer[0] == source[0] or (_is_here(peer[0]) and _is_here(source[0])))


def _is_here(host: str) -> bool:
    return host in ("0.0.0.0", "::", "::1") or host.startswith("127.")


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


def _open_tcp(endpoint: Endpoint) -> StreamLink:
    """A client of a TCP server (SITL: port 5760). Raises OSError, UnicodeError."""
    family, address = resolve(endpoint)  # once: a lookup may block or fail
    connection = socket.socket(family, socket.SOCK_STREAM)
    connection.settimeout(CONNECT_PATIENCE)
    try:
        connection.connect(address)
    except OSError:
        connection.close()
        raise
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


def _open_serial(endpoint: Endpoint) -> StreamLink:
    """A serial line through pyserial. Raises LOST, ImportError."""
    from serial import Serial  # another package is named `serial`, too: it lacks this name

    def open_port() -> Any:
        return Serial(endpoint.host, endpoint.port, timeout=0, write_timeout=0)

    return StreamLink(endpoint.host, open_port(), open_port, lambda port: bytes(port.read(MOST_BYTES)))
