"""Link of a fleet member: reports to and from the other members, between the companion computers,
never through an autopilot.

Transport: UDP multicast, or a list of peers. An open link never blocks and never raises: a network
failure raises an alarm and is retried. The link reads no clock: it uses the stamp of this member's
report, and the argument `now` of `received`.
"""

import socket
import struct
import sys
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from functools import partial
from ipaddress import ip_address
from math import inf
from random import Random
from typing import Any

from circnav_mav.extras.fleet.acceptance import (
    CLOCK_TOLERANCE,
    Acceptance,
    RejectedError,
    Rejection,
    check_numbers,
)
from circnav_mav.extras.fleet.frames import COMPONENT, to_message
from circnav_mav.extras.fleet.report import MemberReport
from circnav_mav.extras.fleet.settings import PORT
from circnav_mav.mav.codec import Encoder
from circnav_mav.mav.signing import Signing, without_signature
from circnav_mav.runtime.endpoint import Endpoint, LinkError, explain, parse_endpoint, resolve
from circnav_mav.runtime.links import UdpLink

MULTICAST = "239.255.145.51"
"""Multicast group of the fleet."""
MOST_DATAGRAMS = 64
"""Largest number of datagrams processed in one step. At 5 Hz each, 255 members send this many in 50
ms."""
RETRY = 2.0
"""Time, s, between two attempts to open the socket."""

Datagram = tuple[bytes, Hashable]


class FleetLink:
    """Sends and receives reports as signed MAVLink frames."""

    def __init__(
        self,
        transport: "Transport | LocalPort",
        member: int,
        key: bytes | None = None,
        tolerance: float = CLOCK_TOLERANCE,
    ) -> None:
        """member: id of this member.
        key: the fleet's key, 32 bytes; None for unsigned frames.
        tolerance: largest accepted difference of clocks, s.
        """
        # The fleet link has its own `Signing`, apart from the vehicle's link: a member with a wrong
        # clock must not change the timestamp that signs commands to the autopilot.
        # 1: link id of signatures on the fleet link. The vehicle's link has 0.
        signing = None if key is None else Signing(key, link_id=1)
        self.acceptance = Acceptance(member, key, tolerance=tolerance)
        self.sent = 0
        self._transport = transport
        self._signing = signing
        self._encoder = Encoder(member, COMPONENT, signing)
        self._frames: list[bytes] = []
        self._sent_at = -inf

    def send(self, report: MemberReport) -> None:
        """Send a report, unless the last one was sent less than 0.2 s ago."""
        now = report.stamp
        # abs(): if the clock was set back, the last sending lies in the future, and sending must
        # not stop until then.
        # 0.2: shortest time between two reports of this member, s (5 Hz).
        # 0.01: time by which a report may be early, s, because the interval is not a multiple of
        # the loop step.
        if abs(now - self._sent_at) < 0.2 - 0.01:
            return
        try:
            check_numbers(report)
        except RejectedError as wrong:
            self.acceptance.note(Rejection.LINK, f"the report of this member: {wrong}", now)
            return
        self._sent_at = now
        if self._signing is not None:
            self._signing.update(now)
        frame = self._encoder.encode(to_message(report))
        # Remember the frame, because multicast also delivers it to this member.
        self.acceptance.remember(frame, now)
        if self._transport.send(frame, now):
            self.sent += 1
            self._record(frame)
        self._note_problems(now)

    def received(self, now: float) -> list[MemberReport]:
        """Return the reports accepted since the last call. now: Unix time, s; in lockstep the
        simulated time, s."""
        datagrams = self._transport.receive(now)
        self._note_problems(now)
        if len(datagrams) > MOST_DATAGRAMS:
            self.acceptance.note(
                Rejection.FLOOD, f"more than {MOST_DATAGRAMS} datagrams in a step", now
            )
        reports = []
        for data, address in datagrams[:MOST_DATAGRAMS]:
            if (report := self.acceptance.take(data, address, now)) is not None:
                reports.append(report)
                self._record(data)
        return reports

    def take_frames(self) -> list[bytes]:
        """Return all frames sent or accepted since the last call, for the recorder."""
        frames = self._frames
        self._frames = []
        return frames

    def alarms(self, now: float) -> list[str]:
        """Return the problems of the link, one line each."""
        return self.acceptance.alarms(now)

    def summary(self) -> dict[str, Any]:
        """Return the counts of the link for summary.json."""
        rejected = {
            reason.name.lower(): count for reason, count in self.acceptance.rejected.items()
        }
        return {
            "sent": self.sent,
            "accepted": self.acceptance.accepted,
            "copies": self.acceptance.copies,
            "rejected": rejected,
        }

    def close(self) -> None:
        """Close the transport."""
        self._transport.close()

    def _record(self, frame: bytes) -> None:
        # 4096: largest number of frames that wait for the recorder. Later frames are not recorded.
        if len(self._frames) < 4096:
            self._frames.append(without_signature(frame))

    def _note_problems(self, now: float) -> None:
        for problem in self._transport.problems:
            self.acceptance.note(Rejection.LINK, problem, now)


