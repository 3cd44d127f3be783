"""Reads a mission file. Every error becomes a line that names file and key."""

import os
import re
import tomllib
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError, create_model

from circnav_mav import foreign
from circnav_mav.extension import table_models
from circnav_mav.mission.clashes import clashes
from circnav_mav.mission.mission import SIM, Mission
from circnav_mav.mission.problems import MOST_SHOWN, in_words
from circnav_mav.mission.schema import MissionFile


class MissionError(Exception):
    """Error in a mission file. The message is one line for the author of the file."""


def load_mission(path: str | Path, overrides: Iterable[str] = ()) -> Mission:
    """Read and validate a mission file with `table.key=value` overrides. Raises MissionError."""
    return parse_mission(read_text(Path(path)), str(path), overrides, Path(path).parent)


def read_text(path: Path) -> str:
    """Return the text of a file. Raises MissionError."""
    try:
        return foreign.read_text(path)
    except OSError as error:
        raise MissionError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise MissionError(f"{path}: is not a text file in UTF-8: save it as one") from None


def read_toml(text: str, where: str) -> dict[str, Any]:
    """Return the table of a TOML text. where: name of the text in errors. Raises MissionError."""
    _refuse_long(text, where)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        words = str(error).replace("Cannot overwrite a value", "The key is repeated: delete one")
        if twice := re.match(r"Cannot declare \((.*?)\) twice", words):
            name = ".".join(re.findall(r"\w+", twice[1]))
            rest = words.removeprefix(twice[0])
            words = f"The table [{name}] is repeated: put all its keys under one heading{rest}"
        at = re.search(r"at line (\d+)", words)
        line = text.split("\n")[int(at[1]) - 1].strip()[:MOST_SHOWN] if at else ""
        raise MissionError(
            f"{where}: not valid TOML: {words}" + (f": {line!r}" if line else "") + _remedy(line)
        ) from None


def _remedy(line: str) -> str:
    """Return the remedy for a line with an error that is common in TOML; "" for others."""
    value = line.partition("=")[2].partition("#")[0].strip()
    if re.fullmatch(r"[-+]?\d+,\d+", value):
        return f": write {value.replace(',', '.')}"
    # a text without quotes, or with one of the two
    if re.fullmatch(r"[A-Za-z][\w.:/-]*", word := value.strip("\"'")) and value in (
        word,
        *(f"{quote}{word}" for quote in "\"'"),
        *(f"{word}{quote}" for quote in "\"'"),
    ):
        return f': write "{word}" in quotes'
    return ""


def _refuse_long(text: str, where: str) -> None:
    """Raise MissionError for a text that is much longer than any mission.

    The processor time of parsing and checking grows with the square of the number of keys, and of
    the number of parts of one key: a key of 20,000 dots took 15 s.
    """
    # Limits, chosen above the longest bundled mission. Texts at these limits take 2 s at most.
    lines = text.split("\n")
    measured = {
        "characters": (len(text), 200_000),
        "keys and tables": (len(re.findall(r"=|^[ \t]*\[", text, re.MULTILINE)), 2000),
        "dots in one line": (max(line.count(".") for line in lines), 500),
    }
    for what, (count, most) in measured.items():
        if count > most:
            raise MissionError(
                f"{where}: is not a mission: {count} {what}, at most {most} are read"
            )


def parse_mission(
    text: str, where: str, overrides: Iterable[str] = (), folder: Path | None = None
) -> Mission:
    """Validate the text of a mission file. Raises MissionError.

    where: name of the file in errors.
    folder: base of the relative paths in the file. They become absolute, so that the recorded file
        can be flown again from its run folder.
    """
    table = read_toml(text, where)
    changes = [(*_override(override), override) for override in overrides]
    try:
        _change(table, changes, folder)
        flown = text if table == tomllib.loads(text) else _written(text, changes, folder, table)
        return mission_of(table, where, flown)
    except (
        ValueError,
        OverflowError,
        RecursionError,
    ) as error:  # e.g. a number of thousands of digits
        raise MissionError(f"{where}: cannot be read as a mission: {error}") from None


def _change(table: Any, changes: Iterable[tuple[list[str], Any, str]], folder: Path | None) -> None:
    """Apply overrides (keys, value, text) to a mission's table, and make its paths absolute. Raises
    MissionError."""
    for keys, value, override in changes:
        put(table, keys, value, f"--set {override}")
    if folder is not None:
        _make_absolute(table, folder)


