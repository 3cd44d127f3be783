"""python -m sim.faults --listen ENDPOINT --forward ENDPOINT [faults]: a broken link between your own programs."""

import argparse
import signal
import sys
from pathlib import Path

from sim.endpoints import EndpointError
from sim.faults.impairment import FRACTIONS, Impairment
from sim.faults.intruders import ground_station, recorded, strangers, twin, vehicle
from sim.faults.link import FaultLink
from sim.faults.proxy import Proxy

BAD_USAGE = 2
TIMES = {
    "delay": "s, of everything",
    "jitter": "s, uniform on top of it",
    "burst-every": "s, mean time between random outages",
    "burst": "s, their mean length",
    "echo": "s, by which a duplicate comes later",
}


def main(arguments: list[str] | None = None) -> int:
    options = _parser().parse_args(arguments)
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _frame: stop.append(received))
    try:
        link = fault_link(options)
        proxy = Proxy(options.listen, options.forward, link)
    except (EndpointError, ValueError, OSError) as error:
        print(f"sim.faults: {error}", file=sys.stderr)
        return BAD_USAGE
    print(f"faults: {options.listen} <-> {options.forward}, seed {options.seed}: {impairment(options)}", flush=True)
    try:
        proxy.run(lambda: bool(stop))
    finally:
        proxy.close()
    print(f"faults: lost {link.lost}", flush=True)
    return 0


def impairment(options: argparse.Namespace) -> Impairment:
    """The line that the options describe. Raises ValueError."""
    values = {name: getattr(options, name) for name in (*FRACTIONS, *(name.replace("-", "_") for name in TIMES))}
    outages = tuple((since, since + length) for since, length in map(_outage, options.outage))
    return Impairment(**values, depth=options.depth, in_order=options.in_order, outages=outages)


def fault_link(options: argparse.Namespace) -> FaultLink:
    """The link that the options describe. Raises ValueError and OSError."""
    line, clean = impairment(options), Impairment()
    up, down = (clean if options.only == other else line for other in ("down", "up"))
    link = FaultLink(up=up, down=down, seed=options.seed)
    if options.second_vehicle:
        link.intruders.append(vehicle(options.second_vehicle))
    if options.twin:
        link.intruders.append(twin(*map(int, options.twin.split("/"))))
    if options.flood:
        link.intruders += [strangers(options.flood, options.seed), ground_station(options.flood)]
    if options.inject:
        link.intruders.append(recorded(options.inject, options.inject_rate))
    return link


def _outage(text: str) -> tuple[float, float]:
    since, _, length = text.partition("+")
    return float(since), float(length)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m sim.faults",
        description="A broken link. Example: python -m sim.faults --listen udpin:127.0.0.1:14550 "
        "--forward udpin:127.0.0.1:14551 --loss 0.2 --jitter 0.2",
    )
    parser.add_argument("--listen", required=True, metavar="URL", help="the application's side: udpin: or udpout:")
    parser.add_argument("--forward", required=True, metavar="URL", help="the vehicle's side: udpin: or udpout:")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=("up", "down"), help="break this direction only (up: to the vehicle)")
    for name in FRACTIONS:
        unit = "of bytes" if name == "corrupt" else "of datagrams"
        parser.add_argument(f"--{name}", type=float, default=0.0, metavar="0..1", help=f"fraction {unit}")
    for name, meaning in TIMES.items():
        parser.add_argument(f"--{name}", type=float, default=0.0, metavar="S", help=meaning)
    parser.add_argument("--depth", type=int, default=5, help="most datagrams that overtake a held one")
    parser.add_argument("--in-order", action="store_true", help="jitter keeps the order, as a stream does")
    parser.add_argument("--outage", action="append", default=[], metavar="AT+LENGTH", help="s from the start")
    parser.add_argument("--second-vehicle", type=int, metavar="SYSID", help="another vehicle speaks, too")
    parser.add_argument("--twin", metavar="SYS/COMP", help="another companion under these ids")
    parser.add_argument("--flood", type=float, metavar="HZ", help="unknown ids, names, systems, and a ground station")
    parser.add_argument("--inject", type=Path, metavar="FILE.tlog", help="its frames join those of the vehicle")
    parser.add_argument("--inject-rate", type=float, default=10.0, metavar="HZ")
    return parser


if __name__ == "__main__":
    sys.exit(main())
