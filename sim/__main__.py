"""python -m circnav_mav.emulator [VEHICLE.toml]: the vehicle alone, for any ground station, companion or test."""

import argparse
import signal
import sys

from .config import ConfigError, load_vehicle, parse_vehicle
from .server import serve
from .wires import EndpointError

BAD_USAGE = 2


def main(arguments: list[str] | None = None) -> int:
    options = _parser().parse_args(arguments)
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _frame: stop.append(received))
    try:
        config = load_vehicle(options.vehicle) if options.vehicle else parse_vehicle({}, "sim")
        if options.seed is not None:
            config = config.seeded(options.seed)
        serve(
            config,
            options.endpoint,
            options.ranging_endpoint,
            speed=options.speed,
            duration=options.duration,
            ready=lambda line: print(line, flush=True),
            stopped=lambda: bool(stop),
            say=lambda line: print(line, flush=True),
        )
    except (ConfigError, EndpointError) as error:
        print(f"sim: {error}", file=sys.stderr)
        return BAD_USAGE
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m circnav_mav.emulator",
        description="A MAVLink vehicle and its ranging radio. Example: --endpoint udpin:0.0.0.0:14550",
    )
    parser.add_argument("vehicle", nargs="?", metavar="VEHICLE.toml", help="vehicle file, or a mission file with [sim]")
    parser.add_argument("--endpoint", default="udpout:127.0.0.1:14550", help="udpin:, udpout: or tcpin:HOST:PORT")
    parser.add_argument("--ranging-endpoint", metavar="URL", help='where the radio speaks when its via = "direct"')
    parser.add_argument("--speed", type=_positive, default=1.0, help="simulated seconds per second")
    parser.add_argument("--seed", type=int, help="overrides the file's seed")
    parser.add_argument("--duration", type=_positive, help="stop after so many simulated seconds")
    return parser


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"{text} must be greater than 0")
    return value


if __name__ == "__main__":
    sys.exit(main())