class Transport:
    """A UDP socket for the multicast group or for a list of peers. A socket that fails is closed
    and opened again.

    problems: problems of the newest call.
    """

    def __init__(self, port: int = PORT, interface: str = "", peers: Sequence[str] = ()) -> None:
        """interface: name or IPv4 address of the network interface for multicast, empty for the
        default route.
        peers: HOST:PORT of every other member. With peers, multicast is not used.

        Raises LinkError if an endpoint is invalid or in use. A missing network is not an error.
        """
        found = [_peer(text) for text in peers]
        families = {family for family, _ in found}
        if len(families) > 1:
            raise LinkError(
                f"fleet peers {', '.join(peers)}: use either IPv4 or IPv6 for all of them"
            )
        self.problems: list[str] = []
        self._where = "peers"
        self._open: Callable[[], UdpLink]
        self._targets: list[Any] = [address for _, address in found] or [(MULTICAST, port)]
        self._multicasts = not peers
        if peers:
            any_host = "::" if socket.AF_INET6 in families else "0.0.0.0"
            hosts = [address[0].partition("%")[0] for address in self._targets]
            self._open = partial(UdpLink, Endpoint("udpin", any_host, port), hosts)
        else:
            self._where = f"{MULTICAST} on {interface or 'the default interface'}"
            self._open = partial(MulticastLink, port, interface)
        self._link: UdpLink | None = None
        self._retry_at = self._received_at = -inf
        try:
            self._link = self._open()
        except OSError as error:
            if peers:
                raise LinkError(f"fleet link on port {port}: {explain(error)}") from None

    def send(self, frame: bytes, now: float) -> bool:
        """Send a frame to the group or to every peer. Return True if all were sent."""
        link = self._opened(now)
        if link is None:
            return False
        for target in self._targets:
            link.send(frame, target)
        self._take_problems(link)
        # Keep the socket if a peer is unreachable: the other peers still receive.
        if self.problems and self._multicasts:
            self._close(now)
        return not self.problems

    def receive(self, now: float) -> list[Datagram]:
        """Return the datagrams that have arrived."""
        link = self._opened(now)
        if link is None:
            return []
        datagrams = link.receive(now)
        self._take_problems(link)
        if datagrams or self._received_at == -inf:
            self._received_at = now
        # 5.0: time without any datagram after which a multicast socket is reopened, s. The socket
        # also receives this member's own datagrams, so silence is a fault: unplugging an interface
        # ends the group membership without an error.
        elif self._multicasts and abs(now - self._received_at) > 5.0:
            self._received_at = now
            self._close(now - RETRY)
        return datagrams

    def close(self) -> None:
        """Close the socket. It is not opened again."""
        self._close(inf)

    def _opened(self, now: float) -> UdpLink | None:
        """Return the socket. Reopen it if a retry is due."""
        if self._link is None and self._retry_at != inf and abs(now - self._retry_at) >= RETRY:
            self._retry_at = now
            try:
                self._link = self._open()
                self._received_at = now
                self.problems = []
            except OSError as error:
                self.problems = [f"{self._where}: {explain(error)}"]
        return self._link

    def _take_problems(self, link: UdpLink) -> None:
        """Move the problems of the socket to `problems`."""
        self.problems = [f"{self._where}: {trouble}" for trouble in link.troubles]
        link.troubles.clear()

    def _close(self, now: float) -> None:
        self._retry_at = now
        if self._link is not None:
            self._link.close()
        self._link = None


