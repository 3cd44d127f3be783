"""UDP, TCP and serial links with one interface. An open link never raises. Errors of the network or
the device are counted in `troubles`, and the link retries."""

import errno
import fcntl
import os
import socket
import termios
from collections import Counter
from collections.abc import Callable, Hashable, Iterable
from contextlib import suppress
from functools import lru_cache
from ipaddress import IPv6Address, ip_address, ip_network
from pathlib import Path
from typing import Any, Protocol

from circnav_mav.mav.identity import address_text
from circnav_mav.runtime.endpoint import Endpoint, LinkError, explain, parse_endpoint, resolve

MOST_BYTES = 1 << 15
"""Number of bytes after which one call of `receive` stops reading (UDP: at the end of a datagram).
The rest stays in the socket for the next step, which follows at once. In 50 ms a radio sends 1 % of
this number, a simulator at 20 times real time about 20 kB. Decoding MOST_BYTES takes 5 ms, and 50
ms for frames built to slow the decoder. Only a step of 0.5 s would be treated as a stall."""
MOST_DATAGRAMS = 512
"""Largest number of datagrams read in one call of `receive`, so that a flood cannot delay a
tick."""
LONGEST = 8192
"""Longest datagram that is accepted, bytes: five times the size of the datagrams that routers send.
Longer datagrams are ignored."""
RECEIVE_BUFFER = 1 << 18
"""Receive buffer of the socket, bytes (Linux doubles this number, and counts overhead in the
buffer). The buffer holds 600 short datagrams: 0.2 s of a simulator at 20 times real time. A longer
queue only adds delay during a flood: with 1 MB, a takeover was received 1 s late."""
MOST_TROUBLES = 4
"""Largest number of different error messages that are counted separately. Further messages are
counted under one common text."""
FROM_OTHERS = "ignored: from other senders"
"""Common text of a UDP link, for datagrams that are ignored after MOST_TROUBLES different
messages."""
LOCAL_PORT = 14691
"""Local port for `udpout`. PX4 keeps sending to the port of its first client, so a restarted
circnav must use the same port."""
RETRY = 1.0
"""Time between two attempts to reopen a link, s."""
LOST = (OSError, ValueError, termios.error)
"""Exceptions of a failed link, such as an unplugged serial device. The exception of pyserial is an
OSError, but while opening a port, pyserial passes on `termios.error`, which is not an OSError."""
MISSING = (errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.EIO, errno.EBUSY)
"""Errors of a serial device that may be available later: it is missing, vanishes while it is
opened, or is in use."""
NO_NETWORK = (errno.EADDRNOTAVAIL, errno.ENETUNREACH, errno.EHOSTUNREACH, errno.ENODEV)
"""Errors of a network interface that is not up yet."""
HALF_OPEN = 3.0
"""Time for which sent data may remain unacknowledged before the system closes a TCP connection, s
(Linux)."""


class Link(Protocol):
    """Open endpoint."""

    troubles: Counter[str]
    """Count of each error message since the link was opened."""

    def fileno(self) -> int | None:
        """Return the file descriptor to wait on, or None while closed."""

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """Return the received data, each item with its source."""

    def send(self, data: bytes, to: Hashable) -> None:
        """Send data. to: source from which data was received, or None for the peer in the endpoint,
        if any."""

    def close(self) -> None:
        """Close the endpoint."""


def note(troubles: Counter[str], words: str, others: str) -> None:
    """Count an error message, or count it as `others` once many different messages are counted."""
    troubles[words if words in troubles or len(troubles) < MOST_TROUBLES else others] += 1


