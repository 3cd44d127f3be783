"""Drivers of ranging radios: interface, and installed drivers by name (entry points
`circnav.ranging`)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any, Protocol

from circnav_mav.installed import find_entry_point, installed_entry_points

MOST_BEACON = 65535
"""Largest beacon id: 16 bits, as in RANGING_BEACON."""
GROUP = "circnav.ranging"
TRANSPORTS = ("udp", "udpin", "udpout", "tcp", "tcpout", "serial", "sim")
"""Prefixes of MAVLink endpoints, which cannot be names of drivers."""
FAILURES = (Exception, SystemExit)
"""Exceptions of drivers that circnav handles. Even a driver that calls sys.exit() must not end the
flight without a safe setpoint.
"""
ATTRIBUTES: dict[str, Any] = {
    "baud": int,
    "unread": int,
    "receive": Callable,
    "ask": Callable,
}
"""Attributes that a driver must have, with their types."""


@dataclass(frozen=True, slots=True)
class RadioReading:
    """One measured range.

    range: slant range, m; a value that is not finite or not above 0 means no measurement.
    beacon: id of the radio at the far end of the measured range.
    sigma: standard deviation, m, None if the radio reports none.
    stamp: measurement time, s of the radio's own clock, None for the arrival time.
    """

    range: float
    beacon: int = 0
    sigma: float | None = None
    stamp: float | None = None

    def __post_init__(self) -> None:
        for value in (self.range, self.sigma or 0.0, self.stamp or 0.0):
            if not isinstance(value, Real):
                raise TypeError(f"{value!r} is not a number")
        if not isinstance(self.beacon, Integral):
            raise TypeError(f"beacon id {self.beacon!r} is not a whole number")
        if not 0 <= self.beacon <= MOST_BEACON:
            raise ValueError(f"beacon id {self.beacon} is not 0 to {MOST_BEACON}")


class Driver(Protocol):
    """Driver of one radio on one port. Times are seconds of circnav's clock. A driver must not read
    any other clock.

    baud: baud rate of the serial port if the endpoint specifies none.
    unread: number of bytes so far that could not be decoded.
    hint: probable mistake of the sender, human-readable, or empty. Optional.
    """

    baud: int
    unread: int

    @property
    def hint(self) -> str:
        return ""

    def receive(self, data: bytes, now: float) -> Sequence[RadioReading]:
        """Return the readings that these bytes complete. A message may arrive in any number of
        pieces, even over UDP."""
        ...

    def ask(self, now: float) -> bytes:
        """Return the bytes to send to the radio now, possibly none. The link calls this method at
        least 20 times a second."""
        return b""


class DriverError(Exception):
    """A driver that is missing or does not load. Its message is one line."""


def split_driver(endpoint: str) -> tuple[str | None, str]:
    """Return driver name and port of an endpoint (`linktrack:/dev/ttyUSB0`). A MAVLink endpoint has
    no driver: None."""
    name, sign, port = endpoint.partition(":")
    return (None, endpoint) if name in TRANSPORTS or not sign else (name, port)


def make_driver(name: str) -> Driver:
    """Return a new driver by its name. Raises DriverError."""
    try:
        point = find_entry_point(GROUP, name)
    except ValueError as error:
        raise DriverError(f"driver {error}") from None
    if point is None:
        known = ", ".join(sorted({point.name for point in installed_entry_points(GROUP)}))
        raise DriverError(
            f"no driver {name!r}; there are {known} (docs/radios.md describes how to add one)"
        )
    try:
        made: Driver = point.load()()
        for attribute, kind in ATTRIBUTES.items():
            if not isinstance(getattr(made, attribute, None), kind):
                raise TypeError(f"its {attribute} is missing or not {kind.__name__}")
    except FAILURES as error:  # raised by another package
        raise DriverError(f"driver {name!r} of {point.value} does not load: {error!r}") from None
    return made
