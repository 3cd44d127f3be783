"""Entry points of installed packages: laws, estimators and drivers from outside the repository."""

from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


def installed_entry_points(group: str) -> "list[EntryPoint]":
    """Return the entry points of a group, of the first distribution with each name on the search
    path.

    A distribution with unreadable metadata is ignored: it may belong to any other program.
    """
    # Imported here because its import is slow, and most missions name built-in code only.
    from importlib.metadata import distributions

    found: list[EntryPoint] = []
    seen: set[str] = set()
    for distribution in distributions():
        with suppress(Exception):
            points = list(distribution.entry_points.select(group=group))
            name = distribution.name.lower().replace("_", "-")
            if name not in seen:
                seen.add(name)
                found += points
    return found


def find_entry_point(group: str, name: str) -> "EntryPoint | None":
    """Return the entry point of this name, or None. Raises ValueError if several packages define
    it."""
    points = [point for point in installed_entry_points(group) if point.name == name]
    if len({point.value for point in points}) > 1:
        packages = " and ".join(
            f"{point.dist.name if point.dist else 'a package'} ({point.value})" for point in points
        )
        raise ValueError(f"{name!r} is defined by {packages}: uninstall all but one")
    return points[0] if points else None
