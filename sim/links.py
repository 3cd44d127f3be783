"""The autopilot's links: bytes to MAVLink messages and back, and forwarding between links.

Each link has its own parser and sequence counter. Invalid bytes are dropped without an error.
Forwarding follows ArduPilot's MAVLink_routing.cpp.
"""

import struct
from collections import deque
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from .signing import FrameSigning

NEVER_FORWARDED = frozenset({"RADIO_STATUS", "RADIO", "ADSB_VEHICLE", "SETUP_SIGNING"})
MOST_ROUTES = 20
MOST_WAITING = 50_000
TYPE_GCS = 6
V1_LARGEST_ID = 255
V2_MARKER = 0xFD

Message = Any
"""A pymavlink message: its fields are attributes that the dialect defines."""
Address = tuple[int, int]


class Link:
    """One link of the autopilot: its parser, its frames to send, and its message intervals."""

    def __init__(
        self, name: str, system: int, component: int, version: int, signing: FrameSigning
    ) -> None:
        self.name = name
        self._version = version
        self._signing = signing
        self._in = mavlink.MAVLink(None)
        self._in.robust_parsing = True
        self._out = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.waiting: deque[bytes] = deque(maxlen=MOST_WAITING)
        self.intervals: dict[int, int] = {}  # message id -> microseconds
        self.has_gcs = False
        self.silent = False

    def messages(self, data: bytes, *, stream: bool) -> list[Message]:
        """Return the messages in bytes. A datagram resets the parser, so that a stray byte does not
        consume later frames. A piece of a stream does not reset it."""
        if not stream:
            self._in.buf = bytearray()
            self._in.buf_index = 0
            self._in.expected_length = 8
        return [message for message in self._in.parse_buffer(data) or [] if self._readable(message)]

    def _readable(self, message: Message) -> bool:
        """True if the frame is intact and has a known id. A MAVLink 1 autopilot reads no MAVLink 2
        frames."""
        return message.get_msgId() >= 0 and (
            self._version == 2 or message.get_msgbuf()[0] != V2_MARKER
        )

    def frame(self, message: Message) -> bytes | None:
        """Return the next frame of this sender. None if the message does not exist in this MAVLink
        version, or a value does not fit its field."""
        if self._version == 1 and message.get_msgId() > V1_LARGEST_ID:
            return None
        self._signing.prepare(self._out)
        try:
            data: bytes = message.pack(self._out, force_mavlink1=self._version == 1)
        except (
            struct.error,
            OverflowError,
        ):
            # The vehicle is so far away that a value does not fit its field.
            return None
        self._out.seq = (self._out.seq + 1) % 256
        return data

    def send(self, message: Message | None) -> None:
        """Queue a message, if there is one."""
        frame = None if message is None else self.frame(message)
        if frame is not None and not self.silent:
            self.waiting.append(frame)

    def forward(self, message: Message) -> None:
        """Queue the unchanged frame of another sender."""
        if not self.silent:
            self.waiting.append(bytes(message.get_msgbuf()))

    def drain(self) -> list[bytes]:
        frames = list(self.waiting)
        self.waiting.clear()
        return frames


class Router:
    """Router: learns the link of each sender and forwards messages. A component receives messages
    only after it has sent one."""

    def __init__(self, own: Address, unknown_ids: frozenset[int], adopts_strays: bool) -> None:
        self._own = own
        self._adopts_strays = adopts_strays
        self._unknown = unknown_ids
        self._routes: list[tuple[Address, Link]] = []

    def forget(self) -> None:
        self._routes.clear()

    def pass_on(self, message: Message, source: Link, links: list[Link]) -> bool:
        """Forward a message received on `source`. Return True if the autopilot has to handle it,
        too."""
        kind = message.get_type()
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if message.get_msgId() in self._unknown:
            return False
        if sender == self._own:
            return True
        self._learn(sender, source)
        if kind == "HEARTBEAT":
            self._forward_heartbeat(message, sender, source, links)
            return True
        if kind in NEVER_FORWARDED:
            return True
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        mine = system in (0, self._own[0])
        if mine and component == self._own[1] and system != 0:
            return True
        forwarded = self._forward(message, source, system, component)
        if not mine:
            return False
        return component in (0, self._own[1]) or (self._adopts_strays and not forwarded)

    def _learn(self, sender: Address, source: Link) -> None:
        known = any(address == sender and link is source for address, link in self._routes)
        if not known and sender[0] != 0 and len(self._routes) < MOST_ROUTES:
            self._routes.append((sender, source))

    def _forward(self, message: Message, source: Link, system: int, component: int) -> bool:
        reached: list[Link] = []
        for (to_system, to_component), link in self._routes:
            right_component = component in (0, to_component) or system != self._own[0]
            if (
                link is source
                or link in reached
                or not (system == 0 or (system == to_system and right_component))
            ):
                continue
            link.forward(message)
            reached.append(link)
        return bool(reached)

    def _forward_heartbeat(
        self, message: Message, sender: Address, source: Link, links: list[Link]
    ) -> None:
        known = [link for address, link in self._routes if address == sender]
        for link in links:
            if link is not source and link not in known:
                link.forward(message)
