"""Text of pydantic's validation errors of a TOML file: one line for the author of the file."""

import re
from collections.abc import Iterator
from difflib import get_close_matches
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

MOST_PROBLEMS = 8
"""Largest number of problems in one line."""
MOST_SHOWN = 60
"""Largest number of characters shown of a wrong value."""
_BOUNDS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}


def in_words(error: ValidationError, schema: type[BaseModel]) -> str:
    """Return the problems of a file of this schema as one line. Unknown keys are listed first,
    because a misspelled key often explains a missing key."""
    problems = sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
    missing = [
        ".".join(map(str, problem["loc"])) for problem in problems if problem["type"] == "missing"
    ]
    lines = [_one_in_words(problem, schema) for problem in problems if problem["type"] != "missing"]
    if missing:
        lines.append(f"{', '.join(missing)}: missing, add {'it' if len(missing) == 1 else 'them'}")
    more = f"; and {len(lines) - MOST_PROBLEMS} more" if len(lines) > MOST_PROBLEMS else ""
    return "; ".join(lines[:MOST_PROBLEMS]) + more


def _one_in_words(problem: ErrorDetails, schema: type[BaseModel]) -> str:
    place = list(map(str, problem["loc"]))
    key = ".".join(place)
    kind = problem["type"]
    context = problem.get("ctx", {})
    given = problem.get("input")
    if kind == "extra_forbidden":
        return f"{key}: unknown key, {_known_instead(place, schema)}"
    if kind == "literal_error":
        return f"{key}: {_shown(given)} is not one of {context['expected']}{_meant(given, context)}"
    if kind == "model_type":
        return f"{key}: must be a table, not {_shown(given)}"
    if kind == "finite_number":
        field = _table(schema, place[:-1]).model_fields.get(place[-1])
        # a required key has no default
        remedy = ": omit the key for none" if field is not None and field.default is None else ""
        return f"{key}: must be a finite number, not {given}{remedy}"
    bound = next(
        (f"{words} {context[name]:g}" for name, words in _BOUNDS.items() if name in context), None
    )
    if bound is not None and isinstance(given, int | float):
        return f"{key}: must be {bound}, not {given:g}"
    text = problem["msg"][:1].lower() + problem["msg"][1:]
    return f"{key}: {text.removeprefix('input ')}, not {_shown(given)}{_remedy(kind, given)}"


def _known_instead(place: list[str], schema: type[BaseModel]) -> str:
    """Return a question with the key that was probably meant, else the keys of the table."""
    known = list(_table(schema, place[:-1]).model_fields)
    anywhere = {key.rpartition(".")[2]: key for key in keys_of(schema)}
    near = get_close_matches(place[-1], known, n=1)
    near = near or [
        anywhere[name] for name in get_close_matches(place[-1], anywhere, n=1, cutoff=0.7)
    ]
    return f"did you mean {near[0]}?" if near else f"keys of this table: {', '.join(known)}"


def _meant(given: Any, context: dict[str, Any]) -> str:
    """Return a question with the permitted value that was probably meant; "" if none is close."""
    permitted = re.findall(r"'([^']*)'", context["expected"])
    word = str(given).lower()
    short = {"cw": "clockwise", "ccw": "counterclockwise"}
    near = get_close_matches(short.get(word, word), permitted, n=1)
    return f", did you mean '{near[0]}'?" if near else ""


def _shown(given: Any) -> str:
    """Return the Python notation of a value, shortened if it is long."""
    return repr(given)[:MOST_SHOWN]


def _remedy(kind: str, given: Any) -> str:
    """Return the remedy for a value in a notation that TOML does not have, such as `.5`, `1.`,
    `150,0`, a number in quotes, yes or True."""
    if kind == "bool_type":
        return ": write true or false"
    if kind not in ("float_type", "int_type") or not isinstance(given, str):
        return ""
    try:
        return f": write {float(given.replace(',', '.', 1))!r}"
    except ValueError:
        return ""


def keys_of(table: type[BaseModel], before: str = "") -> Iterator[str]:
    """Yield the dotted keys of a table and its inner tables."""
    for name in table.model_fields:
        inner = _inner(table, name)
        yield from [before + name] if inner is None else keys_of(inner, f"{before}{name}.")


def _table(schema: type[BaseModel], place: list[str]) -> type[BaseModel]:
    """Return the table of the schema at a path, or the innermost table that exists on this path."""
    model = schema
    for part in place:
        inner = _inner(model, part)
        if inner is None:
            return model
        model = inner
    return model


def _inner(table: type[BaseModel], name: str) -> type[BaseModel] | None:
    """Return the model of a key if its value is a table, else None."""
    annotation = table.model_fields[name].annotation
    kinds = [kind for kind in (annotation, *get_args(annotation)) if isinstance(kind, type)]
    return next((kind for kind in kinds if issubclass(kind, BaseModel)), None)
