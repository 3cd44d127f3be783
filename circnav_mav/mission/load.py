"""Reads a mission file. Whatever is wrong becomes one line that names file and key."""

import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any, get_args

import numpy as np
from pydantic import BaseModel, ValidationError, create_model
from pydantic_core import ErrorDetails

from circnav_mav import foreign
from circnav_mav.extension import table_models
from circnav_mav.mav.autopilots.table import allowed, table_key
from circnav_mav.mav.ranging.driver import split_driver
from circnav_mav.mission.mission import SIM, Mission
from circnav_mav.mission.schema import MissionFile

MOST_PROBLEMS, MOST_SHOWN = 8, 60
"""Problems of a file named in one line, and characters of a line that is wrong: more are not read."""
_BOUNDS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}


class MissionError(Exception):
    """A mission that cannot be flown as written; the message is one line for the person who wrote it."""


def load_mission(path: str | Path, overrides: Iterable[str] = ()) -> Mission:
    """Read and validate a mission file with `table.key=value` overrides. Raises MissionError."""
    return parse_mission(read_text(Path(path)), str(path), overrides, Path(path).parent)


def read_text(path: Path) -> str:
    """The text of a file. Raises MissionError."""
    try:
        return foreign.read_text(path)
    except OSError as error:
        raise MissionError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise MissionError(f"{path}: is not a text file in UTF-8") from None


