"""The documents against the code: links, keys, names, columns, messages and commands exist."""

import ast
import re
import shlex
from pathlib import Path
from xml.etree import ElementTree

import click
import pytest
from pydantic import BaseModel

from circnav_mav.cli import circnav as cli
from circnav_mav.cli import fly
from circnav_mav.cli.bundled import names
from circnav_mav.cli.exits import Exit
from circnav_mav.extras.fleet.settings import FleetTable
from circnav_mav.guidance.types import Direction, Orbit
from circnav_mav.mav.autopilots.table import AUTOPILOTS
from circnav_mav.mav.check_result import PASS
from circnav_mav.mission.checks import check_mission
from circnav_mav.mission.load import parse_mission, whole_schema
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.runlog.summary import FlightFacts, summarise
from circnav_mav.runlog.ticks import NO_TICKS
from circnav_mav.runtime.recorder import TICK_COLUMNS

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [
    ROOT / "README.md",
    ROOT / "sim" / "README.md",
    ROOT / "CHANGELOG.md",
    *sorted(DOCS.glob("*.md")),
]
COMMANDS = {
    name: cli.get_command(click.Context(cli), name)
    for name in cli.list_commands(click.Context(cli))
}


def anchor(heading: str) -> str:
    """Return the anchor that GitHub generates for a heading."""
    return re.sub(r"[^a-z0-9 _-]", "", heading.lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_in_documents_have_targets(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if "://" in target:
            continue
        name, _, place = target.partition("#")
        file = page.parent / name if name else page
        assert file.exists(), target
        if place:
            headings = re.findall(r"^#+ (.+)$", file.read_text(), re.MULTILINE)
            assert place in map(anchor, headings), target


def test_docker_user_owns_missions_folder():
    """WORKDIR in a Dockerfile creates a missing folder with owner root."""
    before, _, after = (ROOT / "deploy" / "Containerfile").read_text().partition("USER circnav\n")
    assert "mkdir /missions && chown circnav: /missions" in before
    assert "WORKDIR /missions" in after


def test_readme_links_reach_each_page():
    read = set()
    new = [ROOT / "README.md"]
    while new:
        page = new.pop()
        read.add(page)
        targets = re.findall(r"\]\(([^)#\s]+\.md)", page.read_text())
        new += {(page.parent / target).resolve() for target in targets} - read
    assert set(DOCS.glob("*.md")) <= read


def keys_of(table: type[BaseModel], prefix: str = ""):
    for name, field in table.model_fields.items():
        inner = [
            one
            for one in (field.annotation, *getattr(field.annotation, "__args__", ()))
            if is_table(one)
        ]
        if inner:
            yield from keys_of(inner[0], f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", field


def is_table(annotation) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


WORKED_OUT = ("bounds.max_range_m", "limits.stale_s")
"""Keys with a default that is computed from other keys. The page describes the computation."""


def test_mission_page_has_each_key_with_default():
    page = (DOCS / "mission.md").read_text()
    listed = dict(re.findall(r"^\| `([a-z_0-9.]+)` \| ([^|]+?) \|", page, re.MULTILINE))
    keys = dict(keys_of(whole_schema()))
    for key, field in keys.items():
        default = field.default
        if field.is_required():
            assert listed[key].startswith("needed"), key
        elif default is None:
            assert listed[key] == "-" or key in WORKED_OUT, key
        else:
            assert listed[key].strip('"`') == (
                str(default).lower() if isinstance(default, bool) else str(default)
            ), key
    assert {key for key in listed if "." in key} <= set(keys)


@pytest.mark.parametrize("key", AUTOPILOTS, ids=" ".join)
def test_vehicle_page_has_each_parameter_of_preflight(key):
    autopilot, kind = key
    text = (DOCS / f"{autopilot}-{kind.split()[0]}.md").read_text()
    for rule in AUTOPILOTS[key].parameters:
        for name in rule.requested:
            assert f"`{name}`" in text, name


def test_logs_page_has_each_phase_and_summary_key():
    """tests/runlog/test_ticks.py checks the columns and the rejection reasons on the page."""
    orbit = Orbit(100.0, Direction.CLOCKWISE, 15.0, 0.35)
    facts = FlightFacts("m", "completed", "", orbit, 0, {}, 0, None, "", 0, None)
    text = (DOCS / "logs.md").read_text()
    for key in summarise(facts, NO_TICKS, None):
        assert f"`{key}`" in text, key
    assert all(phase.value in text for phase in Phase)


def test_troubleshooting_page_has_each_exit_code():
    text = (DOCS / "troubleshooting.md").read_text()
    codes = re.findall(r"^\| (\d+) \|", text, re.MULTILINE)
    assert sorted(map(int, codes)) == sorted(code.value for code in Exit)


def test_mission_of_page_is_complete():
    (text,) = re.findall(r"^```toml\n(.*?)^```", (DOCS / "mission.md").read_text(), re.M | re.S)
    mission = parse_mission(text, "mission.md")
    assert [check for check in check_mission(mission) if check.grade is not PASS] == []


def test_ports_of_vehicle_radio_and_fleet_differ():
    template = (ROOT / "config" / "vehicle_udp.toml").read_text()
    ports = re.findall(r'^(?:# )?endpoint = "udpin:0.0.0.0:(\d+)"', template, re.MULTILINE)
    fleet = FleetTable().port
    assert len({*map(int, ports), fleet}) == 3
    page = (DOCS / "own-vehicle.md").read_text()
    assert all(str(port) in page for port in (*ports, fleet))


def test_options_of_printed_commands_exist():
    seen = 0
    for page in PAGES:
        for line in re.sub(r"\\\n\s*", "", page.read_text()).splitlines():
            for command in re.findall(r"(?:^|`|\$ |bin/)(circnav \w+[^`|\n]*)", line.strip()):
                words = shlex.split(command.split("#")[0], posix=False)
                if words[1] not in COMMANDS:
                    continue
                named = COMMANDS[words[1]]
                named = (
                    getattr(named, "commands", {}).get(words[2], named) if len(words) > 2 else named
                )
                known = {flag for option in named.params for flag in option.opts}
                given = {word.strip("[]") for word in words if word.strip("[").startswith("--")}
                assert given <= known, command
                seen += 1
    assert seen > 40


def texts_of_the_code() -> list[str]:
    """Yield every string in the source, with "..." for inserted values."""
    found = []
    for path in (ROOT / "circnav_mav").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
            elif isinstance(node, ast.JoinedStr):
                found.append(
                    "".join(
                        part.value if isinstance(part, ast.Constant) else "..."
                        for part in node.values
                    )
                )
    return found


def test_messages_of_troubleshooting_page_occur_in_source():
    texts = texts_of_the_code()
    rows = re.findall(r"^\| ([^|]+) \|", (DOCS / "troubleshooting.md").read_text(), re.MULTILINE)
    quoted = [message for row in rows for message in re.findall(r"`([^`]+)`", row)]
    assert len(quoted) > 60
    for message in quoted:
        for piece in filter(None, (piece.strip(" ,;:?()") for piece in message.split("..."))):
            assert any(piece in text for text in texts), message


def test_plotjuggler_curves_are_recorded_numeric_columns():
    layout = ElementTree.parse(DOCS / "plotjuggler.xml").getroot()
    curves = list(layout.iter("curve"))
    named = {
        name for curve in curves for name in (curve.get("curve_x"), curve.get("curve_y")) if name
    }
    named |= {curve.get("name") for curve in curves if curve.get("curve_x") is None}
    assert len(curves) > 20
    assert named <= set(TICK_COLUMNS) - {"phase", "law", "mode"}
    assert {"r", "measured", "turn_rate", "yaw_rate_sent", "range_age", "x", "y"} <= named
    assert (
        layout.find(".//plugin[@ID='DataLoad CSV']/parameters").get("time_axis") == TICK_COLUMNS[0]
    )


def test_fly_help_lists_bundled_missions():
    listed = " ".join((fly.help or "").replace("paper-example-1, -2, -3", "").split())
    assert all(name in listed or name.startswith("paper") for name in names("mission"))
