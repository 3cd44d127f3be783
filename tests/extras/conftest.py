"""The command line run inside the test, and a recorded flight as input: extras add commands to
it."""

from tests.cli.conftest import *  # noqa: F403
