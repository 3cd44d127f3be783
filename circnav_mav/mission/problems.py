"""What is wrong with a mission or campaign file, in words for the person who wrote it."""

from difflib import get_close_matches
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from circnav_mav.mission.schema import MissionFile

MOST_PROBLEMS = 8
"""Problems of a file named in one line: more are not read."""
_BOUNDS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}


def in_words(error: ValidationError, schema: type[BaseModel] = MissionFile) -> str:
    """The problems of a file of this schema in words; unknown keys first, for a misspelt key is also a missing one."""
    problems = sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
    missing = [_key(problem) for problem in problems if problem["type"] == "missing"]
    told = [_one_in_words(problem, schema) for problem in problems if problem["type"] != "missing"]
    if missing:
        told.append(f"{', '.join(missing)}: missing, add {'it' if len(missing) == 1 else 'them'}")
    more = f"; and {len(told) - MOST_PROBLEMS} more" if len(told) > MOST_PROBLEMS else ""
    return "; ".join(told[:MOST_PROBLEMS]) + more


def _key(problem: ErrorDetails) -> str:
    return ".".join(str(part) for part in problem["loc"])


def _one_in_words(problem: ErrorDetails, schema: type[BaseModel]) -> str:
    place = [str(part) for part in problem["loc"]]
    key, kind, context = _key(problem), problem["type"], problem.get("ctx", {})
    given = problem.get("input")
    if kind == "extra_forbidden":
        known = list(_table(schema, place[:-1]).model_fields)
        near = get_close_matches(place[-1], known, n=1)
        return f"{key}: unknown key, " + (f"did you mean {near[0]}?" if near else f"known here: {', '.join(known)}")
    if kind == "literal_error":
        return f"{key}: {given!r} is not one of {context['expected']}"
    if kind == "model_type":
        return f"{key}: must be a table, not {given!r}"
    if kind == "finite_number":
        remedy = ": leave it out for none" if _may_be_left_out(schema, place) else ""
        return f"{key}: must be a finite number, not {given}{remedy}"
    bound = next((f"{words} {context[name]:g}" for name, words in _BOUNDS.items() if name in context), None)
    if bound is not None and isinstance(given, int | float):
        return f"{key}: must be {bound}, not {given:g}"
    said = problem["msg"][:1].lower() + problem["msg"][1:]
    return f"{key}: {said.removeprefix('input ')}, not {given!r}{_number_meant(kind, given)}"


def _number_meant(kind: str, given: Any) -> str:
    """The remedy for a number that TOML does not know as one: .5, 1. or one in quotes."""
    if kind not in ("float_type", "int_type") or not isinstance(given, str):
        return ""
    try:
        return f": write {float(given)!r}"
    except ValueError:
        return ""


def _may_be_left_out(schema: type[BaseModel], place: list[str]) -> bool:
    """Whether a key of the schema stands for none where it is left out; one that is needed has no default at all."""
    field = _table(schema, place[:-1]).model_fields.get(place[-1])
    return field is not None and field.default is None


def _table(schema: type[BaseModel], place: list[str]) -> type[BaseModel]:
    """The table of the schema at a place; where part of it is none, the table around that part."""
    model = schema
    for part in place:
        annotation = model.model_fields[part].annotation
        candidates = (annotation, *get_args(annotation))
        inner = next((item for item in candidates if isinstance(item, type) and issubclass(item, BaseModel)), None)
        if inner is None:
            break
        model = inner
    return model
