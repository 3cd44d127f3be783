"""Endpoints in the notation of mavutil (`udpin:host:port`) or MAVSDK (`udpin://host:port`), and
their error messages."""

import errno
import socket
import termios
from dataclasses import dataclass
from ipaddress import IPv6Address
from math import inf
from typing import Any

REMEDIES: dict[int | None, str] = {
    errno.EADDRINUSE: "port is in use by another program: close it, or choose another port",
    errno.ECONNREFUSED: "connection refused: no program listens at this address",
    errno.ENOENT: "no such device",
    errno.EADDRNOTAVAIL: "no interface of this computer has this address",
    errno.EAGAIN: "TX buffer full: lower stream rates or raise the baud rate",
}


class LinkError(Exception):
    """An endpoint that cannot be opened. The message is one line.

    no_peer: True if the endpoint may be available later. During boot, a TCP peer, a network
        interface or a host name may not exist yet.
    """

    def __init__(self, text: str, *, no_peer: bool = False) -> None:
        super().__init__(text)
        self.no_peer = no_peer


LOWEST = {"udpin": 0, "udpout": 1, "tcp": 1, "serial": 0}
"""Smallest port, or baud rate, by the kind of the endpoint."""


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Parsed endpoint.

    kind: `udpin`, `udpout`, `tcp` or `serial`.
    host: host name or address; path of the device for a serial line.
    port: port number; baud rate for a serial line.
    """

    kind: str
    host: str
    port: int


def parse_endpoint(text: str) -> Endpoint:
    """Parse an endpoint in either notation. Raises LinkError."""
    kind, sign, rest = text.partition(":")
    kind = {"udp": "udpin", "tcpout": "tcp"}.get(kind, kind)
    rest = rest.removeprefix("//")
    if not sign or kind not in LOWEST:
        raise LinkError(
            f"endpoint {text!r}: write udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or"
            " serial:PATH:BAUD (udp: is udpin:)"
        )
    number = "port"
    form = "HOST:PORT"
    highest: float = 65535
    if kind == "serial":
        number = "baud rate"
        form = "PATH:BAUD"
        highest = inf
    host, _, port = rest.replace(",", ":").rpartition(":")
    if kind != "serial" and ":" in host:
        host = _ipv6(host, text)
    wrong = "" if host else "host is missing"
    if not port.isdecimal():
        wrong = f"{number} is missing or not a number"
    if wrong:
        raise LinkError(f"endpoint {text!r}: {wrong}, write {kind}:{form}")
    if not LOWEST[kind] <= int(port) <= highest:
        raise LinkError(f"endpoint {text!r}: port must be {LOWEST[kind]} to {highest}")
    return Endpoint(kind, host, int(port))


def _ipv6(host: str, text: str) -> str:
    """Return the IPv6 address without its brackets. Raises LinkError."""
    try:
        if host.startswith("[") and host.endswith("]"):
            return str(IPv6Address(host[1:-1]))
    except ValueError:
        pass
    raise LinkError(
        f"endpoint {text!r}: write an IPv6 address in brackets, as in udpin:[::1]:14550"
    )


def resolve(endpoint: Endpoint) -> tuple[socket.AddressFamily, Any]:
    """Return the address family and address of an endpoint, preferring IPv4. Raises OSError,
    UnicodeError."""
    found = [
        (family, address)
        for family, *_, address in socket.getaddrinfo(endpoint.host, endpoint.port)
    ]
    return min(found, key=lambda one: one[0] != socket.AF_INET)


def explain(error: Exception) -> str:
    """Return the message of an OS error, with a remedy where one is known."""
    if isinstance(error, termios.error):  # not an OSError, but has the same arguments
        error = OSError(*error.args)
    if isinstance(
        error, socket.gaierror | UnicodeError
    ):  # UnicodeError: `10.0..1` cannot be a name
        return "unknown host name"
    message = getattr(error, "strerror", None) or error
    return REMEDIES.get(getattr(error, "errno", None), str(message).lower())
