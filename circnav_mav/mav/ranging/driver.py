"""Drivers of ranging radios: their interface, and the installed ones by name (entry points `circnav.ranging`)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from numbers import Integral, Real
from typing import Any, Protocol

MOST_BEACON = 65535
"""Largest id of a beacon: 16 bits, as RANGING_BEACON carries it."""
GROUP = "circnav.ranging"
TRANSPORTS = ("udp", "udpin", "udpout", "tcp", "tcpout", "serial", "sim")
"""How endpoints begin that a driver's name does not."""
FAILURES = (Exception, SystemExit)
"""What a driver may raise. One that ends a program of its own by sys.exit() must not end the flight without a safe
setpoint."""
ATTRIBUTES: dict[str, Any] = {"baud": int, "line_end": bytes, "unread": int, "receive": Callable, "ask": Callable}
"""Attributes that a driver must have, with their types."""


@dataclass(frozen=True, slots=True)
class RadioReading:
    """One measured range.

    range: slant, m; not finite or not above 0: none was measured. beacon: id of the other radio. sigma: standard
    deviation, m, None where the radio tells none. stamp: when it was measured, s of the radio's own clock; None: when
    it arrives.
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
    """One radio on one port. Times are seconds of our clock; a driver asks nobody else for the time.

    baud: of its serial line, unless the port says another. line_end: ends a line of text that a datagram leaves open;
    empty for a radio that speaks binary. unread: bytes so far that were not understood.
    """

    baud: int
    line_end: bytes
    unread: int

    def receive(self, data: bytes, now: float) -> Sequence[RadioReading]:
        """The readings that these bytes complete; a message may come in any number of pieces."""
        ...

    def ask(self, now: float) -> bytes:
        """What to send to the radio now, if anything. Called at least 20 times a second."""
        return b""


class DriverError(Exception):
    """A driver that is not there or does not load, in one line."""


def split_driver(endpoint: str) -> tuple[str | None, str]:
    """The driver's name of `linktrack:/dev/ttyUSB0` and its port; no driver for an endpoint that speaks MAVLink."""
    name, sign, port = endpoint.partition(":")
    return (None, endpoint) if name in TRANSPORTS or not sign else (name, port)


def make_driver(name: str) -> Driver:
    """Make a driver by its name. Raises DriverError."""
    others = {point.name: point for point in entry_points(group=GROUP)}
    if name not in others:
        known = ", ".join(sorted(others))
        raise DriverError(f"no driver {name!r}; there are {known} (docs/radios.md describes how to add one)")
    try:
        made: Driver = others[name].load()()
        for attribute, kind in ATTRIBUTES.items():
            if not isinstance(getattr(made, attribute, None), kind):
                raise TypeError(f"its {attribute} is missing or not {kind.__name__}")
    except FAILURES as error:  # of another package
        raise DriverError(f"driver {name!r} of {others[name].value} does not load: {error!r}") from None
    return made
