"""Endpoints as mavutil (`udpin:host:port`) and MAVSDK (`udpin://host:port`) write them, and what is said of one that
cannot be opened."""

import errno
import socket
import termios
from dataclasses import dataclass
from ipaddress import IPv6Address
from typing import Any

REMEDIES: dict[int | None, str] = {
    errno.EADDRINUSE: "port is in use by another program: close it, or choose another port",
    errno.ECONNREFUSED: "nobody listens there (connection refused)",
    errno.ENOENT: "no such device",
    errno.EAGAIN: "TX buffer full: lower stream rates or raise the baud rate",
}


class LinkError(Exception):
    """An endpoint that cannot be opened, in one line. `nobody` tells a peer that refuses from a local mistake."""

    def __init__(self, text: str, *, nobody: bool = False) -> None:
        super().__init__(text)
        self.nobody = nobody


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
    if kind != "serial" and ":" in host:
        host = _ipv6(host, text)
    if not sign or not host or not port.isdecimal():
        missing, form = ("baud rate", "PATH:BAUD") if kind == "serial" else ("port", "HOST:PORT")
        wrong = "host is missing" if port.isdecimal() and not host else f"{missing} is missing or not a number"
        raise LinkError(f"endpoint {text!r}: {wrong}, write {kind}:{form}")
    lowest = 0 if kind == "udpin" else 1
    if kind != "serial" and not lowest <= int(port) <= 65535:
        raise LinkError(f"endpoint {text!r}: port must be {lowest} to 65535")
    return Endpoint(kind, host, int(port))


def _ipv6(host: str, text: str) -> str:
    """The address in brackets. Raises LinkError."""
    try:
        if host.startswith("[") and host.endswith("]"):
            return str(IPv6Address(host[1:-1]))
    except ValueError:
        pass
    raise LinkError(f"endpoint {text!r}: write an IPv6 address in brackets, as in udpin:[::1]:14550")


def resolve(endpoint: Endpoint) -> tuple[socket.AddressFamily, Any]:
    """The address of an endpoint and its family; IPv4 for a name that has both. Raises OSError, UnicodeError."""
    found = [(family, address) for family, *_, address in socket.getaddrinfo(endpoint.host, endpoint.port)]
    return min(found, key=lambda one: one[0] != socket.AF_INET)


def explain(error: Exception) -> str:
    """An OS error with what to do about it."""
    if isinstance(error, termios.error):  # is no OSError, but has the same arguments
        error = OSError(*error.args)
    if isinstance(error, socket.gaierror | UnicodeError):  # the second of `10.0..1`, which can be no name
        return "host name is not known"
    said = getattr(error, "strerror", None) or error
    return REMEDIES.get(getattr(error, "errno", None), str(said).lower())
