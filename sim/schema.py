"""Strict reading of TOML tables with pydantic. An unknown key or an invalid value gives an error of
one line."""

import difflib
from collections.abc import Iterable
from typing import Annotated, Any, Self, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, WithJsonSchema

LONGEST_NAME = 10


class ConfigError(ValueError):
    """Invalid vehicle file. The message is one line with the file, the key and the remedy."""


class Table(BaseModel):
    """A table that rejects unknown keys and converts no types."""

    # defer_build: build each validator once, at its first use, not again for each table around it
    model_config = ConfigDict(
        defer_build=True, extra="forbid", strict=True, frozen=True, allow_inf_nan=False
    )

    def changed(self, **values: Any) -> Self:
        """Return a copy with other values. They are not validated."""
        return self.model_copy(update=values)


Section = TypeVar("Section", bound=Table)


def _ordered(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError(f"[{pair[0]:g}, {pair[1]:g}] is empty, write the lower bound first")
    return pair


_NUMBERS = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
Interval = Annotated[
    tuple[float, float], Field(strict=False), AfterValidator(_ordered), WithJsonSchema(_NUMBERS)
]
"""Lower and upper bound. Not strict, because TOML has lists and no tuples."""


def _fits(name: str) -> str:
    if len(name.encode()) > LONGEST_NAME:
        raise ValueError(f"longer than {LONGEST_NAME} characters")
    return name


Name = Annotated[str, AfterValidator(_fits)]
"""Name of a NAMED_VALUE_FLOAT: at most LONGEST_NAME bytes."""


def nearest(word: str, known: Iterable[str]) -> str:
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f', did you mean "{close[0]}"?' if close else ""


def read_table(kind: type[Section], table: object, where: str) -> Section:
    """Validate a table as `kind`. Raises ConfigError with `where` and the key."""
    try:
        return kind.model_validate(table)
    except ValidationError as error:
        # Report a misspelled key first: it may have caused the other errors.
        wrong = min(error.errors(), key=lambda one: one["type"] != "extra_forbidden")
    here = where
    parts = wrong["loc"]
    context = wrong.get("ctx", {})
    given = wrong["input"]
    for part in parts:
        here = f"{here}[{part}]" if isinstance(part, int) else place(here, part)
    if wrong["type"] == "extra_forbidden":
        known = list(_inner(kind, parts[:-1]).model_fields)
        raise ConfigError(
            f"{here}: unknown"
            f" key{nearest(str(parts[-1]), known) or '; known keys: ' + ', '.join(known)}"
        )
    if "error" in context:
        raise ConfigError(f"{here}: {context['error']}")
    if wrong["type"] == "model_type":
        raise ConfigError(f"{here}: should be a table of keys and values, not {given!r}")
    problem = wrong["msg"].removeprefix("Input ").lower().replace("tuple", "list")
    problem = "is missing" if wrong["type"] == "missing" else f"{problem}, not {repr(given)[:40]}"
    meant = nearest(str(given), context.get("expected", "").split("'"))
    raise ConfigError(f"{here}: {problem}{meant}")


def _inner(kind: type[BaseModel], names: Iterable[Any]) -> type[BaseModel]:
    """Return the table class at a path of keys; for a list of tables, the class of its items."""
    for name in names:
        if isinstance(name, str):
            hint = kind.model_fields[name].annotation
            kind = next(
                one
                for one in (hint, *get_args(hint))
                if isinstance(one, type) and issubclass(one, BaseModel)
            )
    return kind


def place(where: str, name: object) -> str:
    """Return `file: section.key`: a colon after the file, dots between keys."""
    return f"{where}.{name}" if ": " in where else f"{where}: {name}"