def open_link(text: str, peers: Iterable[str] = ()) -> Link:
    """Open an endpoint. peers: addresses and networks that `udpin` accepts, empty for all. Raises
    LinkError."""
    endpoint = parse_endpoint(text)
    try:
        if endpoint.kind == "serial":
            return _open_serial(endpoint)
        return _open_tcp(endpoint) if endpoint.kind == "tcp" else UdpLink(endpoint, peers)
    except ImportError:
        raise LinkError(
            f"endpoint {text}: needs the package pyserial (not serial): pip install pyserial"
        ) from None
    except LOST as error:
        number = getattr(error, "errno", None)
        no_peer = {
            # udev sets the group of a device shortly after the device has appeared.
            "serial": number == errno.EACCES,
            "tcp": not isinstance(error, UnicodeError),
        }.get(endpoint.kind, isinstance(error, socket.gaierror) or number in NO_NETWORK)
        raise LinkError(f"endpoint {text}: {explain(error)}", no_peer=no_peer) from None


class UdpLink:
    """UDP socket. `udpin` binds a port and sends to the source that `Pilot` selected. `udpout`
    exchanges datagrams only with the address in the endpoint, because another vehicle may still
    send to LOCAL_PORT."""

    def __init__(self, endpoint: Endpoint, peers: Iterable[str]) -> None:
        """peers: addresses and networks that `udpin` accepts, empty for all. Raises OSError,
        UnicodeError."""
        self.troubles: Counter[str] = Counter()
        networks = [ip_network(peer, strict=False) for peer in peers]
        # 256: number of hosts for which the peer check is cached. Bounds the memory that a flood of
        # addresses can use.
        self._accepts = lru_cache(256)(
            lambda host: not networks or any(_ip(host) in one for one in networks)
        )
        family, address = resolve(endpoint)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        self._peer = address if endpoint.kind == "udpout" else None
        try:
            if self._peer is None:
                self._bind(address)
            else:
                self._bind_local()
        except OSError:
            self._socket.close()
            raise

    @property
    def port(self) -> int:
        """Local port."""
        return int(self._socket.getsockname()[1])

    def fileno(self) -> int | None:
        return self._socket.fileno()

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """Return the received datagrams, each with its sender."""
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
                self._refuse(f"ignored: from {address_text(source)}")
            elif len(data) > LONGEST:
                self._refuse(f"ignored: longer than {LONGEST} bytes, from {address_text(source)}")
            else:
                datagrams.append((data, source))
            if room <= 0:
                break
        return datagrams

    def send(self, data: bytes, to: Hashable) -> None:
        """Send one datagram to the selected peer, or to the address of `udpout`."""
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
        """Count a datagram that is ignored because it is too long or its sender is not accepted."""
        note(self.troubles, words, FROM_OTHERS)

    def _bind(self, address: Any) -> None:
        self._socket.bind(address)

    def _bind_local(self) -> None:
        try:
            self._socket.bind(("", LOCAL_PORT))
        except OSError:
            self._socket.bind(("", 0))


def _ip(host: str) -> Any:
    """Return the address of a sender. An IPv4 address mapped by an IPv6 socket is converted
    back."""
    address = ip_address(host)
    return (address.ipv4_mapped or address) if isinstance(address, IPv6Address) else address


def _same(peer: Any, source: Any) -> bool:
    """True if both are the same address."""
    # A server on this computer replies from 127.0.0.1 if the client sent to 0.0.0.0 or to the host
    # name, which many systems resolve to 127.0.1.1.
    return bool(peer[1] == source[1]) and (
        peer[0] == source[0] or (_is_here(peer[0]) and _is_here(source[0]))
    )


def _is_here(host: str) -> bool:
    return host in ("0.0.0.0", "::", "::1") or host.startswith("127.")


class StreamLink:
    """TCP socket or pyserial port. After an error, or after the peer has closed the connection, the
    link tries to reopen it once a second."""

    def __init__(
        self, source: Hashable, port: Any, reopen: Callable[[], Any], read: Callable[[Any], bytes]
    ) -> None:
        """source: sender of all received bytes. port: None if it cannot be opened yet. reopen,
        read: functions that do not block, and raise one of LOST on failure. read returns b"" if
        nothing was received."""
        self.troubles: Counter[str] = Counter()
        self._source = source
        self._port = port
        self._reopen = reopen
        self._read = read
        self._retry_at = float("-inf")

    def fileno(self) -> int | None:
        return int(self._port.fileno()) if self._port else None

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """Return the received bytes. Close the port on an error; a later call reopens it."""
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
            self._port = None
            self._retry_at = now + RETRY
            return []
        return [(data, self._source)] if data else []

    def send(self, data: bytes, to: Hashable) -> None:
        """Send without blocking. If the buffer is full, the bytes are lost."""
        if self._port is None:
            return
        try:
            os.write(self._port.fileno(), data)
        except LOST as error:
            self.troubles[explain(error)] += 1

    def close(self) -> None:
        """Close the port, ignoring the errors of an unplugged device."""
        if self._port is not None:
            with suppress(*LOST):
                self._port.close()


