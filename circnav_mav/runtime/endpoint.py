"""Endpoints in the notation of mavutil (`udpin:host:port`) or MAVSDK (`udpin://host:port`), and
their error messages."""

import errno
import socket
import termios
from dataclasses import dataclass
from ipaddress import IPv6Address
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
    if not sign or kind not in ("udpin", "udpout", "tcp", "serial"):
        raise LinkError(
            f"endpoint {text!r}: write udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or"
            " serial:PATH:BAUD (udp: is udpin:)"
        )
    host, sign, port = rest.replace(",", ":").rpartition(":")
    if kind != "serial" and ":" in host:
        host = _ipv6(host, text)
    if not sign or not host or not port.isdecimal():
        missing, form = ("baud rate", "PATH:BAUD") if kind == "serial" else ("port", "HOST:PORT")
        wrong = (
            "host is missing"
            if port.isdecimal() and not host
            else f"{missing} is missing or not a number"
        )
        raise LinkError(f"endpoint {text!r}: {wrong}, write {kind}:{form}")
    lowest = 0 if kind == "udpin" else 1
    if kind != "serial" and not lowest <= int(port) <= 65535:
        raise LinkError(f"endpoint {text!r}: port must be {lowest} to 65535")
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
