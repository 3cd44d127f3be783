"""Link to a ranging radio with a driver. Each reading becomes a RANGING_BEACON frame, so that it
passes the same checks, log and replay as ranges over MAVLink."""

import re
from collections import Counter
from collections.abc import Hashable, Iterable
from math import isfinite, nan

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Encoder
from circnav_mav.mav.identity import address_text
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

SYSTEM = 1
COMPONENT = dialect.MAV_COMP_ID_ONBOARD_COMPUTER2
"""MAVLink ids of the frames with a driver's readings. docs/own-vehicle.md uses the same ids for a
radio on the companion computer."""
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
"""Number of undecoded bytes in this time from which a wrong baud rate is reported."""


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
        self._due = float("-inf")

    def failed(self, now: float) -> None:
        self._failures += 1
        if self._failures >= IN_A_ROW:
            self._due = now + PAUSE


class RadioLink:
    """Link that returns the readings of a driver as frames. Each beacon is a separate source."""

    def __init__(self, name: str, driver: Driver, link: Link) -> None:
        self.troubles: Counter[str] = link.troubles
        self._name = name
        self._driver = driver
        self._drivers: dict[Hashable, Driver] = {}
        """Driver of each sender. Each sender has a driver of its own, because parts of lines from
        two senders must not be joined."""
        self._link = link
        self._encoder = Encoder(SYSTEM, COMPONENT)
        self._sequence = 0
        self._since: float | None = None
        self._unread = 0
        self._asking = _Method()
        self._reading = _Method()
        self._tail = b""
        """Newest bytes since the last reading."""

    def fileno(self) -> int | None:
        return self._link.fileno()

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """Return a frame for each new reading."""
        return [
            (self._frame(reading), f"{address_text(source)} beacon {reading.beacon}")
            for reading, source in self.read(now)
        ]

    def read(self, now: float) -> list[tuple[RadioReading, Hashable]]:
        """Return the new readings with their sources. If the driver raises, count a trouble and
        drop the bytes passed to it."""
        readings: list[tuple[RadioReading, Hashable]] = []
        if self._asking.is_due(now):
            try:
                if words := self._driver.ask(now):
                    self._link.send(words, None)
                self._asking.succeeded()
            except FAILURES as error:
                self._failed(error, self._asking, now)
        # Read even if `ask` raised: bytes that remain in the socket would wake the loop again at
        # once.
        for data, source in self._link.receive(now):
            if not self._reading.is_due(now):
                continue
            self._tail = (self._tail + data)[-MOST_WORDS:]
            try:
                for reading in self._driver_of(source).receive(data, now):
                    if not isinstance(reading, RadioReading):
                        raise TypeError(f"{reading!r} is not a RadioReading")
                    readings.append((reading, source))
                self._reading.succeeded()
            except FAILURES as error:
                self._failed(error, self._reading, now)
        self._watch(bool(readings), now)
        return readings

    def _driver_of(self, source: Hashable) -> Driver:
        """Return the driver for the bytes of a sender."""
        if source in self._drivers:
            return self._drivers[source]
        driver = type(self._driver)() if self._drivers else self._driver
        # 8: largest number of senders with a stored driver.
        if len(self._drivers) < 8:
            self._drivers[source] = driver
        return driver

    def send(self, data: bytes, to: Hashable) -> None:
        """Do nothing: a radio with a driver does not use MAVLink."""

    def close(self) -> None:
        self._link.close()

    def _failed(self, error: BaseException, method: _Method, now: float) -> None:
        method.failed(now)
        failed = f"driver {self._name} failed"
        note(self.troubles, f"{failed}: {error!r:.{MOST_WORDS}}", f"{failed} with other errors")

    def _watch(self, received: bool, now: float) -> None:
        """Count a trouble if bytes arrive without a range. The cause is probably a wrong baud rate,
        a wrong driver or another text format."""
        if not received and self._since is not None:
            if now - self._since < WATCHED:
                return
            unread = self._driver.unread - self._unread
            text, has_end = _text(self._tail)
            if text and (unread or not has_end):
                unreadable = f"received text is no {self._name} data"
                end = "" if has_end else " (without a line end)"
                note(self.troubles, f"{unreadable}: {text!r}{end}", f"{unreadable}, other lines")
            elif unread >= MANY:
                why = "wrong baud rate, driver or output of the radio?"
                self.troubles[f"received bytes are no {self._name} data: {why}"] += 1
        self._since = now
        self._unread = self._driver.unread
        self._tail = b""

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


def _text(data: bytes) -> tuple[str, bool]:
    """Return the newest complete line of the bytes and True. Without a line end, return all bytes
    and False. The text is empty for bytes that are no text, and for less than MANY bytes without a
    line end."""
    *lines, rest = re.split(rb"[\r\n]+", data)
    has_end = bool(lines)
    line = (lines[-1] if has_end else rest).decode("latin-1")
    is_text = line.isascii() and line.replace("\t", " ").isprintable()
    is_long = has_end or len(rest) >= MANY
    return line if is_text and is_long else "", has_end


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
        port = (
            f"serial:{port}"
            if port.rpartition(":")[2].isdecimal()
            else f"serial:{port}:{driver.baud}"
        )
    parse_endpoint(port)
    return name, driver, port


def open_radio(endpoint: str, peers: Iterable[str] = ()) -> RadioLink:
    """Open the port of a radio. peers: addresses and networks that `udpin` accepts, empty for all.
    Raises LinkError."""
    name, driver, port = radio_port(endpoint)
    return RadioLink(name, driver, open_link(port, peers))
