"""UDP: `udpin` hears whoever speaks, or the addresses named only, and who is answered the pilot decides; `udpout` has
one other side."""

import socket
from collections import Counter
from collections.abc import Hashable, Iterable
from functools import lru_cache
from ipaddress import IPv6Address, ip_address, ip_network
from typing import Any

from circnav_mav.mav.identity import spelt
from circnav_mav.runtime.endpoint import MOST_BYTES, Endpoint, LinkError, explain, resolve

MOST_DATAGRAMS = 512
"""Datagrams taken in one call, so that a flood cannot keep the loop from its tick."""
LONGEST = 8192
"""Of a datagram that is read, bytes: five times what routers put into one. Longer ones are somebody's flood."""
RECEIVE_BUFFER = 1 << 18
"""Of the socket, bytes; Linux counts the overhead, and doubles it. Room for 600 short datagrams, 0.2 s of a simulator
at twenty times real time. In a flood that cannot be read as fast as it comes something is lost in any case, and what
waits in a longer queue is only late: with 1 MB every range, and a takeover, came 1 s late."""
_MOST_HOSTS = 256
MOST_TROUBLES, NOT_HEARD = 4, "ignored: sent by others"
"""Kinds of trouble from which on strangers are no longer told one by one."""
LOCAL_PORT = 14691
"""Our local port for `udpout`: PX4 latches onto the first client port it hears, so a restart must use the same."""


class UdpLink:
    """`udpin` waits on a port and answers whom the pilot has chosen; `udpout` speaks to one address and hears no other:
    a vehicle that still speaks to LOCAL_PORT must not be heard while another one is commanded."""

    def __init__(self, text: str, endpoint: Endpoint, peers: Iterable[str] = ()) -> None:
        """peers: addresses and networks that `udpin` hears, none for all."""
        self.troubles: Counter[str] = Counter()
        networks = [ip_network(peer, strict=False) for peer in peers]
        self._accepts = lru_cache(_MOST_HOSTS)(lambda host: not networks or any(_ip(host) in one for one in networks))
        try:
            family, address = resolve(endpoint)
        except (OSError, UnicodeError) as error:
            raise LinkError(f"endpoint {text}: {explain(error)}") from None
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        self._peer = address if endpoint.kind == "udpout" else None
        try:
            if self._peer is None:
                self._socket.bind(address)
            else:
                self._bind_local()
        except OSError as error:
            self._socket.close()
            raise LinkError(f"endpoint {text}: {explain(error)}") from None

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
        self.troubles[words if words in self.troubles or len(self.troubles) < MOST_TROUBLES else NOT_HEARD] += 1

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
