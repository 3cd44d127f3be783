"""Bundled missions by name, a custom mission, and its schema."""

import json
import tomllib

import pytest

from circnav_mav.cli.bundled import CONFIG, bundled, names
from circnav_mav.cli.init import schema_text
from circnav_mav.mission.load import load_mission

SCHEMA = "mission.schema.json"
TOML = [*CONFIG.glob("*.toml"), *(CONFIG / "campaigns").glob("*.toml")]


def test_bundled_missions_are_found_from_any_folder(circnav, tmp_path):
    for name in ("quickstart", "px4-copter", "px4_copter", "plane", "ArduPlane"):
        assert circnav("check", name).done
    (tmp_path / "quickstart").write_text("name = 3")
    assert circnav("check", "quickstart").refused.startswith("quickstart: name: ")


def test_bundled_mission_flies_under_its_listed_name():
    for name in names("mission"):
        assert load_mission(bundled("mission", name)).file.name == name


@pytest.mark.parametrize("vehicle", ["copter", "plane", "rover", "px4-copter", "px4-plane", "home"])
def test_init_writes_a_flyable_commented_mission(circnav, tmp_path, vehicle):
    out = circnav("init", vehicle, "mine.toml").done
    text = (tmp_path / "mine.toml").read_text()
    assert "circnav fly mine.toml" in text
    assert "circnav fly mine.toml      # on the bundled emulator" in out
    assert text.count("  # ") > 15
    table = tomllib.loads(text)
    assert (table["name"], table["link"]["endpoint"]) == ("mine", "sim")
    assert circnav("check", "mine.toml").done


def test_init_without_argument_lists_vehicles(circnav):
    assert circnav("init").refused.startswith("init: name a vehicle: one of ")


def test_init_refuses_existing_file(circnav, tmp_path):
    (tmp_path / "plane.toml").write_text("mine")
    (tmp_path / "mission.schema.json").write_text("mine too")
    line = circnav("init", "plane").refused
    assert line == "init: plane.toml: exists already, name another file: circnav init plane FILE"
    assert circnav("init", "plane", "other.toml").done
    assert [(tmp_path / name).read_text() for name in ("plane.toml", "mission.schema.json")] == [
        "mine",
        "mine too",
    ]


def test_bundled_schema_equals_printed_schema(circnav):
    printed = json.loads(circnav("schema", "mission").out)
    shipped = json.loads((CONFIG / SCHEMA).read_text())
    for part in ("properties", "definitions"):
        assert printed[part].items() <= shipped[part].items()
    vehicle = json.loads(schema_text("mission"))["definitions"]["Airframe"]["properties"]
    assert vehicle["max_bank_deg"] == {"type": "number", "exclusiveMinimum": 0.0, "maximum": 80.0}


@pytest.mark.parametrize("path", TOML, ids=lambda path: path.stem)
def test_every_bundled_file_follows_its_schema(path):
    first, _, _ = path.read_text().partition("\n")
    schema = json.loads((path.parent / first.removeprefix("#:schema ")).read_text())
    keeps_to(schema, tomllib.loads(path.read_text()), schema)


KINDS = {
    "number": (int, float),
    "integer": int,
    "string": str,
    "object": dict,
    "array": list,
    "boolean": bool,
}


def keeps_to(schema, value, root) -> None:
    """Check a value against a schema, by the JSON schema keywords that circnav uses."""
    if "$ref" in schema:
        schema = root["definitions"][schema["$ref"].rsplit("/", 1)[1]] | schema
    kinds = tuple(KINDS.get(one.get("type"), object) for one in schema.get("anyOf", [schema]))
    assert isinstance(value, kinds)
    assert value in schema.get("enum", [value])
    if isinstance(value, dict) and schema.get("additionalProperties") is not True:
        assert set(schema.get("required", ())) <= set(value) <= set(schema["properties"])
        for key, inner in value.items():
            keeps_to(schema["properties"][key], inner, root)


@pytest.mark.parametrize(
    ("name", "setting", "words"),
    [
        ("quickstart", "sim.wind.speed_mps=3", "sim.wind.speed_mps has no effect"),
        ("campaign-mission", "sim.wind.speed_mps=3", ""),
        ("quickstart", "sim.ranging.noise_m=1.1", "noise_m = 1.1, but ranging.sigma_m = 0.5"),
        ("quickstart", "sim.ranging.noise_m=0.9", ""),
    ],
)
def test_check_warns_of_emulator_settings_without_effect(name, setting, words, circnav):
    out = circnav("check", name, "--set", setting).done
    assert ("WARN  sim" in out) == bool(words)
    assert words in out