class MulticastLink(UdpLink):
    """UDP socket of the multicast group. Datagrams to other addresses of this computer are not
    received."""

    def __init__(self, port: int, interface: str) -> None:
        """Raises OSError."""
        self._interface = interface
        super().__init__(Endpoint("udpin", MULTICAST, port), ())

    def _bind(self, address: Any) -> None:
        opened = self._socket
        membership = _membership(self._interface)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind(address)
        # Time to live 1: no router forwards the datagram.
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
        # Without this option, Linux also delivers datagrams from interfaces on which another
        # program joined the group.
        if sys.platform == "linux":
            # Linux socket option IP_MULTICAST_ALL, which Python does not define.
            opened.setsockopt(socket.IPPROTO_IP, 49, 0)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
        if self._interface:
            opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, membership)


class LocalNetwork:
    """Simulated network of a fleet in lockstep, within one process. It drops and delays frames,
    reproducibly for each seed.

    cut: addresses that neither send nor receive.
    """

    def __init__(self, loss: float = 0.0, delay: float = 0.0, seed: int = 0) -> None:
        """loss: share of frames lost at each receiver. delay: delay of each frame, s."""
        self.cut: set[Hashable] = set()
        self._loss = loss
        self._delay = delay
        self._random = Random(f"{seed}:fleet link")
        self._ports: list[LocalPort] = []

    def port(self, address: Hashable) -> "LocalPort":
        """Return a new port at an address."""
        self._ports.append(LocalPort(self, address))
        return self._ports[-1]

    def deliver(self, frame: bytes, sender: "LocalPort", now: float) -> None:
        """Send a frame to every other port, unless it is lost."""
        for port in self._ports:
            lost = self._random.random() < self._loss
            if port is not sender and not lost and not {port.address, sender.address} & self.cut:
                port.under_way.append((now + self._delay, frame, sender.address))


@dataclass(eq=False)
class LocalPort:
    """A port of a `LocalNetwork`.

    under_way: time of arrival, frame and sender of each datagram.
    """

    network: LocalNetwork
    address: Hashable
    under_way: list[tuple[float, bytes, Hashable]] = field(default_factory=list)
    problems: Sequence[str] = ()

    def send(self, frame: bytes, now: float) -> bool:
        """Send a frame to every other port."""
        self.network.deliver(frame, self, now)
        return True

    def receive(self, now: float) -> list[Datagram]:
        """Return the datagrams that have arrived."""
        arrived = [(frame, sender) for due, frame, sender in self.under_way if due <= now]
        self.under_way = [one for one in self.under_way if one[0] > now]
        return arrived

    def close(self) -> None:
        """Do nothing."""


def _peer(text: str) -> tuple[socket.AddressFamily, Any]:
    """Return the family and address of a peer. Raises LinkError."""
    try:
        return resolve(parse_endpoint(f"udpout:{text}"))
    except LinkError:
        raise LinkError(f"fleet peer {text!r}: write HOST:PORT, such as 10.0.0.12:{PORT}") from None
    except (OSError, UnicodeError) as error:
        raise LinkError(f"fleet peer {text}: {explain(error)}") from None


def _membership(interface: str) -> bytes:
    """Return the kernel's ip_mreqn: the group, and the interface by address or number. Raises
    OSError."""
    address = "0.0.0.0"
    number = 0
    if interface:
        try:
            address = str(ip_address(interface))
        except ValueError:
            number = socket.if_nametoindex(interface)
    return struct.pack("=4s4si", socket.inet_aton(MULTICAST), socket.inet_aton(address), number)
