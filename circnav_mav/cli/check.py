"""`circnav check`."""

from pathlib import Path

import click

from circnav_mav.cli.bundled import check_bundled
from circnav_mav.cli.exits import Exit, Refused
from circnav_mav.mav.check_result import Check, Grade
from circnav_mav.mission.checks import check_mission
from circnav_mav.mission.load import MissionError, load_mission
from circnav_mav.mission.mission import SIM, Mission
from circnav_mav.runtime.keys import KeyFileError, read_key
from circnav_mav.runtime.links import LinkError, parse_endpoint
from sim.config import ConfigError, parse_vehicle

COLOURS = {Grade.PASS: "green", Grade.WARN: "yellow", Grade.FAIL: "red"}


def read_mission(path: str, overrides: tuple[str, ...]) -> Mission:
    """A mission file with its endpoints, its [sim] table and its signing key checked too. Raises Refused."""
    try:
        mission = load_mission(path, overrides)
        for endpoint in (mission.file.link.endpoint, mission.file.ranging.endpoint):
            if endpoint not in (None, SIM):
                parse_endpoint(endpoint)
        if mission.file.sim is not None:
            parse_vehicle(mission.file.sim, f"{path}: sim")
        if mission.file.signing is not None:
            read_key(Path(mission.file.signing.key_file))
    except KeyFileError as error:
        raise Refused(f"{path}: signing.key_file: {error}") from None
    except (MissionError, ConfigError, LinkError) as error:
        raise Refused(str(error)) from None
    return mission


def all_checks(mission: Mission) -> list[Check]:
    """The lines of the mission, and of its bundled vehicle if it flies that."""
    lines = check_mission(mission)
    if mission.flies_sim and mission.file.sim is not None:
        lines += check_bundled(mission, parse_vehicle(mission.file.sim, "sim"))
    return lines


def check_file(path: str, overrides: tuple[str, ...]) -> int:
    """Print every line; fail if one of them does."""
    lines = all_checks(read_mission(path, overrides))
    show_checks(lines)
    counts = {grade: sum(line.grade is grade for line in lines) for grade in Grade}
    click.echo(f"{path}: " + ", ".join(f"{count} {grade.value}" for grade, count in counts.items()))
    return Exit.USAGE if counts[Grade.FAIL] else Exit.DONE


def show_checks(lines: list[Check]) -> None:
    """Print check lines, the grade in its colour."""
    for line in lines:
        grade = click.style(f"{line.grade.value:<4}", fg=COLOURS[line.grade], bold=line.grade is not Grade.PASS)
        click.echo(f"{grade}  {line.subject:<11} {line.says}")
