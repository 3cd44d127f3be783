"""Options and help of `circnav ranging`. The module `command` runs it."""

import click

from circnav_mav.cli.describe import Finite, command


@click.group(short_help="Try a ranging radio and its driver.")
def ranging() -> None:
    """Try a ranging radio and its driver without a vehicle, and calibrate the radio by a flight.

    \b
    Example:
        circnav ranging watch linktrack:/dev/ttyUSB0
    """


@command(
    "circnav_mav.extras.radios.command:watch_radio",
    group=ranging,
    short_help="Print the ranges of a radio, one line per second.",
)
@click.argument("endpoint", metavar="DRIVER:PORT")
@click.option(
    "--seconds", type=Finite(1), metavar="N", help="Listening time, s. [default: until Ctrl-C]"
)
def watch() -> None:
    """Print the ranges of a radio: each second one line per beacon, with figures of the last ten
    seconds.

    DRIVER is dwm1001, lines, linktrack or a driver of an installed package. PORT is a device
    (/dev/ttyUSB0, with baud rate /dev/ttyUSB0:115200) or an endpoint (udpin:0.0.0.0:5005,
    tcp:HOST:PORT). ranging.endpoint of a mission has the same form, DRIVER:PORT. Exit codes: 0
    ranges received, 2 no such driver or port, 3 no range received.

    \b
    Examples:
        circnav ranging watch linktrack:/dev/ttyUSB0
        circnav ranging watch lines:udpin:0.0.0.0:5005 --seconds 10
    """
