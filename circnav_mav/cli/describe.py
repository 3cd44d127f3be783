"""How commands are described: the parameter types that they share, and a decorator that imports what carries a command
out only when it runs."""

from collections.abc import Callable
from functools import wraps
from math import isfinite
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import click

from circnav_mav.cli.exits import Refused


class Finite(click.FloatRange):
    """Neither nan nor inf, which are numbers for `float`."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number."""
        number = float(super().convert(value, param, ctx))
        if not isfinite(number):
            self.fail(f"{value!r} is not a number.", param, ctx)
        return number


class Folder(click.Path):
    """Where to write."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name of the folder. Raises Refused for a name that was hardly meant: an empty one, as of a
        script's variable that was never set, the root, and a link behind which other files are."""
        folder = Path(value)
        if value == "":
            raise Refused("--out: is empty, give it a name")
        if folder.resolve() == Path(folder.resolve().anchor):
            raise Refused(f"--out {value}: is the root of the disk, name a folder in it")
        if folder.is_symlink() and folder.is_dir() and any(folder.iterdir()):
            raise Refused(f"--out {value}: is a link to {folder.resolve()}, which is not empty: name an empty folder")
        return value


def command(does: str, group: click.Group | None = None, **words: Any) -> Callable[[Callable[[], None]], click.Command]:
    """Return a decorator that makes a command with the name, the help and the options of a function.

    does: `module:function`, imported when the command runs; it gets the options by name and returns the exit code.
    group: the group that gets the command; None for one that an extension adds.
    """

    def make(described: Callable[[], None]) -> click.Command:
        @wraps(described)
        def run(**options: Any) -> Any:
            return resolve_name(does)(**options)

        return (group.command if group else click.command)(**words)(run)

    return make
