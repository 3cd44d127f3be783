"""`circnav emulate`: the bundled vehicle as a separate process in real time."""

from typing import Any

from circnav_sim.__main__ import emulate
from circnav_sim.config import ConfigError
from circnav_sim.wires import EndpointError

from circnav_mav.cli.exits import Exit, refusing


def run_emulator(endpoint: str, **options: Any) -> int:
    """Run the bundled vehicle until SIGINT or SIGTERM. Raises Refused."""
    with refusing(endpoint, ConfigError, EndpointError):
        emulate(endpoint=endpoint, **options)
    return Exit.DONE
