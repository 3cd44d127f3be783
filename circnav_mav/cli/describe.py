"""How commands are described: the parameter types that they share, and a decorator that imports what carries a command
out only when it runs."""

from collections.abc import Callable
from functools import wraps
from math import isfinite
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
    """Where to write. An empty name, as of a script's variable that was never set, would mean the current folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The name. Raises Refused."""
        if value == "":
            raise Refused("--out: is empty, give it a name")
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
