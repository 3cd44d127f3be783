"""`circnav emulate`: the bundled vehicle as a process of its own, in real time."""

import signal

import click

from circnav_mav.cli.exits import Exit, Refused, refusing
from circnav_mav.emulator.config import ConfigError, load_vehicle, parse_vehicle
from circnav_mav.emulator.server import serve
from circnav_mav.emulator.wires import EndpointError


def run_emulator(vehicle: str | None, endpoint: str, ranging_endpoint: str | None, speed: float) -> int:
    """Run the vehicle here until SIGINT or SIGTERM."""
    if not 0 < speed <= 100:
        raise Refused(f"--speed: must be above 0 and at most 100, not {speed:g}")
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _frame: stopped.append(received))
    # what a flight must be told of a vehicle that is not in real time
    how = "" if speed == 1 else f"""\n{speed:g} times real time: fly it with --set 'link.clock="autopilot"'"""
    with refusing(endpoint, ConfigError, EndpointError):
        config = load_vehicle(vehicle) if vehicle else parse_vehicle({}, "sim")
        serve(
            config, endpoint, ranging_endpoint, speed=speed,
            ready=lambda line: click.echo(line + how), stopped=lambda: bool(stopped), say=click.echo,
        )  # fmt: skip
    return Exit.DONE
