"""`circnav init` and `circnav schema`: a new mission file, and its JSON schema for editors."""

import json
import os
import re
from pathlib import Path
from typing import Any

import click

from circnav_mav.cli.bundled import bundled, listed_name, names
from circnav_mav.cli.exits import Exit, Refused, refusing, say
from circnav_mav.extension import extensions, load
from circnav_mav.runlog.atomic_write import write_text

SCHEMA = "mission.schema.json"
DRAFT = "http://json-schema.org/draft-07/schema#"


def write_mission(vehicle: str | None, file: str | None) -> int:
    """Copy the bundled mission of a vehicle to a new file. Raises Refused, also if the file
    exists."""
    known = f"one of {', '.join(names('mission'))}"
    if vehicle is None:
        raise Refused(f"init: name a vehicle: {known}")
    source = bundled("mission", vehicle)
    if source is None:
        raise Refused(f"init: {vehicle} is not {known}")
    path = Path(file or f"{vehicle}.toml")
    if not re.fullmatch(r"[A-Za-z0-9._-]+", path.stem):
        raise Refused(
            f"init: {path.name}: a mission's name may have letters, digits, '.', '_' and '-' only"
        )
    text = source.read_text(encoding="utf-8")
    called = listed_name(source)
    text = re.sub(rf"(circnav \w+ ){called}\b", lambda found: found[1] + str(path), text)
    text = text.replace(f'\nname = "{called}"\n', f'\nname = "{path.stem}"\n', 1)
    with refusing(path):
        if os.path.lexists(path):
            raise Refused(
                f"init: {path}: exists already, name another file: circnav init {vehicle} FILE"
            )
        write_text(path, text)
        schema = path.with_name(SCHEMA)
        if not schema.exists():
            write_text(schema, (source.parent / SCHEMA).read_text(encoding="utf-8"))
    about = next((line[2:] for line in text.splitlines() if line.startswith("# ")), "")
    where = "on the bundled emulator" if '\nendpoint = "sim"' in text else "on your vehicle"
    say(f"{path}: {about}\nEvery value has a comment. Adapt the values, then:")
    say(f"  circnav check {path}    # each value against its limits")
    say(f"  circnav fly {path}      # {where}")
    return Exit.DONE


def print_schema(kind: str) -> int:
    """Print the JSON schema of mission or campaign files."""
    click.echo(schema_text(kind), nl=False)
    return Exit.DONE


def schema_text(kind: str) -> str:
    """Return the JSON schema of mission files, or of a kind of file that an extension adds."""
    if kind == "mission":
        from circnav_sim.config import VehicleConfig

        from circnav_mav.mission.load import whole_schema

        table: dict[str, Any] = whole_schema().model_json_schema()
        table["properties"]["sim"] = sim = VehicleConfig.model_json_schema()
        table["$defs"] |= sim.pop("$defs")
    else:
        table = load(
            next(one.schemas[kind] for one in extensions() if kind in one.schemas)
        ).model_json_schema()
    return json.dumps({"$schema": DRAFT, **_plain(table)}, indent=1, ensure_ascii=False) + "\n"


def _plain(node: Any) -> Any:
    """Convert a schema of pydantic for TOML editors: `definitions` as in draft 7, no null, which
    TOML lacks, and no generated titles."""
    if isinstance(node, list):
        return [_plain(one) for one in node if one != {"type": "null"}]
    if isinstance(node, str):
        return node.replace("#/$defs/", "#/definitions/")
    if not isinstance(node, dict):
        return node
    plain = {
        "definitions" if key == "$defs" else key: _plain(value)
        for key, value in node.items()
        if value is not None
    }
    if isinstance(plain.get("title"), str):
        del plain["title"]
    return plain.pop("anyOf")[0] | plain if len(plain.get("anyOf", ())) == 1 else plain
