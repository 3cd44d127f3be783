"""The command line run inside the test, and a recorded flight as input."""

from tests.command_line import *  # noqa: F403
