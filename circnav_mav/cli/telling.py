"""Printing that knows whose fault it is when it fails."""

import os
import sys
from contextlib import suppress

import click

from circnav_mav.cli.exits import Refused


def tell(text: object) -> None:
    """Print a line at once. Raises Refused where standard output cannot be written, and BrokenPipeError where its
    reader went away (`| head`), for which click ends the process quietly."""
    try:
        click.echo(text)
    except BrokenPipeError:
        raise
    except OSError as error:
        _leave_stdout()
        raise Refused(f"standard output cannot be written: {error.strerror or error}") from None


def _leave_stdout() -> None:
    """What is left in the buffer goes nowhere, else Python complains of it once more at the end."""
    with suppress(OSError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
