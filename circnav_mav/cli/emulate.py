"""`circnav emulate`, and the bundled vehicle as a process of its own."""

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import click

import sim
from circnav_mav.cli.exits import Exit, Refused
from sim.config import ConfigError, load_vehicle, parse_vehicle
from sim.server import serve
from sim.wires import EndpointError

START_PATIENCE = 20.0
"""Seconds that the vehicle's process may take to say that it is ready."""
STOP_PATIENCE = 3.0


def run_emulator(vehicle: str | None, endpoint: str, ranging_endpoint: str | None, speed: float) -> int:
    """Run the vehicle here until SIGINT or SIGTERM."""
    if not 0 < speed <= 100:
        raise Refused(f"--speed: must be above 0 and at most 100, not {speed:g}")
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _frame: stopped.append(received))
    try:
        config = load_vehicle(vehicle) if vehicle else parse_vehicle({}, "sim")
        serve(
            config, endpoint, ranging_endpoint, speed=speed,
            ready=lambda line: click.echo(line + _how_to_fly(speed)), stopped=lambda: bool(stopped),
        )  # fmt: skip
    except (ConfigError, EndpointError) as error:
        raise Refused(str(error)) from None
    return Exit.DONE


def _how_to_fly(speed: float) -> str:
    """What a flight must be told of a vehicle that is not in real time."""
    return "" if speed == 1 else f"""\n{speed:g} times real time: fly it with --set 'link.clock="autopilot"'"""


class EmulatedVehicle:
    """The bundled vehicle as its own process, speaking to our ports on the loopback."""

    def __init__(self, vehicle_file: Path, port: int, ranging_port: int | None, speed: float) -> None:
        """Start it and wait until it says that it is ready. Raises Refused."""
        command = [sys.executable, "-P", "-m", "sim", str(vehicle_file), "--with-parent"]
        command += ["--endpoint", f"udpout:127.0.0.1:{port}", "--speed", f"{speed:g}"]
        if ranging_port is not None:
            command += ["--ranging-endpoint", f"udpout:127.0.0.1:{ranging_port}"]
        root = str(Path(sim.__file__).parents[1])
        self._process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            text=True,
            env={**os.environ, "PYTHONPATH": root},
            start_new_session=True,  # the operator's Ctrl-C is for us; we stop the vehicle after the safe setpoint
        )
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], START_PATIENCE)
        if not ready or not self._process.stdout.readline():
            self._process.kill()
            said = self._process.communicate()[1].strip().splitlines()
            raise Refused(
                f"the bundled vehicle did not start: {said[-1] if said else 'it said nothing'}", Exit.INTERNAL
            )

    def stop(self) -> None:
        """End the process."""
        self._process.terminate()
        try:
            self._process.communicate(timeout=STOP_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
