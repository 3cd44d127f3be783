"""The drivers by name: ours, and those of installed packages (entry points of the group `circnav.ranging`)."""

from collections.abc import Callable
from importlib.metadata import entry_points

from circnav_mav.radios.dwm1001 import Dwm1001
from circnav_mav.radios.interface import Driver
from circnav_mav.radios.lines import Lines
from circnav_mav.radios.linktrack import LinkTrack

GROUP = "circnav.ranging"
DRIVERS: dict[str, Callable[[], Driver]] = {"dwm1001": Dwm1001, "lines": Lines, "linktrack": LinkTrack}
TRANSPORTS = ("udp", "udpin", "udpout", "tcp", "tcpout", "serial", "sim")
"""How endpoints begin that a driver's name does not."""


class DriverError(Exception):
    """A driver that is not there or does not load, in one line."""


def split_driver(endpoint: str) -> tuple[str | None, str]:
    """The driver's name of `linktrack:/dev/ttyUSB0` and its port; no driver for an endpoint that speaks MAVLink."""
    name, sign, port = endpoint.partition(":")
    return (None, endpoint) if name in TRANSPORTS or not sign else (name, port)


def make_driver(name: str) -> Driver:
    """A driver by its name. Raises DriverError."""
    others = {point.name: point for point in entry_points(group=GROUP)}
    try:
        if name in DRIVERS:
            return DRIVERS[name]()
        made: Driver = others[name].load()()
        return made
    except KeyError:
        known = ", ".join(sorted({*DRIVERS, *others}))
        raise DriverError(f"no driver {name!r}; there are {known} (docs/radios.md tells how to add one)") from None
    except Exception as error:  # whatever somebody else's package does
        raise DriverError(f"driver {name!r} of {others[name].value} does not load: {error!r}") from None
