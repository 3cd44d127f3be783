"""Definition of commands: shared parameter types, and a decorator that imports a command's code
only when it runs."""

import os
from collections.abc import Callable
from functools import wraps
from math import isfinite
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import click

from circnav_mav.cli.exits import Refused

FORMAT = click.option(
    "--format",
    "form",
    type=click.Choice(["png", "pdf", "svg"]),
    default="png",
    help="Format of the figures.",
)
PROCESSES = click.option(
    "--processes",
    type=click.IntRange(1),
    metavar="N",
    help="Parallel processes. [default: one per core]",
)
SCHEDULER = click.option(
    "--scheduler",
    metavar="ADDR",
    help="Fly on the workers of this Dask scheduler, e.g. tcp://host:8786.",
)


class Finite(click.FloatRange):
    """Finite number: rejects nan and inf, which `float` accepts."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number."""
        number = float(super().convert(value, param, ctx))
        if not isfinite(number):
            self.fail(f"{value!r} is not a number.", param, ctx)
        return number


class Folder(click.Path):
    """Folder to write into."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name of the folder. Raises Refused for a name that is probably a mistake: an
        empty one (an unset variable of a script), the root of the disk, or a link to a folder that
        is not empty."""
        if value == "":
            raise Refused("--out: is empty, give it a name")
        # A shell does not expand `~` in `--out=~/run`. A folder named `~` would invite `rm -r ~`.
        value = os.path.expanduser(value)
        folder = Path(value)
        if folder.resolve() == Path(folder.resolve().anchor):
            raise Refused(f"--out {value}: is the root of the disk, name a folder in it")
        if folder.is_symlink() and folder.is_dir() and any(folder.iterdir()):
            raise Refused(
                f"--out {value}: is a link to {folder.resolve()}, which is not empty: name an empty"
                " folder"
            )
        return value


def command(
    does: str, group: click.Group | None = None, **words: Any
) -> Callable[[Callable[[], None]], click.Command]:
    """Return a decorator that creates a command from the name, docstring and options of a function.

    does: `module:function`, imported when the command runs. It gets the options by name and returns
    the exit code. group: group of the command, None for a command of an extension.
    """

    def make(described: Callable[[], None]) -> click.Command:
        @wraps(described)
        def run(**options: Any) -> Any:
            return resolve_name(does)(**options)

        return (group.command if group else click.command)(**words)(run)

    return make
