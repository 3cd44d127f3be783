"""`circnav emulate`: the bundled vehicle as a process of its own, in real time."""

from typing import Any

from circnav_mav.cli.exits import Exit, refusing
from circnav_mav.emulator.__main__ import emulate
from circnav_mav.emulator.config import ConfigError
from circnav_mav.emulator.wires import EndpointError


def run_emulator(endpoint: str, **options: Any) -> int:
    """Run the vehicle here until SIGINT or SIGTERM. Raises Refused."""
    with refusing(endpoint, ConfigError, EndpointError):
        emulate(endpoint=endpoint, **options)
    return Exit.DONE
