"""Carrier of the fleet's reports between companion computers, on a separate socket, never through
an autopilot.

Transport: UDP multicast, or a list of peers. An open carrier never blocks and never raises: a
network failure raises an alarm and is retried. The carrier reads no clock: it uses the stamp of
this member's report, and the argument `now` of `received`.
"""

import socket
import struct
import sys
from collections.abc import Hashable, Sequence
from contextlib import suppress
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
from circnav_mav.extras.fleet.frames import COMPONENT, LONGEST_FRAME, to_message
from circnav_mav.extras.fleet.report import MemberReport
from circnav_mav.mav.codec import Encoder
from circnav_mav.mav.signing import Signing, without_signature
from circnav_mav.runtime.endpoint import LinkError, explain, parse_endpoint, resolve

MULTICAST = "239.255.145.51"
"""Multicast group of the fleet."""
PORT = 14560
"""UDP port of the fleet, next to the usual ports of ground stations."""
MOST_DATAGRAMS = 64
"""Largest number of datagrams read in one step. At 5 Hz each, 255 members send this many in 50
ms."""
RECEIVE_BUFFER = 1 << 16
"""Receive buffer of the socket, bytes. Linux doubles it, so that it holds about 170 reports. A
longer queue would only delay reports."""
RETRY = 2.0
"""Time, s, between two attempts to open the socket."""
PROBLEM_LASTS = 5.0
"""Time, s, for which a problem is reported after it last occurred."""

Datagram = tuple[bytes, Hashable]


class FrameCarrier:
    """Sends and receives reports as signed MAVLink frames over a port."""

    def __init__(
        self,
        port: "UdpPort | LocalPort",
        group: int,
        member: int,
        key: bytes | None = None,
        tolerance: float = CLOCK_TOLERANCE,
    ) -> None:
        """group, member: ids of this member.
        key: the fleet's key, 32 bytes; None for unsigned frames.
        tolerance: largest accepted difference of clocks, s.
        """
        # Not the `Signing` of the vehicle's link: a member with a wrong clock must not change the
        # timestamp that signs commands to the autopilot.
        # 1: link id of signatures on the fleet link. The vehicle's link has 0.
        signing = None if key is None else Signing(key, link_id=1)
        self.acceptance = Acceptance(group, member, key, hosts=port.hosts, tolerance=tolerance)
        self.sent = 0
        self._port = port
        self._signing = signing
        self._ids = group, member
        self._encoder = Encoder(member, COMPONENT, signing)
        self._frames: list[bytes] = []
        self._sent_at = -inf
        self._problem = ""
        self._problem_at = -inf

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
            if (report.group, report.member) != self._ids:
                raise RejectedError(
                    Rejection.OUT_OF_BOUNDS,
                    f"ids {report.group}, {report.member} are not those of this member",
                )
            check_numbers(report)
        except RejectedError as wrong:
            self._note(f"this member's report is not sent: {wrong}", now)
            return
        self._sent_at = now
        if self._signing is not None:
            self._signing.follow(now)
        frame = self._encoder.encode(to_message(report))
        # Multicast sends this frame back to this member.
        self.acceptance.remember(frame, now)
        if problem := self._port.send(frame, now):
            self._note(problem, now)
        else:
            self.sent += 1
            self._record(frame)

    def received(self, now: float) -> list[MemberReport]:
        """Return the reports accepted since the last call. now: Unix time, s; in lockstep the
        simulated time, s."""
        datagrams = self._port.receive(MOST_DATAGRAMS, now)
        if len(datagrams) == MOST_DATAGRAMS:
            self.acceptance.note(
                Rejection.FLOOD, f"more than {MOST_DATAGRAMS} datagrams in a step", now
            )
        reports = []
        for data, address in datagrams:
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
        problem = (
            [f"fleet link: {self._problem}"] if abs(now - self._problem_at) <= PROBLEM_LASTS else []
        )
        return problem + self.acceptance.alarms(now)

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
        """Close the port."""
        self._port.close()

    def _record(self, frame: bytes) -> None:
        # 4096: largest number of frames that wait for the recorder. Later frames are not recorded.
        if len(self._frames) < 4096:
            self._frames.append(without_signature(frame))

    def _note(self, problem: str, now: float) -> None:
        self._problem = problem
        self._problem_at = now


