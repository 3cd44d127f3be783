"""python -m circnav_sim [VEHICLE.toml]: the vehicle alone, for any ground station, companion or test."""

import sys
from functools import partial
from typing import Any

import click

BAD_USAGE = 2
said = partial(click.option, show_default=True)


def emulate(
    vehicle: str | None, endpoint: str, ranging_endpoint: str | None, speed: float, seed: int | None,
    duration: float | None,
) -> None:  # fmt: skip
    """Run the vehicle here until SIGINT or SIGTERM. Raises ConfigError, EndpointError."""
    from .config import ConfigError, load_vehicle, parse_vehicle  # slow: --help does not wait for them
    from .server import serve, stop_signals

    if not 0 < speed <= 100:
        raise ConfigError(f"--speed: must be above 0 and at most 100, not {speed:g}")
    # what a flight must be told of a vehicle that is not in real time
    how = "" if speed == 1 else f"""\n{speed:g} times real time: fly it with --set 'link.clock="autopilot"'"""
    stopped = stop_signals()
    config = load_vehicle(vehicle) if vehicle else parse_vehicle({}, "sim")
    config = config if seed is None else config.changed(seed=seed)
    serve(config, endpoint, ranging_endpoint, speed, duration, lambda line: click.echo(line + how), stopped, click.echo)


@click.command(epilog="Example: python -m circnav_sim --endpoint udpin:0.0.0.0:14550")
@click.argument("vehicle", required=False, metavar="[VEHICLE.toml]")
@said("--endpoint", default="udpout:127.0.0.1:14550", metavar="URL", help="udpin:, udpout: or tcpin:HOST:PORT.")
@said("--ranging-endpoint", metavar="URL", help='Where its radio sends to, for ranging that goes "direct".')
@said("--speed", type=float, default=1.0, metavar="N", help="Times real time.")
@said("--seed", type=int, metavar="N", help="Of all random numbers, instead of the file's.")
@said("--duration", type=click.FloatRange(0, min_open=True), metavar="S", help="End after so long, simulated.")
def main(**options: Any) -> None:
    """A MAVLink vehicle and its ranging radio, as VEHICLE.toml or the [sim] table of a mission file says."""
    from .config import ConfigError
    from .wires import EndpointError

    try:
        emulate(**options)
    except (ConfigError, EndpointError) as error:
        line = "".join(letter if letter.isprintable() else "?" for letter in str(error))
        click.echo(f"sim: {line}", err=True)
        sys.exit(BAD_USAGE)


if __name__ == "__main__":
    main()
