"""A broken link between your own programs: python -m circnav_mav.emulator.faults --listen URL --forward URL ..."""

import argparse
import signal
import sys
from pathlib import Path

from ..wires import EndpointError
from .impairment import FRACTIONS, Impairment
from .intruders import ground_station, recorded, strangers, twin, vehicle
from .link import FaultLink
from .proxy import Proxy

BAD_USAGE = 2
MEANINGS = {
    "loss": "of datagrams that never arrive",
    "duplicate": "of datagrams that come twice",
    "reorder": "of datagrams that are overtaken by later ones",
    "corrupt": "of bytes that become others",
    "truncate": "of datagrams cut short",
    "split": "of datagrams that come in two pieces",
    "join": "of datagrams that wait and lead the next one",
    "stray": "of datagrams with bytes in front that look like a frame's start",
}
TIMES = {
    "delay": "of everything",
    "jitter": "at most, on top of the delay",
    "burst-every": "mean time between random outages; needs --burst",
    "burst": "mean length of the random outages",
    "echo": "by which a duplicate comes later, as by a second route",
}
EXAMPLE = """\
three terminals, a fifth of all datagrams lost and a minute of silence after two:
  circnav emulate arducopter --endpoint udpout:127.0.0.1:14551
  python -m circnav_mav.emulator.faults --loss 0.2 --outage 120+60 \\
      --forward udpin:127.0.0.1:14551 --listen udpout:127.0.0.1:14550
  circnav fly arducopter --endpoint udpin:127.0.0.1:14550
With a vehicle of your own, let it send to port 14551 instead of 14550. Ctrl-C ends it and tells what was lost.
"""


def main(arguments: list[str] | None = None) -> int:
    options = _parser().parse_args(arguments)
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _frame: stop.append(received))
    try:
        link = fault_link(options)
        proxy = Proxy(options.listen, options.forward, link)
    except (EndpointError, ValueError, OSError) as error:
        told = f"{error.filename}: {error.strerror}" if isinstance(error, OSError) and error.filename else error
        print(f"sim.faults: {told}", file=sys.stderr)
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
        link.intruders.append(twin(*_ids(options.twin)))
    if options.flood:
        link.intruders += [strangers(options.flood, options.seed), ground_station(options.flood)]
    if options.inject:
        link.intruders.append(recorded(options.inject, options.inject_rate))
    return link


def _outage(text: str) -> tuple[float, float]:
    try:
        since, length = map(float, text.split("+"))
    except ValueError:
        raise ValueError(f"--outage {text}: write AT+LENGTH in seconds, as in 120+60") from None
    return since, length


def _ids(text: str) -> tuple[int, int]:
    try:
        system, component = map(int, text.split("/"))
        if not (0 < system < 256 and 0 < component < 256):
            raise ValueError
    except ValueError:
        raise ValueError(f"--twin {text}: write SYS/COMP, each 1 to 255, as in 1/191") from None
    return system, component


def _system(text: str) -> int:
    if not 0 < int(text) < 256:
        raise argparse.ArgumentTypeError(f"{text}: must be 1 to 255")
    return int(text)


def _rate(text: str) -> float:
    if not 0 < float(text) <= 100_000:
        raise argparse.ArgumentTypeError(f"{text}: must be above 0 and at most 100000")
    return float(text)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m circnav_mav.emulator.faults",
        description="A broken UDP link between your own application and your own vehicle, in both directions.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--listen",
        required=True,
        metavar="URL",
        help="the application's side: udpin:HOST:PORT (it calls) or udpout:HOST:PORT (it waits)",
    )
    parser.add_argument("--forward", required=True, metavar="URL", help="the vehicle's side, as well")
    parser.add_argument("--seed", type=int, default=0, help="the same seed breaks the same datagrams")
    parser.add_argument("--only", choices=("up", "down"), help="break this direction only (up: to the vehicle)")
    for name in FRACTIONS:
        parser.add_argument(f"--{name}", type=float, default=0.0, metavar="0..1", help=f"fraction {MEANINGS[name]}")
    for name, meaning in TIMES.items():
        parser.add_argument(f"--{name}", type=float, default=0.0, metavar="S", help=f"s, {meaning}")
    parser.add_argument("--depth", type=int, default=5, help="most datagrams that overtake a held one")
    parser.add_argument("--in-order", action="store_true", help="jitter keeps the order, as a stream does")
    parser.add_argument(
        "--outage",
        action="append",
        default=[],
        metavar="AT+LENGTH",
        help="nothing passes: s from the start, and for how long; may be given more than once",
    )
    parser.add_argument("--second-vehicle", type=_system, metavar="SYSID", help="another vehicle speaks, too")
    parser.add_argument("--twin", metavar="SYS/COMP", help="another companion under these ids")
    parser.add_argument("--flood", type=_rate, metavar="HZ", help="unknown ids, names, systems, and a ground station")
    parser.add_argument("--inject", type=Path, metavar="FILE.tlog", help="its frames join those of the vehicle")
    parser.add_argument("--inject-rate", type=_rate, default=10.0, metavar="HZ", help="how many of them a second")
    return parser


if __name__ == "__main__":
    sys.exit(main())
