"""Endpoints: UDP, TCP and serial, in the spellings of mavutil (`udpin:host:port`) and MAVSDK (`udpin://host:port`).

A link never raises while it is open: an unreachable network or a vanished device is silence, counted in words, and
tried again.
"""

from collections import Counter
from collections.abc import Hashable, Iterable
from typing import Protocol

from circnav_mav.runtime.endpoint import LinkError, parse_endpoint
from circnav_mav.runtime.stream_link import open_serial, open_tcp
from circnav_mav.runtime.udp_link import UdpLink

__all__ = ["Link", "LinkError", "open_link", "parse_endpoint"]


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


def open_link(text: str, peers: Iterable[str] = ()) -> Link:
    """Open an endpoint. peers: addresses and networks that `udpin` hears, none for all. Raises LinkError."""
    endpoint = parse_endpoint(text)
    if endpoint.kind == "serial":
        return open_serial(text, endpoint)
    if endpoint.kind == "tcp":
        return open_tcp(text, endpoint)
    return UdpLink(text, endpoint, peers)
