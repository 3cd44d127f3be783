"""python -m circnav_sim [VEHICLE.toml]: run the vehicle alone, for any ground station, companion or
test."""

import sys
from functools import partial
from typing import Any

import click

BAD_USAGE = 2
option = partial(click.option, show_default=True)


def emulate(
    vehicle: str | None,
    endpoint: str,
    ranging_endpoint: str | None,
    speed: float,
    seed: int | None,
    duration: float | None,
) -> None:
    """Run the vehicle in this process until SIGINT or SIGTERM. Raises ConfigError,
    EndpointError."""
    from .config import (
        ConfigError,
        load_vehicle,
        parse_vehicle,
    )  # slow imports, which --help does not need
    from .server import serve, stop_signals

    if not 0 < speed <= 100:
        raise ConfigError(f"--speed: must be above 0 and at most 100, not {speed:g}")
    # A flight needs this setting if the vehicle does not run in real time.
    how = (
        ""
        if speed == 1
        else f"""\n{speed:g} times real time: fly it with --set 'link.clock="autopilot"'"""
    )
    stopped = stop_signals()
    config = load_vehicle(vehicle) if vehicle else parse_vehicle({}, "sim")
    config = config if seed is None else config.changed(seed=seed)
    serve(
        config,
        endpoint,
        ranging_endpoint,
        speed,
        duration,
        lambda line: click.echo(line + how),
        stopped,
        click.echo,
    )


@click.command(epilog="Example: python -m circnav_sim --endpoint udpin:0.0.0.0:14550")
@click.argument("vehicle", required=False, metavar="[VEHICLE.toml]")
@option(
    "--endpoint",
    default="udpout:127.0.0.1:14550",
    metavar="URL",
    help="Link to the ground station or client: udpin:, udpout: or tcpin:HOST:PORT.",
)
@option(
    "--ranging-endpoint",
    metavar="URL",
    help='Link of the emulated radio, if its key via is "direct".',
)
@option("--speed", type=float, default=1.0, metavar="N", help="Simulation speed, times real time.")
@option(
    "--seed", type=int, metavar="N", help="Seed of all random numbers. [default: as in the file]"
)
@option(
    "--duration",
    type=click.FloatRange(0, min_open=True),
    metavar="S",
    help="Simulated time at which the emulator stops, s. [default: runs until Ctrl-C]",
)
def main(**options: Any) -> None:
    """Emulate a MAVLink vehicle and its ranging radio, configured by VEHICLE.toml or a mission
    file's table [sim]."""
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
