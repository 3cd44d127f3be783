"""python -m circnav_mav.emulator [VEHICLE.toml]: the vehicle alone, for any ground station, companion or test."""

import signal
import sys
from functools import partial

import click

from .config import ConfigError, load_vehicle, parse_vehicle
from .server import serve
from .wires import EndpointError

BAD_USAGE = 2
MORE_THAN_0 = click.FloatRange(0, 1e9, min_open=True, max_open=True)
said = partial(click.option, show_default=True)


@click.command(epilog="Example: python -m circnav_mav.emulator --endpoint udpin:0.0.0.0:14550")
@click.argument("vehicle", required=False, metavar="[VEHICLE.toml]")
@said("--endpoint", default="udpout:127.0.0.1:14550", metavar="URL", help="udpin:, udpout: or tcpin:HOST:PORT.")
@said("--ranging-endpoint", metavar="URL", help='Where the radio speaks when its via = "direct".')
@said("--speed", type=MORE_THAN_0, default=1.0, help="Simulated seconds per second.")
@said("--seed", type=int, help="Instead of the file's.")
@said("--duration", type=MORE_THAN_0, help="Stop after so many simulated seconds.")
def main(
    vehicle: str | None, endpoint: str, ranging_endpoint: str | None, speed: float, seed: int | None,
    duration: float | None,
) -> None:  # fmt: skip
    """A MAVLink vehicle and its ranging radio, as VEHICLE.toml or the [sim] table of a mission file says."""
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _frame: stop.append(received))
    try:
        config = load_vehicle(vehicle) if vehicle else parse_vehicle({}, "sim")
        config = config if seed is None else config.changed(seed=seed)
        serve(
            config, endpoint, ranging_endpoint, speed=speed, duration=duration,
            ready=lambda line: print(line, flush=True),
            stopped=lambda: bool(stop),
            say=lambda line: print(line, flush=True),
        )  # fmt: skip
    except (ConfigError, EndpointError) as error:
        click.echo(f"sim: {error}", err=True)
        sys.exit(BAD_USAGE)


if __name__ == "__main__":
    main()
