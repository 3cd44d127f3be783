"""Laws and estimators by name: built-in ones, and user-defined ones, which are named by an entry
point or `module:name`."""

import re
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from pkgutil import resolve_name
from traceback import extract_tb
from typing import Any, TypeVar

from circnav_mav.installed import find_entry_point, installed_entry_points

T = TypeVar("T")
REFERENCE = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*")
"""Form of `module:name`. Mission files come from other people: only a module on Python's search
path can be named, never a file."""
FAILURES = (Exception, SystemExit)
"""Exceptions that user-defined code may raise while it is imported or created."""


class OwnCodeError(ValueError):
    """User-defined law or estimator that is missing, does not fit or fails. The message is one
    line."""


class NameTable(dict[str, T]):
    """Built-in values by name. The code behind any other name is imported at its first lookup.

    group: entry-point group.
    adapt: function from a name and the imported object to a value of the table.
    """

    def __init__(
        self, group: str, built_in: Mapping[str, T], adapt: Callable[[str, Any], T]
    ) -> None:
        super().__init__(built_in)
        self._group = group
        self._adapt = adapt
        self._imported: dict[str, T] = {}

    def names(self) -> list[str]:
        """Return the names of the built-in values and of the installed entry points."""
        return [*self, *sorted({point.name for point in installed_entry_points(self._group)})]

    def knows(self, name: str) -> bool:
        """True if a name may be looked up. Its code is not imported."""
        # `names` reads the metadata of every installed package: 0.1 s that a built-in name need not
        # wait for.
        return name in self or REFERENCE.fullmatch(name) is not None or name in self.names()

    def add(self, found: Any) -> str:
        """Return the name `module:name` of a user-defined object, and let the name mean this very
        object, which a notebook may have defined anew. Raises OwnCodeError."""
        name = f"{found.__module__}:{getattr(found, '__qualname__', repr(found))}"
        if REFERENCE.fullmatch(name) is None:
            raise OwnCodeError(f"{name}: define it with a name, at the top of a module or notebook")
        self._imported[name] = self._adapt(name, found)
        return name

    def __missing__(self, name: str) -> T:
        """Return the user-defined value of a name that is not built in. Raises KeyError,
        OwnCodeError."""
        if name in self._imported:
            return self._imported[name]
        if not self.knows(name):
            raise KeyError(name)
        try:
            point = find_entry_point(self._group, name)
        except ValueError as error:
            raise OwnCodeError(str(error)) from None
        module = (name if point is None else point.value).partition(":")[0].partition(".")[0]
        # The first call of code:interact would open a prompt, and the flight would wait for it.
        if module in sys.stdlib_module_names:
            raise OwnCodeError(
                f"{name}: {module} is a module of Python's standard library: name a module of yours"
            )
        try:
            found = resolve_name(name) if point is None else point.load()
        except FAILURES as error:
            raise OwnCodeError(f"{name} cannot be imported: {error!r}") from None
        self._imported[name] = self._adapt(name, found)
        return self._imported[name]


class StuckCodeError(BaseException):
    """User-defined code that did not return within its time limit (`time_limit`). The message is
    one line.

    A law that catches every Exception must not catch this one.
    """


def call(name: str, function: Callable[..., T], *arguments: Any) -> T:
    """Call user-defined code. A frame of this function on the stack marks the code as running."""
    return function(*arguments)


def checked(name: str, make: Any, form: str, fits: Callable[[Any], bool]) -> Callable[[Any], Any]:
    """Return `make` with a check of its result. If `make` fails, or `fits` rejects its result, an
    OwnCodeError with the required form is raised."""

    def made_by(argument: Any) -> Any:
        try:
            made = make(argument)
        except FAILURES as error:
            raise OwnCodeError(f"{name} must be {form}: {error!r}") from None
        if not fits(made):
            raise OwnCodeError(f"{name} must be {form}, but it returns {made!r:.60}")
        return made

    return made_by


def turn_rate_of(law: Callable[[T], Any], estimate: T) -> float:
    """Return the turn rate that a user-defined law returns, rad/s. Raises OwnCodeError with the
    file and line of the law if it fails or returns no number."""
    function: Any = law
    name = getattr(law, "__qualname__", repr(law))
    if isinstance(law, partial) and law.func is call:
        name, function = law.args
    try:
        turn = law(estimate)
    except FAILURES as error:
        frames = [frame for frame in extract_tb(error.__traceback__) if frame.filename != __file__]
        # The error may come from a library that the law calls: name the line of the law.
        own = [frame for frame in frames if frame.filename == frames[0].filename]
        at = f" at {own[-1].filename}, line {own[-1].lineno}" if own else ""
        raise OwnCodeError(f"law {name} failed{at}: {error!r}") from error
    # float() would accept the text "0.1", which the law cannot have meant as a turn rate.
    if not isinstance(turn, str | bytes):
        with suppress(TypeError, ValueError):
            return float(turn)
    code = getattr(function, "__code__", None)
    at = f" ({code.co_filename}, line {code.co_firstlineno})" if code else ""
    raise OwnCodeError(f"law {name}{at} returns {turn!r:.60}, not a turn rate in rad/s")
