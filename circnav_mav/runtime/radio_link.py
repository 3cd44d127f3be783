"""Link to a ranging radio with a driver. Each reading becomes a RANGING_BEACON frame, so that it
passes the same checks, log and replay as ranges over MAVLink."""

import re
from collections import Counter
from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from math import isfinite, nan
from typing import Any

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Encoder
from circnav_mav.mav.identity import host_of
from circnav_mav.mav.ranging.driver import (
    FAILURES,
    Driver,
    DriverError,
    RadioReading,
    make_driver,
    split_driver,
)
from circnav_mav.runtime.endpoint import LinkError, parse_endpoint
from circnav_mav.runtime.links import Link, note, open_link

# MAVLink ids of the frames with a driver's readings. docs/own-vehicle.md uses the same ids for a
# radio on the companion computer.
SYSTEM = 1
COMPONENT = dialect.MAV_COMP_ID_ONBOARD_COMPUTER2
UNKNOWN = 0xFFFFFFFF
"""UINT32_MAX: unknown range, sigma or altitude in RANGING_BEACON."""
NO_PLACE = 0x7FFFFFFF
"""INT32_MAX: unknown latitude or longitude in RANGING_BEACON."""
MOST_WORDS = 200
"""Largest number of characters that are kept of a driver's error message, which may quote the whole
input."""
WATCHED = 2.0
"""Time without a reading, s, after which the received bytes are examined."""
MANY = 64
"""Number of bytes that the driver cannot decode, within WATCHED, from which a wrong baud rate is
reported."""
SHOWN = 24
"""Number of undecoded bytes that are shown to the operator."""
MOST_SENDERS = 8
"""Largest number of senders for which a driver is stored, and of hosts whose bytes are examined.
Senders of UDP datagrams are distinguished by address and port."""
LINE_ENDS = (b"\n", b"\r")
BATCH = (
    "several ranges without a time arrive at once: only the newest is used. Send each range when it"
    " is measured, or with its time"
)
"""Message about a radio that collects several ranges before it sends them."""


IN_A_ROW = 10
"""Number of failures in a row after which a method of a driver is called only once per PAUSE. A
single damaged frame causes no pause. A driver with an error in its code fails 50 times a second."""
PAUSE = 1.0
"""Time between two calls of a method that fails, s."""


class _Method:
    """Method of a driver that may fail. After IN_A_ROW failures the method is due once per PAUSE,
    until it succeeds."""

    def __init__(self) -> None:
        self._failures = 0
        self._due = float("-inf")

    def is_due(self, now: float) -> bool:
        return now >= self._due

    def succeeded(self) -> None:
        self._failures = 0

    def failed(self, now: float) -> None:
        self._failures += 1
        if self._failures >= IN_A_ROW:
            self._due = now + PAUSE


@dataclass(slots=True)
class _Sender:
    """State of the bytes from one address.

    between_lines: True if the newest bytes ended with a line end, so that the driver keeps no part
        of a line.
    """

    driver: Driver
    between_lines: bool = False


@dataclass(slots=True)
class _Host:
    """Bytes of one host since its last reading.

    since: time of the last reading or report, s.
    tail: newest bytes.
    unread: number of bytes that no driver could decode.
    """

    since: float
    tail: bytes = b""
    unread: int = 0