class UdpPort:
    """A UDP socket: multicast, or a list of peers. A socket that fails is closed and opened
    again."""

    def __init__(self, port: int = PORT, interface: str = "", peers: Sequence[str] = ()) -> None:
        """interface: name or IPv4 address of the network interface for multicast, empty for the
        default route.
        peers: HOST:PORT of every other member. With peers, multicast is not used.

        Raises LinkError if an endpoint is invalid or in use. A missing network is not an error.
        """
        self._port = port
        self._interface = interface
        self._peers = [_peer(text) for text in peers]
        if len({family for family, _ in self._peers}) > 1:
            raise LinkError(
                f"fleet peers {', '.join(peers)}: use either IPv4 or IPv6 for all of them"
            )
        # Addresses of allowed senders, None for all senders.
        self.hosts = frozenset(address[0] for _, address in self._peers) if self._peers else None
        self._socket: socket.socket | None = None
        self._retry_at = self._received_at = -inf
        self._problem: str | None = None
        try:
            self._socket = self._open()
        except OSError as error:
            if self._peers:
                raise LinkError(f"fleet link on port {port}: {explain(error)}") from None
            self._problem = self._explain(error)

    def send(self, frame: bytes, now: float) -> str | None:
        """Send a frame to the group or to every peer. Return the problem, or None."""
        opened = self._opened(now)
        if opened is None:
            return self._problem
        self._problem = None
        for address in [address for _, address in self._peers] or [(MULTICAST, self._port)]:
            try:
                opened.sendto(frame, address)
            except OSError as error:
                self._problem = self._explain(error)
        # Keep the socket if a peer is unreachable: the other peers still receive.
        if self._problem and not self._peers:
            self._close(now)
        return self._problem

    def receive(self, most: int, now: float) -> list[Datagram]:
        """Return at most this number of datagrams that have arrived."""
        datagrams: list[Datagram] = []
        opened = self._opened(now)
        for _ in range(most if opened else 0):
            assert opened is not None
            try:
                datagrams.append(opened.recvfrom(LONGEST_FRAME + 1))
            except BlockingIOError:
                break
            except OSError as error:  # a peer without a socket on its port is reported by ICMP
                self._problem = self._explain(error)
        if datagrams or self._received_at == -inf:
            self._received_at = now
        # 5.0: time without any datagram after which a multicast socket is reopened, s. The socket
        # also receives this member's own datagrams, so silence is a fault: unplugging an interface
        # ends the group membership without an error.
        elif not self._peers and abs(now - self._received_at) > 5.0:
            self._received_at = now
            self._close(now - RETRY)
        return datagrams

    def close(self) -> None:
        """Close the socket. It is not opened again."""
        self._close(inf)

    def _opened(self, now: float) -> socket.socket | None:
        """Return the socket. Reopen it if a retry is due."""
        if self._socket is None and self._retry_at != inf and abs(now - self._retry_at) >= RETRY:
            self._retry_at = now
            try:
                self._socket = self._open()
                self._received_at = now
            except OSError as error:
                self._problem = self._explain(error)
        return self._socket

    def _close(self, now: float) -> None:
        self._retry_at = now
        if self._socket is not None:
            with suppress(OSError):
                self._socket.close()
        self._socket = None

    def _open(self) -> socket.socket:
        """Return a bound nonblocking socket. Raises OSError."""
        family = self._peers[0][0] if self._peers else socket.AF_INET
        opened = socket.socket(family, socket.SOCK_DGRAM)
        try:
            opened.setblocking(False)
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
            if self._peers:
                opened.bind(("", self._port))
            else:
                self._join(opened)
        except OSError:
            opened.close()
            raise
        return opened

    def _join(self, opened: socket.socket) -> None:
        """Bind the socket to the group and join the group. Datagrams to other addresses of this
        computer are then not received."""
        membership = _membership(self._interface)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind((MULTICAST, self._port))
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

    def _explain(self, error: OSError) -> str:
        where = (
            "peers"
            if self._peers
            else f"{MULTICAST} on {self._interface or 'the default interface'}"
        )
        return f"reports can be neither sent to nor received from {where}: {explain(error)}"


class LocalNetwork:
    """Simulated network of a fleet in lockstep, within one process. It drops and delays frames,
    reproducibly for each seed."""

    def __init__(self, loss: float = 0.0, delay: float = 0.0, seed: int = 0) -> None:
        """loss: share of frames lost at each receiver. delay: delay of each frame, s."""
        self.cut: set[Hashable] = set()
        """Addresses that neither send nor receive."""
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


class LocalPort:
    """A port of a `LocalNetwork`."""

    hosts: frozenset[str] | None = None

    def __init__(self, network: LocalNetwork, address: Hashable) -> None:
        self.under_way: list[tuple[float, bytes, Hashable]] = []
        """Time of arrival, frame and sender of each datagram."""
        self.address = address
        self._network = network

    def send(self, frame: bytes, now: float) -> str | None:
        """Send a frame to every other port."""
        self._network.deliver(frame, self, now)
        return None

    def receive(self, most: int, now: float) -> list[Datagram]:
        """Return at most this number of datagrams that have arrived. The rest is lost, as in a full
        socket."""
        arrived = [(frame, sender) for due, frame, sender in self.under_way if due <= now]
        self.under_way = [one for one in self.under_way if one[0] > now]
        return arrived[:most]

    def close(self) -> None:
        """Discard all waiting datagrams."""
        self.under_way.clear()


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
