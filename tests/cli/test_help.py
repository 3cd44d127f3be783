"""Help, version, usage; and that help waits for nothing heavy."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from circnav_mav import __version__
from circnav_mav.cli import circnav as cli


@pytest.mark.parametrize("flag", ["--help", "-h"])
def test_the_help_names_the_commands_and_the_exit_codes(circnav, flag):
    ran = circnav(flag)
    assert ran.code == 0
    for word in ("fly", "emulate", "check", "Exit codes", "130", "circnav fly quickstart"):
        assert word in ran.out
    assert ran.err == ""


@pytest.mark.parametrize("command", sorted(cli.commands))
def test_every_command_has_help_with_an_example(circnav, command):
    ran = circnav(command, "--help")
    assert ran.code == 0
    assert "Example" in ran.out
    assert f"    circnav {command} " in ran.out


@pytest.mark.parametrize("option", ["--endpoint", "--set", "--speed", "--duration", "--out", "--dry-run"])
def test_the_help_of_fly_knows_its_options(circnav, option):
    assert option in circnav("fly", "--help").out


def test_the_version_is_that_of_the_package(circnav):
    ran = circnav("--version")
    assert (ran.code, ran.out) == (0, f"circnav, version {__version__}\n")
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["project"]["version"] == __version__


@pytest.mark.parametrize(
    "arguments",
    [
        ["fligh"],
        ["fly"],
        ["check"],
        ["fly", "m.toml", "--speed", "fast"],
        ["fly", "m.toml", "--nonsense"],
        ["check", "a.toml", "b.toml"],
        ["emulate", "--speed", "x"],
        ["replay"],
        ["export"],
        ["report"],
        ["paper", "--starts", "x"],
    ],
    ids=" ".join,
)
def test_bad_usage_is_exit_code_2(circnav, arguments):
    ran = circnav(*arguments)
    assert ran.code == 2
    assert "Error: " in ran.err
    assert "Traceback" not in ran.err


def test_help_waits_for_neither_numpy_nor_filterpy():
    """filterpy pulls scipy: 0.6 s."""
    program = (
        "import sys, json, contextlib, io\n"
        "from circnav_mav.cli import main\n"
        "sys.argv = ['circnav', '--help']\n"
        "with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):\n"
        "    main()\n"
        "print(json.dumps(sorted(sys.modules)))\n"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    heavy = {"numpy", "scipy", "filterpy", "pymavlink", "matplotlib", "pydantic", "rich", "tomlkit"}
    assert not heavy & set(json.loads(ran.stdout))


def test_the_package_runs_as_a_module():
    ran = subprocess.run([sys.executable, "-m", "circnav_mav", "--version"], capture_output=True, text=True, check=True)
    assert __version__ in ran.stdout