def _open_tcp(endpoint: Endpoint) -> StreamLink:
    """Connect to a TCP server (SITL: port 5760). Raises OSError, UnicodeError."""
    family, address = resolve(endpoint)  # resolve only once: a lookup may block or fail
    connection = socket.socket(family, socket.SOCK_STREAM)
    # Timeout for connecting to a TCP peer, s.
    connection.settimeout(5.0)
    try:
        connection.connect(address)
    except OSError:
        connection.close()
        raise
    _prepare(connection)
    return StreamLink(address, connection, lambda: _connect(family, address), _received)


def _connect(family: socket.AddressFamily, address: Any) -> socket.socket:
    """Begin to connect, without waiting. Raises OSError."""
    attempt = socket.socket(family, socket.SOCK_STREAM)
    _prepare(attempt)
    if (code := attempt.connect_ex(address)) not in (0, errno.EINPROGRESS):
        attempt.close()
        raise OSError(code, os.strerror(code))
    return attempt


def _prepare(connection: socket.socket) -> None:
    """Disable blocking and Nagle's algorithm, so that a setpoint is sent at once, and set the
    timeout HALF_OPEN."""
    # circnav sends at least once a second. A peer that has vanished without closing the connection
    # is detected by missing acknowledgments.
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


def user_of(device: str) -> str:
    """Return name and process id of another program that has a device open, or empty. Programs of
    other users are not found (Linux)."""
    if not os.path.exists(device):
        return ""
    path = os.path.realpath(device)
    if path.startswith("/dev/pts/"):  # the program that made a pseudo terminal keeps it open
        return ""
    for descriptor in Path("/proc").glob("[0-9]*/fd/*"):
        process = descriptor.parent.parent
        with suppress(OSError):
            if os.readlink(descriptor) == path and int(process.name) != os.getpid():
                return f"{(process / 'comm').read_text().strip()} (process {process.name})"
    return ""


def _open_serial(endpoint: Endpoint) -> StreamLink:
    """Open a serial line with pyserial. A missing device is opened after it has appeared. Raises
    LOST, ImportError."""
    from serial import Serial  # another package named `serial` lacks this class

    def open_port() -> Any:
        # Two programs that read one port each receive a part of the bytes, without an error.
        if user := user_of(endpoint.host):
            raise OSError(errno.EBUSY, f"device is in use by {user}", endpoint.host)
        try:
            port = Serial(endpoint.host, endpoint.port, timeout=0, write_timeout=0, exclusive=True)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EBUSY):
                text = "device is in use by another program"
                raise OSError(errno.EBUSY, text, endpoint.host) from None
            raise
        with suppress(OSError):  # later programs without the right to override this are refused
            fcntl.ioctl(port.fileno(), termios.TIOCEXCL)
        return port

    def reopen() -> Any:
        port = open_port()
        for words in troubles:  # a device that has appeared is no trouble
            del link.troubles[words]
        troubles.clear()
        return port

    port = None
    troubles: Counter[str] = Counter()
    try:
        port = open_port()
    except LOST as error:
        # At boot, a USB device may appear later than circnav starts, and the system may probe it
        # for some seconds (ModemManager). A wrong baud rate and a missing permission need the
        # operator.
        if next(iter(error.args), None) not in MISSING:
            raise
        troubles[explain(error)] += 1
    link = StreamLink(endpoint.host, port, reopen, lambda port: bytes(port.read(MOST_BYTES)))
    link.troubles += troubles
    return link
