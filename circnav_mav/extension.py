"""Interface by which an extra attaches to the core.

The core flies without any extra and imports none of them. It reads the `EXTENSION` of each package
in `circnav_mav/extras`. Without a package, its commands, mission tables and options do not exist.
"""

import importlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pkgutil import iter_modules, resolve_name
from typing import Any

EXTRAS = "circnav_mav.extras"


@dataclass(frozen=True)
class Extension:
    """Parts that one extra adds to the core. Each value is a reference, `module:name`, imported
    when used.

    commands: click commands, by the names that are typed. "group member" adds a command to a group
        of another extension, if that is installed.
    tables: pydantic models of mission tables, by the names of the tables.
    checks: functions from a mission to the check lines of the extra's tables.
    preflight: functions from a mission to the check lines of preflight. They may listen for some
        seconds.
    fly_options: click options that `circnav fly` gets.
    flies: functions that replace `circnav fly` if an option is given, by the name of this option.
        They get all options and return the exit code.
    listener: function from an `ListenerSettings` to an `Listener`, or to None if this flight does
        not need one.
    report_section: function from a run folder to HTML for its report, empty for nothing.
    schemas: pydantic models of other files, by the names that `circnav schema` takes.
    functions: functions of the public API, by name: `from circnav_mav import NAME`.
    position_forecast: function from a mission and the time on its circle (s) to the expected
        standard deviation of the beacon's place, m, or None.
    order: place among the commands that `circnav --help` lists.
    """

    commands: Mapping[str, str] = field(default_factory=dict)
    tables: Mapping[str, str] = field(default_factory=dict)
    checks: Sequence[str] = ()
    preflight: Sequence[str] = ()
    fly_options: Sequence[str] = ()
    flies: Mapping[str, str] = field(default_factory=dict)
    listener: str | None = None
    report_section: str | None = None
    schemas: Mapping[str, str] = field(default_factory=dict)
    functions: Mapping[str, str] = field(default_factory=dict)
    position_forecast: str | None = None
    order: int = 100


@cache
def extensions() -> tuple[Extension, ...]:
    """Return the installed extensions, sorted by `order`."""
    try:
        package = importlib.import_module(EXTRAS)
    except ModuleNotFoundError:
        return ()
    names = (module.name for module in iter_modules(package.__path__, f"{EXTRAS}.") if module.ispkg)
    found = (getattr(importlib.import_module(name), "EXTENSION", None) for name in names)
    return tuple(sorted(filter(None, found), key=lambda extension: extension.order))


def load(reference: str) -> Any:
    """Return the object that a reference of an extension names."""
    return resolve_name(reference)


def added_checks(kind: str, mission: Any) -> Iterator[Any]:
    """Yield the check lines of all extensions. kind: `checks` or `preflight`."""
    for extension in extensions():
        for reference in getattr(extension, kind):
            yield from load(reference)(mission)


def flown_by(options: Mapping[str, Any]) -> Any:
    """Return the function of an extension that replaces `circnav fly`, or None. options: those of
    the command, by name."""
    for extension in extensions():
        for name, reference in extension.flies.items():
            if options.get(name) is not None:
                return load(reference)
    return None


def table_models() -> dict[str, Any]:
    """Return the models of the mission tables of extras, by name."""
    return {
        name: load(model) for extension in extensions() for name, model in extension.tables.items()
    }