class RadioLink:
    """Link that returns the readings of a driver as frames."""

    def __init__(self, name: str, driver: Driver, link: Link) -> None:
        self.troubles: Counter[str] = link.troubles
        self._name = name
        self._driver = driver
        self._senders: dict[Hashable, _Sender] = {}
        """State of each address. Each address has a driver of its own, because parts of lines from
        two senders must not be joined."""
        self._hosts: dict[Hashable, _Host] = {}
        self._link = link
        self._encoder = Encoder(SYSTEM, COMPONENT)
        self._sequence = 0
        self._asking = _Method()
        self._reading = _Method()
        self._reads = 0
        self._batches = 0

    def fileno(self) -> int | None:
        return self._link.fileno()

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """Return a frame for each new reading."""
        return [(self._frame(reading), source) for reading, source in self.read(now)]

    def read(self, now: float) -> list[tuple[RadioReading, Hashable]]:
        """Return the new readings with their sources. If the driver raises, count a trouble and
        drop the bytes passed to it."""
        self._ask(now)
        # Read even if `ask` raised: bytes that remain in the socket would wake the loop again at
        # once.
        readings = [
            (reading, source)
            for data, source in self._link.receive(now)
            if self._reading.is_due(now)
            for reading in self._decode(data, source, now)
        ]
        # Of several ranges of a beacon without a time, return only the newest: the times of the
        # others are unknown.
        last = {(host_of(source), one.beacon): one for one, source in readings}
        return [
            (one, source)
            for one, source in readings
            if one.stamp is not None or one is last[host_of(source), one.beacon]
        ]

    def _ask(self, now: float) -> None:
        """Send the driver's request to the radio, if any."""
        if not self._asking.is_due(now):
            return
        try:
            if words := self._driver.ask(now):
                self._link.send(words, None)
            self._asking.succeeded()
        except FAILURES as error:
            self._failed(error, self._asking, now)

    def _decode(self, data: bytes, source: Hashable, now: float) -> list[RadioReading]:
        """Return the readings in the bytes from an address."""
        sender = self._sender(source)
        before = sender.driver.unread
        found: list[RadioReading] = []
        try:
            for reading in sender.driver.receive(data, now):
                if not isinstance(reading, RadioReading):
                    raise TypeError(f"{reading!r} is not a RadioReading")
                found.append(reading)
            self._reading.succeeded()
        except FAILURES as error:
            self._failed(error, self._reading, now)
        sender.between_lines = data.endswith(LINE_ENDS)
        if found:
            if hint := getattr(sender.driver, "hint", ""):
                self.troubles[hint] += 1
            self._count_batch(found)
        self._watch(source, data, sender.driver.unread - before, bool(found), now)
        return found

    def _sender(self, source: Hashable) -> _Sender:
        """Return the state of an address.

        An ESP8266 or a script may open a new socket, with a new port, for each datagram. A new port
        of a known host continues the text of a port that ended with a line end: otherwise the first
        line of every port would be taken for the rest of a lost line.
        """
        if source in self._senders:
            return self._senders[source]
        host = host_of(source)
        for other, sender in self._senders.items():
            if sender.between_lines and host_of(other) == host:
                self._senders[source] = self._senders.pop(other)
                return sender
        sender = _Sender(type(self._driver)() if self._senders else self._driver)
        self._senders[source] = sender
        _forget_oldest(self._senders)
        return sender

    def _count_batch(self, readings: list[RadioReading]) -> None:
        """Count a trouble if most datagrams, or reads of a stream, contain several readings of a
        beacon without a time."""
        unstamped = [one.beacon for one in readings if one.stamp is None]
        self._reads += 1
        self._batches += len(set(unstamped)) < len(unstamped)
        # 10: number of reads that are judged together. A stall of this computer joins the lines of
        # a few reads of a stream.
        if self._reads >= 10:
            if self._batches > self._reads / 2:
                self.troubles[BATCH] += 1
            self._reads = self._batches = 0

    def send(self, data: bytes, to: Hashable) -> None:
        """Do nothing: a radio with a driver does not use MAVLink."""

    def close(self) -> None:
        self._link.close()

    def _failed(self, error: BaseException, method: _Method, now: float) -> None:
        method.failed(now)
        failed = f"driver {self._name} failed"
        note(self.troubles, f"{failed}: {error!r:.{MOST_WORDS}}", f"{failed} with other errors")

    def _watch(
        self, source: Hashable, data: bytes, unread: int, received: bool, now: float
    ) -> None:
        """Count a trouble if bytes of a host arrive without a range. The cause is probably a wrong
        baud rate, a wrong driver or another text format."""
        key = host_of(source)
        host = self._hosts.get(key)
        if host is None or received:
            host = self._hosts[key] = _Host(now)
            _forget_oldest(self._hosts)
        if received:
            return
        host.tail = (host.tail + data)[-MOST_WORDS:]
        host.unread += unread
        if now - host.since < WATCHED:
            return
        of = f", from {key}" if isinstance(source, tuple) else ""
        reported = self._report_text(host, data, of) or self._report_bytes(host, of)
        if reported or len(host.tail) >= MANY:
            self._hosts[key] = _Host(now)

    def _report_text(self, host: _Host, data: bytes, of: str) -> bool:
        """Count a trouble, and return True, if a host sends text that the driver cannot read."""
        text, has_end = _text(host.tail)
        # Each datagram of a new port begins with the line end of the datagram before. Its line
        # would be read one datagram late.
        ends_first = has_end and data.startswith(LINE_ENDS)
        if not text or (has_end and not host.unread and not ends_first):
            return False
        unreadable = f"received text is no {self._name} data"
        end = "" if has_end else " (without a line end)"
        if ends_first:
            end = " (its line end comes first: send the line end after the line)"
        note(self.troubles, f"{unreadable}: {text!r}{end}{of}", f"{unreadable}, other lines")
        return True

    def _report_bytes(self, host: _Host, of: str) -> bool:
        """Count a trouble, and return True, if a host sends bytes that are no text for the
        driver."""
        if host.unread < MANY and not _ends_with_nul(host.tail):
            return False
        shown = f"received bytes are no {self._name} data"
        why = "wrong baud rate, driver or output of the radio?"
        # Name the bytes once: later bytes of a wrong baud rate are always different.
        words = next((one for one in self.troubles if one.startswith(shown)), None)
        self.troubles[words or f"{shown}: {host.tail[:SHOWN]!r}{of}: {why}"] += 1
        return True

    def _frame(self, reading: RadioReading) -> bytes:
        self._sequence = (self._sequence + 1) % 256
        stamp = reading.stamp
        # 1e12: largest timestamp that is forwarded, s. A larger timestamp is invalid.
        return self._encoder.encode(
            dialect.MAVLink_ranging_beacon_message(
                round(stamp * 1e6) if stamp is not None and 0 < stamp < 1e12 else 0,
                0,
                0,
                reading.beacon,
                _millimetres(reading.range),
                NO_PLACE,
                NO_PLACE,
                nan,
                0,
                UNKNOWN,
                UNKNOWN,
                0,
                _millimetres(reading.sigma),
                self._sequence,
                0,
            )
        )