def read_toml(text: str, where: str) -> dict[str, Any]:
    """The table of a TOML text; `where` names it in errors. Raises MissionError."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        at = re.search(r"at line (\d+)", str(error))
        line = text.split("\n")[int(at[1]) - 1].strip()[:MOST_SHOWN] if at else ""
        raise MissionError(f"{where}: not valid TOML: {error}" + (f": {line!r}" if line else "")) from None


def parse_mission(text: str, where: str, overrides: Iterable[str] = (), folder: Path | None = None) -> Mission:
    """Validate the text of a mission file; `where` names it in errors. folder: that its paths are relative to; they
    become absolute, so that the file as flown can be flown again from its run folder. Raises MissionError."""
    table = read_toml(text, where)
    changes = [(*_override(override), override) for override in overrides]
    try:
        _change(table, changes, folder, where)
        flown = text if table == tomllib.loads(text) else _written(text, changes, folder, table)
        return mission_of(table, where, flown)
    except (ValueError, OverflowError, RecursionError) as error:  # as of a number of thousands of digits
        raise MissionError(f"{where}: cannot be read as a mission: {error}") from None


def _change(table: Any, changes: Iterable[tuple[list[str], Any, str]], folder: Path | None, where: str) -> None:
    """Put overrides (keys, value, as written) into a mission's table, and make its paths absolute. Raises
    MissionError."""
    for keys, value, override in changes:
        put(table, keys, value, f"--set {override}")
    if folder is not None:
        _make_absolute(table, folder, where)


def _written(
    text: str, changes: Iterable[tuple[list[str], Any, str]], folder: Path | None, table: dict[str, Any]
) -> str:
    """The file as flown: with its comments, unless tomlkit puts an override where it does not belong, as among dotted
    keys."""
    import tomlkit  # slow to load and to parse, and most files are flown as they are

    document = tomlkit.parse(text)
    _change(document, changes, folder, "as flown")
    text = tomlkit.dumps(document)
    try:
        faithful = tomllib.loads(text) == table
    except tomllib.TOMLDecodeError:
        faithful = False
    return text if faithful else tomlkit.dumps(table)


def mission_of(table: Mapping[str, Any], where: str, text: str = "") -> Mission:
    """Validate the parsed table of a mission file; `text` is the file as flown, where anybody keeps it. Raises
    MissionError."""
    if "mission" in table and "vary" in table:
        raise MissionError(f"{where}: is a campaign file, fly it with: circnav campaign {where}")
    try:
        file = whole_schema().model_validate(table)
    except ValidationError as error:
        raise MissionError(f"{where}: {in_words(error, whole_schema())}") from None
    if clashes := list(_clashes(file)):
        raise MissionError(f"{where}: {'; '.join(clashes)}")
    mission = Mission(file, text)
    _check_numbers(mission, where)
    return mission


@cache
def whole_schema() -> type[MissionFile]:
    """Return the schema of a mission file with the tables of the extras that are installed."""
    tables: dict[str, Any] = {name: (model, model()) for name, model in table_models().items()}
    doc = "The whole file. `sim` belongs to the bundled vehicle, which checks it itself."
    return create_model("MissionFile", __base__=MissionFile, __doc__=doc, **tables)


def _clashes(file: MissionFile) -> Iterator[str]:
    """What each key allows and the file as a whole does not."""
    vehicle, orbit, ranging = file.vehicle, file.orbit, file.ranging
    if file.link.endpoint == SIM and file.sim is None:
        yield f'link.endpoint: is "{SIM}", which needs a [sim] table describing the vehicle'
    if ranging.endpoint == SIM and file.link.endpoint != SIM:
        yield f'ranging.endpoint: is "{SIM}" but the vehicle is not the bundled one: --set ranging.endpoint=URL'
    if split_driver(ranging.endpoint or "")[0] and ranging.message != "ranging_beacon":
        yield f'ranging.message: is "{ranging.message}", a driver gives "ranging_beacon": set that'
    if file.signing and file.signing.accept_unsigned == "ranging" and ranging.endpoint is None:
        yield 'signing.accept_unsigned: is "ranging", which needs a ranging.endpoint of its own'
    if ranging.rate_name is not None and ranging.message != "named_value_float":
        yield f'ranging.rate_name: goes with message = "named_value_float", not with "{ranging.message}"'
    if ranging.rate_name == ranging.name:
        yield f'ranging.rate_name: is "{ranging.name}" as ranging.name: give the rate a name of its own'
    if file.guidance.estimator == "measured" and ranging.rate_name is None:
        yield 'guidance.estimator: is "measured", which needs a radio that measures the range rate: ranging.rate_name'
    rows = allowed(*table_key(vehicle.autopilot, vehicle.kind, vehicle.method)).values()
    if vehicle.max_bank_deg is None and any(row.banks for row in rows):
        yield f"vehicle.max_bank_deg: missing, a {vehicle.kind} turns by banking: add its limit"
    elif vehicle.max_bank_deg is None and vehicle.max_turn_rate_deg_s is None:
        yield "vehicle.max_turn_rate_deg_s: missing, add it"
    ways = ("height_above_target_m", "target_altitude_m", "target_above_home_m")
    given = [f"orbit.{way}" for way in ways if getattr(orbit, way) is not None]
    if len(given) > 1:
        yield f"{' and '.join(given)}: the height is given in one way only: keep one of them"
    # in the other order a flight would end as it begins, or no range would count
    for table, quantity in (("bounds", "range_m"), ("bounds", "altitude_m"), ("ranging", "range_m")):
        low, high = (getattr(getattr(file, table), f"{side}_{quantity}") for side in ("min", "max"))
        if low is not None and high is not None and low >= high:
            most = f"{table}.max_{quantity} = {high:g}"
            yield f"{table}.min_{quantity}: {low:g} is not below {most}: lower it, or raise the other"


def _check_numbers(mission: Mission, where: str) -> None:
    """What follows from the file must be a number: 1e-308 m of noise leave none. Raises MissionError."""
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            mission.pilot_settings()
            _ = mission.loop_lag
    except ArithmeticError as error:
        reason = str(error.args[-1]) if error.args else "no number"
        raise MissionError(
            f"{where}: speed, radius, rate or noise is too small or too large to compute with ({reason.lower()})"
        ) from None


def _override(text: str) -> tuple[list[str], Any]:
    """`orbit.radius_m=80` as keys and a TOML value; what is not TOML is taken as a string."""
    key, sign, value = text.partition("=")
    if not sign or not key.strip():
        raise MissionError(f"--set {text}: write it as table.key=value")
    try:
        parsed = next(iter(tomllib.loads(f'"{key.strip()}" = {value.strip()}').values()))
    except (ValueError, RecursionError):
        parsed = value.strip()
    return key.strip().split("."), parsed


def put(table: Any, keys: list[str], value: Any, said: str) -> None:
    """Set a key of nested tables, made where they are missing; `said` names it in errors. Raises MissionError."""
    for key in keys[:-1]:
        table = table.setdefault(key, {})
        if not isinstance(table, Mapping):
            raise MissionError(f"{said}: {key} is a value, not a table")
    table[keys[-1]] = value


def _make_absolute(table: Any, folder: Path, where: str) -> None:
    """The key files of a mission and of its bundled vehicle: relative to the folder of the file, `~` from home."""
    for place in (table, table.get("sim")):
        signing = place.get("signing") if isinstance(place, Mapping) else None
        if isinstance(signing, Mapping) and isinstance(name := signing.get("key_file"), str) and name:
            if "\0" in name:
                raise MissionError(f"{where}: signing.key_file: {name!r} holds a character that no file's name has")
            # not Path.expanduser: it raises for a user that is not there
            signing["key_file"] = str((folder / os.path.expanduser(name)).absolute())  # type: ignore[index]


# --- what is wrong with a file, in words ---


def in_words(error: ValidationError, schema: type[BaseModel]) -> str:
    """Describe the problems of a file of this schema; unknown keys first, for a misspelled key is also a missing
    one."""
    problems = sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
    missing = [".".join(map(str, problem["loc"])) for problem in problems if problem["type"] == "missing"]
    told = [_one_in_words(problem, schema) for problem in problems if problem["type"] != "missing"]
    if missing:
        told.append(f"{', '.join(missing)}: missing, add {'it' if len(missing) == 1 else 'them'}")
    more = f"; and {len(told) - MOST_PROBLEMS} more" if len(told) > MOST_PROBLEMS else ""
    return "; ".join(told[:MOST_PROBLEMS]) + more


def _one_in_words(problem: ErrorDetails, schema: type[BaseModel]) -> str:
    place = list(map(str, problem["loc"]))
    key, kind, context, given = ".".join(place), problem["type"], problem.get("ctx", {}), problem.get("input")
    if kind == "extra_forbidden":
        known = list(_table(schema, place[:-1]).model_fields)
        anywhere = {key.rpartition(".")[2]: key for key in _keys(schema)}
        near = get_close_matches(place[-1], known, n=1)
        near = near or [anywhere[name] for name in get_close_matches(place[-1], anywhere, n=1, cutoff=0.7)]
        return f"{key}: unknown key, " + (f"did you mean {near[0]}?" if near else f"known here: {', '.join(known)}")
    if kind == "literal_error":
        return f"{key}: {_shown(given)} is not one of {context['expected']}"
    if kind == "model_type":
        return f"{key}: must be a table, not {_shown(given)}"
    if kind == "finite_number":
        field = _table(schema, place[:-1]).model_fields.get(place[-1])
        # a key that is needed has no default at all
        remedy = ": leave it out for none" if field is not None and field.default is None else ""
        return f"{key}: must be a finite number, not {given}{remedy}"
    bound = next((f"{words} {context[name]:g}" for name, words in _BOUNDS.items() if name in context), None)
    if bound is not None and isinstance(given, int | float):
        return f"{key}: must be {bound}, not {given:g}"
    said = problem["msg"][:1].lower() + problem["msg"][1:]
    return f"{key}: {said.removeprefix('input ')}, not {_shown(given)}{_number_meant(kind, given)}"


def _shown(given: Any) -> str:
    """A value as Python writes it, its beginning if it is long."""
    return repr(given)[:MOST_SHOWN]


def _number_meant(kind: str, given: Any) -> str:
    """The remedy for a number that TOML does not know as one: .5, 1. or one in quotes."""
    if kind not in ("float_type", "int_type") or not isinstance(given, str):
        return ""
    try:
        return f": write {float(given)!r}"
    except ValueError:
        return ""


def _keys(table: type[BaseModel], before: str = "") -> Iterator[str]:
    """The keys of a table and of those within it, dotted."""
    for name in table.model_fields:
        inner = _inner(table, name)
        yield from [before + name] if inner is None else _keys(inner, f"{before}{name}.")


def _table(schema: type[BaseModel], place: list[str]) -> type[BaseModel]:
    """The table of the schema at a place; where part of it is none, the table around that part."""
    model = schema
    for part in place:
        inner = _inner(model, part)
        if inner is None:
            return model
        model = inner
    return model


def _inner(table: type[BaseModel], name: str) -> type[BaseModel] | None:
    """The table that a key of a table holds, if it does."""
    annotation = table.model_fields[name].annotation
    kinds = [kind for kind in (annotation, *get_args(annotation)) if isinstance(kind, type)]
    return next((kind for kind in kinds if issubclass(kind, BaseModel)), None)