def _written(
    text: str,
    changes: Iterable[tuple[list[str], Any, str]],
    folder: Path | None,
    table: dict[str, Any],
) -> str:
    """Return the text of the file with overrides and absolute paths. Its comments are kept unless
    tomlkit misplaces an override, for example among dotted keys."""
    import tomlkit  # imported here because its import is slow, and most flights have no overrides

    document = tomlkit.parse(text)
    _change(document, changes, folder)
    text = tomlkit.dumps(document)
    try:
        faithful = tomllib.loads(text) == table
    except tomllib.TOMLDecodeError:
        faithful = False
    return text if faithful else tomlkit.dumps(table)


def mission_of(table: Mapping[str, Any], where: str, text: str = "") -> Mission:
    """Validate the parsed table of a mission file. Raises MissionError.

    where: name of the file in errors.
    text: text to record with the flight, or empty.
    """
    if "mission" in table and "vary" in table:
        raise MissionError(f"{where}: is a campaign file, fly it with: circnav campaign {where}")
    try:
        file = whole_schema().model_validate(table)
    except ValidationError as error:
        raise MissionError(f"{where}: {in_words(error, whole_schema())}") from None
    mission = Mission(_with_cruise_speed(file), text)
    if problems := list(clashes(mission)):
        raise MissionError(f"{where}: {'; '.join(problems)}")
    _check_numbers(mission, where)
    return mission


def _with_cruise_speed(file: MissionFile) -> MissionFile:
    """Return the file with the mission's speed as the cruise speed of the bundled plane, unless the
    file gives another one."""
    emulated = (file.sim or {}).get("vehicle", {})
    if file.link.endpoint != SIM or file.vehicle.kind != "plane" or not isinstance(emulated, dict):
        return file
    vehicle = {"cruise_speed_mps": file.vehicle.speed_mps, **emulated}
    return file.model_copy(update={"sim": {**(file.sim or {}), "vehicle": vehicle}})


@cache
def whole_schema() -> type[MissionFile]:
    """Return the schema of a mission file with the tables of the extras that are installed."""
    tables: dict[str, Any] = {name: (model, model()) for name, model in table_models().items()}
    doc = "A mission file. The table `sim` is validated by the bundled vehicle."
    return create_model("MissionFile", __base__=MissionFile, __doc__=doc, **tables)


def _check_numbers(mission: Mission, where: str) -> None:
    """Check that the derived settings can be computed. With a noise of 1e-308 m, for example, they
    overflow. Raises MissionError."""
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            _ = mission.facts, mission.ranging, mission.circle_limits
            mission.tuning.loop_lag(mission.orbit.radius)
    except ArithmeticError as error:
        reason = str(error.args[-1]) if error.args else "not a finite number"
        raise MissionError(
            f"{where}: speed, radius, rate or noise is too small or too large ({reason.lower()})"
        ) from None


def _override(text: str) -> tuple[list[str], Any]:
    """Return keys and value of an override such as `orbit.radius_m=80`. A value that is not TOML
    becomes a string."""
    key, sign, value = text.partition("=")
    if not sign or not key.strip():
        raise MissionError(f"--set {text}: write it as table.key=value")
    try:
        parsed = next(iter(tomllib.loads(f'"{key.strip()}" = {value.strip()}').values()))
    except (ValueError, RecursionError):
        parsed = value.strip()
    return key.strip().split("."), parsed


def put(table: Any, keys: list[str], value: Any, source: str) -> None:
    """Set a key in nested tables, creating missing tables. source: name of the value in errors.
    Raises MissionError."""
    for key in keys[:-1]:
        table = table.setdefault(key, {})
        if not isinstance(table, Mapping):
            raise MissionError(f"{source}: {key} is a value, not a table")
    table[keys[-1]] = value


def _make_absolute(table: Any, folder: Path) -> None:
    """Make the key file paths of a mission, its bundled vehicle and its extras absolute. In the
    file, these paths are relative to the folder of the file, or begin with `~`."""
    sim = table.get("sim")
    tables = {**table, "sim.signing": sim.get("signing") if isinstance(sim, Mapping) else None}
    for place in tables.values():
        if isinstance(place, Mapping) and isinstance(name := place.get("key_file"), str) and name:
            # not Path.expanduser, which raises for an unknown user
            place["key_file"] = str((folder / os.path.expanduser(name)).absolute())  # type: ignore[index]
