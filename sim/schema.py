"""Strict reading of TOML tables into frozen dataclasses: known keys, values in range, or one clear line."""

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

Section = TypeVar("Section")


class ConfigError(ValueError):
    """A vehicle file that cannot be flown: one line naming the file, the key and the remedy."""


@dataclass(frozen=True)
class Bounds:
    """What a value may be, besides its type."""

    low: float = -math.inf
    high: float = math.inf
    above: float = -math.inf
    choices: tuple[str, ...] = ()
    longest: int = 1_000

    def complaint(self, value: object) -> str | None:
        if isinstance(value, str):
            if self.choices and value not in self.choices:
                return f'"{value}" is not one of {", ".join(self.choices)}{nearest(value, self.choices)}'
            return f"longer than {self.longest} characters" if len(value.encode()) > self.longest else None
        if not isinstance(value, (int, float)) or isinstance(value, bool):
            return None
        if value < self.low or value > self.high:
            return f"{value:g} is outside {self.low:g} .. {self.high:g}"
        return f"{value:g} must be greater than {self.above:g}" if value <= self.above else None


def key(default: Any, **bounds: Any) -> Any:
    """A dataclass field with a default and its bounds (low, high, above, choices, longest)."""
    return field(default=default, metadata={"bounds": Bounds(**bounds)})


def nearest(word: str, known: tuple[str, ...] | list[str]) -> str:
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f', did you mean "{close[0]}"?' if close else ""


def read_table(kind: type[Section], table: object, where: str) -> Section:
    """The table as a `kind`; raises ConfigError naming `where` and the key."""
    if not isinstance(table, Mapping):
        raise ConfigError(f"{where}: must be a table of keys and values, not {_noun(table)}")
    hints = get_type_hints(kind)
    known = [f.name for f in fields(kind)]  # type: ignore[arg-type]
    for name in table:
        if name not in known:
            hint = nearest(str(name), known) or f"; known keys: {', '.join(known)}"
            raise ConfigError(f"{place(where, name)}: unknown key{hint}")
    values = {}
    for f in fields(kind):  # type: ignore[arg-type]
        if f.name in table:
            here = place(where, f.name)
            values[f.name] = _value(hints[f.name], table[f.name], here)
            _check(f.metadata.get("bounds", Bounds()), values[f.name], here)
    return kind(**values)


def _check(bounds: Bounds, value: object, where: str) -> None:
    for one in value if isinstance(value, tuple) else (value,):
        complaint = bounds.complaint(one)
        if complaint:
            raise ConfigError(f"{where}: {complaint}")


def _value(hint: Any, value: object, where: str) -> Any:
    wanted = _without_none(hint)
    if is_dataclass(wanted):
        return read_table(wanted, value, where)  # type: ignore[arg-type]
    if get_origin(wanted) is tuple:
        return _sequence(get_args(wanted), value, where)
    return _scalar(wanted, value, where)


def _without_none(hint: Any) -> Any:
    """`X` of `X | None`."""
    return get_args(hint)[0] if type(None) in get_args(hint) else hint


def _sequence(members: tuple[Any, ...], value: object, where: str) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise ConfigError(f"{where}: must be a list, not {_noun(value)}")
    if members[-1] is Ellipsis:
        return tuple(_value(members[0], v, f"{where}[{i}]") for i, v in enumerate(value))
    if len(value) != len(members):
        raise ConfigError(f"{where}: must have {len(members)} numbers, has {len(value)}")
    pair = tuple(_value(m, v, where) for m, v in zip(members, value, strict=True))
    if pair[0] > pair[-1]:
        raise ConfigError(f"{where}: [{pair[0]:g}, {pair[-1]:g}] is empty, write the lower bound first")
    return pair


def _scalar(wanted: type, value: object, where: str) -> Any:
    if wanted is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not wanted:
        raise ConfigError(f"{where}: must be {_NOUNS[wanted]}, not {_noun(value)}")
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{where}: must be a finite number")
    return value


_NOUNS = {float: "a number", int: "a whole number", bool: "true or false", str: "text in quotes"}


def _noun(value: object) -> str:
    if isinstance(value, str):
        return f'"{value[:40]}"'
    return repr(value) if isinstance(value, (int, float)) else type(value).__name__


def json_schema(kind: type) -> dict[str, Any]:
    """What `read_table` takes, as a JSON schema for editors."""
    hints = get_type_hints(kind)
    properties = {f.name: _schema_of(hints[f.name]) | _limits(f.metadata.get("bounds", Bounds())) for f in fields(kind)}
    return {"type": "object", "additionalProperties": False, "properties": properties}


def _schema_of(hint: Any) -> dict[str, Any]:
    wanted = _without_none(hint)
    if is_dataclass(wanted):
        return json_schema(wanted)  # type: ignore[arg-type]
    if get_origin(wanted) is tuple:
        return {"type": "array", "items": _schema_of(get_args(wanted)[0])}
    return {"type": {float: "number", int: "integer", bool: "boolean", str: "string"}[wanted]}


def _limits(bounds: Bounds) -> dict[str, Any]:
    """Bounds in a schema's words; those of a pair hold for each number, which a schema would say elsewhere."""
    words = {"minimum": bounds.low, "maximum": bounds.high, "exclusiveMinimum": bounds.above}
    limits: dict[str, Any] = {word: limit for word, limit in words.items() if math.isfinite(limit)}
    return limits | ({"enum": list(bounds.choices)} if bounds.choices else {})


def place(where: str, name: object) -> str:
    """`file: section.key`: the first part is the file, dots join what is inside it."""
    return f"{where}.{name}" if ": " in where else f"{where}: {name}"
