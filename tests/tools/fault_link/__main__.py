"""An impaired link: python -m tests.tools.fault_link --listen URL --forward URL [faults]."""

import sys
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import click
from circnav_sim.server import stop_signals
from circnav_sim.wires import EndpointError

from .intruders import ground_station, twin, unknown_senders, vehicle
from .link import FaultLink
from .pipe import CLEAN, Impairment
from .proxy import Proxy

BAD_USAGE = 2
EXAMPLE = """\b
three terminals, 20 % of all datagrams lost, and an outage of one minute after two minutes:
  circnav emulate arducopter --endpoint udpout:127.0.0.1:14551
  python -m tests.tools.fault_link --loss 0.2 --outage 120+60 \\
      --forward udpin:127.0.0.1:14551 --listen udpout:127.0.0.1:14550
  circnav fly arducopter --endpoint udpin:127.0.0.1:14550
Configure your own vehicle to send to port 14551 instead of 14550. Ctrl-C ends it and prints the
losses.
"""
RATE = click.FloatRange(0, 100_000, min_open=True)


def line_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add each fraction and time of `Impairment` as an option."""
    for field in reversed(fields(Impairment)):
        flag = f"--{field.name.replace('_', '-')}"
        meaning = field.metadata
        if "fraction" in meaning:
            text = f"Fraction {meaning['fraction']}."
            command = click.option(flag, type=float, default=0.0, metavar="FRACTION", help=text)(
                command
            )
        elif "time" in meaning:
            command = click.option(
                flag, type=float, default=0.0, metavar="S", help=f"s, {meaning['time']}."
            )(command)
    return command


@click.command(epilog=EXAMPLE)
@click.option(
    "--listen", required=True, metavar="URL", help="The application's side: udpin or udpout."
)
@click.option(
    "--forward", required=True, metavar="URL", help="The vehicle's side: udpin or udpout."
)
@click.option("--seed", default=0, help="Seed: equal seeds impair the same datagrams.")
@click.option(
    "--only",
    type=click.Choice(["up", "down"]),
    help="Impair this direction only (up: to the vehicle).",
)
@line_options
@click.option("--depth", default=5, help="Maximum number of datagrams that overtake a delayed one.")
@click.option("--in-order", is_flag=True, help="Jitter keeps the order, as in a stream.")
@click.option("--outage", multiple=True, metavar="AT+LENGTH", help="Outage: start and length, s.")
@click.option(
    "--second-vehicle", type=click.IntRange(1, 255), metavar="SYSID", help="Add a second vehicle."
)
@click.option(
    "--twin", "twin_ids", metavar="SYS/COMP", help="Add a second companion under these ids."
)
@click.option(
    "--flood",
    type=RATE,
    metavar="HZ",
    help="Flood of unknown ids, names, systems, and a ground station.",
)
def main(
    listen: str,
    forward: str,
    seed: int,
    only: str | None,
    outage: tuple[str, ...],
    second_vehicle: int | None,
    twin_ids: str | None,
    flood: float | None,
    **line: Any,
) -> None:
    """Run an impaired UDP link between your application and your vehicle, in both directions."""
    stopped = stop_signals()
    try:
        broken = Impairment(**line, outages=tuple(map(_outage, outage)))
        up, down = (CLEAN if only == other else broken for other in ("down", "up"))
        link = FaultLink(up=up, down=down, seed=seed)
        if second_vehicle:
            link.intruders.append(vehicle(second_vehicle))
        if twin_ids:
            link.intruders.append(twin(*_ids(twin_ids)))
        if flood:
            link.intruders += [unknown_senders(flood, seed), ground_station(flood)]
        proxy = Proxy(listen, forward, link)
    except (EndpointError, ValueError, OSError) as error:
        click.echo(f"fault_link: {error}", err=True)
        sys.exit(BAD_USAGE)
    click.echo(f"faults: {listen} <-> {forward}, seed {seed}: {broken}")
    try:
        proxy.run(stopped)
    finally:
        proxy.close()
    click.echo(f"faults: lost {link.lost}")


def _outage(text: str) -> tuple[float, float]:
    try:
        since, length = map(float, text.split("+"))
    except ValueError:
        raise ValueError(f"--outage {text}: write AT+LENGTH in seconds, as in 120+60") from None
    return since, since + length


def _ids(text: str) -> tuple[int, int]:
    system, _, component = text.partition("/")
    if not all(part.isdecimal() and 0 < int(part) < 256 for part in (system, component)):
        raise ValueError(f"--twin {text}: write SYS/COMP, each 1 to 255, as in 1/191")
    return int(system), int(component)


if __name__ == "__main__":
    main()
