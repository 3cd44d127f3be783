"""The command line run inside the test, and a recorded flight as input: extras add commands to it."""

from tests.command_line import (
    browser,
    busy_port,
    chromium,
    circnav,
    flown,
    full,
    mission,
    no_pictures,
    run,
    undrawn,
    with_manifest,
)

__all__ = [
    "browser",
    "busy_port",
    "chromium",
    "circnav",
    "flown",
    "full",
    "mission",
    "no_pictures",
    "run",
    "undrawn",
    "with_manifest",
]
