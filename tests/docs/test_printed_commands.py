"""Run every command that README and documents print, with a shorter duration where it would fly for
minutes. Commands that cannot run here are listed with the reason, and their options are checked
against the program."""

import ast
import math
import re
import runpy
import shlex
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from textwrap import dedent

import click
import pytest

from circnav_mav.cli import circnav as cli
from tests.command_line import circnav, undrawn
from tests.docs.test_pages import PAGES, ROOT
from tests.process import UNHURRIED, read_until, running
from tests.process import circnav as process_of

__all__ = ["circnav", "undrawn"]

NOT_RUN = {
    r"python3 -m venv": (
        ".ci/run installs the wheel in an empty folder, and runs the tests by that very line"
    ),
    r"\. \.venv/bin/activate": "the same",
    r"pip install": "the same; the driver of radios.md: test_commands.py",
    r"sudo |pip uninstall": "changes the computer",
    r"docker |deploy/build-deb": "needs a container engine, or builds for minutes",
    r"plotjuggler ": "opens a window; its layout: test_pages.py",
    r"sim_vehicle.py|(PX4_HOME_ALT=0 )?make px4|export CIRCNAV|python -m tests.tools.firmware": (
        "a firmware, for hours"
    ),
    r"python docs/beacon.py": "beside a firmware; tests/flight/test_beacon.py",
    r"python -m tests\.": "minutes to hours, in a checkout; their parts have tests in tests/tools",
    r"circnav emulate .*--endpoint|circnav emulate arducopter": (
        "as the pair of the README, which is run"
    ),
    r"circnav (preflight|fly) (?!quickstart).*--endpoint": (
        "a vehicle; on ports: tests/flight/test_process.py"
    ),
    r"circnav ranging watch \w+:/dev/": "a radio on a serial line; test_commands.py has one",
    r"circnav campaign ": "hours; tests/extras/campaign has small ones, also on a cluster",
    r"circnav locate (runs/|flight\.)": "an earlier flight; tests/extras/locate/test_logs.py",
    r"circnav bench": "minutes to an hour; cells of it: tests/extras/bench/test_command.py",
}
SHORTER = {"fly": "--duration 3", "watch": "--seconds 1"}


def blocks(page: Path):
    """Yield the commands that a page prints, block by block. In a transcript they are the lines
    that begin with $."""
    listing = r"^```(\w*)\n(.*?)^```|((?:^    [^\n]*\n)+)"
    for language, fenced, indented in re.findall(
        listing, page.read_text(), re.MULTILINE | re.DOTALL
    ):
        if language == "sh":
            yield fenced
        elif language in ("", "console"):
            yield "".join(re.findall(r"^\$ (.*\n)", fenced, re.MULTILINE))
        if indented:
            with suppress(SyntaxError):
                ast.parse(dedent(indented))
                continue  # a Python program, not commands
            yield dedent(indented)


def printed(page: Path) -> list[str]:
    """Return the commands of a page, without comments."""
    lines = [line for block in blocks(page) for line in re.sub(r"\\\n\s*", "", block).splitlines()]
    bare = (re.sub(r"(^|\s+)#.*|\s{3,}.*", "", line) for line in lines)
    return [
        command
        for line in bare
        if (command := line.replace("[", "").replace("]", "") if "tests." in line else line)
    ]


def reason(command: str) -> str | None:
    return next((why for pattern, why in NOT_RUN.items() if re.match(pattern, command)), None)


def write_modules(page: Path, folder: Path) -> None:
    """Write the programs of a page that begin with the comment `# name.py`."""
    for block in re.findall(r"^```python\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL):
        if name := re.match(r"# (\w+\.py)\n", block):
            (folder / name[1]).write_text(block)


COMMANDS = {page: printed(page) for page in PAGES}
RUN = [page for page in PAGES if not all(map(reason, COMMANDS[page]))]
KEPT = [
    (page, command)
    for page, commands in COMMANDS.items()
    for command in commands
    if reason(command)
]


@pytest.mark.parametrize("page", RUN, ids=lambda page: page.name)
def test_commands_printed_in_documents_run(page, circnav, undrawn, tmp_path, monkeypatch, port):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.syspath_prepend(tmp_path)
    write_modules(page, tmp_path)
    track = [(t, 47.0 + 0.001 * math.sin(t / 9), 8.5 + 0.0015 * math.cos(t / 9)) for t in range(60)]
    rows = [
        f"{t},{lat:.7f},{lon:.7f},{math.hypot((lat - 47) * 111_200, (lon - 8.5) * 75_900):.2f},17"
        for t, lat, lon in track
    ]
    (tmp_path / "collar.csv").write_text(
        "\n".join(["time,latitude,longitude,range,tag", *rows]) + "\n"
    )
    for command in (
        part for one in COMMANDS[page] if not reason(one) for part in one.split(" && ")
    ):
        words = shlex.split(re.sub(r"\b(14550|5005)\b", str(port), command))
        if words[0] != "circnav":
            subprocess.run(
                ["sh", "-e", "-c", command.replace("~", str(tmp_path))], cwd=tmp_path, check=True
            )
        elif words[1] == "emulate":
            emulator = process_of(*words[1:], "--endpoint", f"udpout:127.0.0.1:{port}")
        elif "--endpoint" in words:
            with running(emulator):
                read_until(emulator, "udpout")
                assert circnav(*words[1:], *SHORTER["fly"].split(), *UNHURRIED).code == 0, command
        else:
            shorter = SHORTER.get(words[1 + (words[1] == "ranging")], "")
            if "locate.enabled=true" in words:
                shorter = "--duration 30"  # a calibration needs a turn
            ran = circnav(*words[1:], *shorter.split())
            no_radio = words[1:3] == ["ranging", "watch"]  # no radio sends here
            assert (ran.code, ran.err) == (3 if no_radio else 0, ""), command


@pytest.mark.parametrize(
    "command",
    dict.fromkeys(command for _, command in KEPT if command.startswith("circnav")),
    ids=str,
)
def test_command_printed_in_documents_has_valid_arguments(command, circnav, tmp_path):
    for name in ("my.toml", "vehicle.toml", "home.toml"):
        (tmp_path / name).write_bytes((ROOT / "config" / "quickstart.toml").read_bytes())
    named = cli
    rest = shlex.split(command)[1:]
    while isinstance(named, click.Group):
        named = named.get_command(click.Context(named), rest[0])
        rest = rest[1:]
    named.make_context(named.name, rest)


OPTIONS: dict[str, set[str]] = {}
"""Options printed on the pages, for each program of this repository."""
for _, one in KEPT:
    if (match := re.match(r"python (-m )?[\w./]+", one)) and "--" in one:
        OPTIONS.setdefault(match[0], set()).update(re.findall(r"--[\w-]+", one))


@pytest.mark.parametrize("program", OPTIONS)
def test_program_has_options_printed_in_documents(program, monkeypatch, capsys):
    name = program.rpartition(" ")[2]
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    monkeypatch.delitem(sys.modules, name, raising=False)
    with pytest.raises(SystemExit):
        if name.endswith(".py"):
            runpy.run_path(str(ROOT / name), run_name="__main__")
        else:
            runpy.run_module(name, run_name="__main__")
    printed = capsys.readouterr().out
    missing = [one for one in sorted(OPTIONS[program]) if not re.search(rf"{one}\b", printed)]
    assert missing == []


def test_each_excluded_command_is_printed_in_documents():
    every = [command for commands in COMMANDS.values() for command in commands]
    assert len(every) > 60
    assert [
        pattern for pattern in NOT_RUN if not any(re.match(pattern, command) for command in every)
    ] == []