def _forget_oldest(table: dict[Hashable, Any]) -> None:
    """Bound the memory that a flood of addresses can use."""
    if len(table) > MOST_SENDERS:
        del table[next(iter(table))]


def _text(data: bytes) -> tuple[str, bool]:
    """Return the newest complete line of the bytes and True. Without a line end, return all bytes
    and False. The text is empty for bytes that are no text, and for less than MANY bytes without a
    line end."""
    *lines, rest = re.split(rb"[\r\n]+", data)
    lines = [line for line in lines if line]
    has_end = bool(lines)
    line = (lines[-1] if has_end else rest).decode("latin-1")
    is_long = has_end or len(rest) >= MANY
    return line if is_long and _is_text(line) else "", has_end


def _ends_with_nul(data: bytes) -> bool:
    """True if the bytes are text whose lines end with NUL, as some programs in C send them."""
    return data.count(b"\0") >= 2 and _is_text(data.replace(b"\0", b"").decode("latin-1"))


def _is_text(text: str) -> bool:
    return text.isascii() and re.sub(r"[\t\r\n]", " ", text).isprintable()


def _millimetres(metres: float | None) -> int:
    """Return a length in mm for RANGING_BEACON, UNKNOWN for None."""
    if metres is None or not isfinite(metres) or metres <= 0:
        return UNKNOWN
    return round(min(1000 * metres, UNKNOWN - 1))


def radio_port(endpoint: str) -> tuple[str, Driver, str]:
    """Return driver name, driver and link endpoint of an endpoint such as `linktrack:/dev/ttyUSB0`.
    A device without a baud rate uses the baud rate of the driver. Raises LinkError."""
    name, port = split_driver(endpoint)
    if name is None:
        raise LinkError(f"endpoint {endpoint!r}: has no driver, write it as linktrack:/dev/ttyUSB0")
    try:
        driver = make_driver(name)
    except DriverError as error:
        raise LinkError(f"endpoint {endpoint!r}: {error}") from None
    if port.startswith("/"):
        port = f"serial:{port}"
        if not port.rpartition(":")[2].isdecimal():
            port += f":{driver.baud}"
    parse_endpoint(port)
    return name, driver, port


def open_radio(endpoint: str, peers: Iterable[str] = ()) -> RadioLink:
    """Open the port of a radio. peers: addresses and networks that `udpin` accepts, empty for all.
    Raises LinkError."""
    name, driver, port = radio_port(endpoint)
    return RadioLink(name, driver, open_link(port, peers))
