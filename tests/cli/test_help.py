"""Help and version."""

import tomllib

import pytest

from circnav_mav import __version__
from circnav_mav.cli import circnav as cli
from tests.process import ROOT


@pytest.mark.parametrize("flag", ["--help", "-h"])
def test_the_help_names_the_commands_in_the_order_of_a_newcomer_and_the_exit_codes(circnav, flag):
    out = circnav(flag).done
    for word in ("Exit codes", "130", "circnav fly quickstart"):
        assert word in out
    commands = [line.split()[0] for line in out.partition("Commands:\n")[2].splitlines()]
    assert commands[:4] == ["fly", "init", "check", "preflight"]


@pytest.mark.parametrize("command", cli.commands)
def test_every_command_has_help_with_an_example(circnav, command):
    out = circnav(command, "--help").done
    assert "Example" in out
    assert f"    circnav {command} " in out


def test_the_version_is_that_of_the_package(circnav):
    assert circnav("--version").done == f"circnav, version {__version__}\n"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["project"]["version"] == __version__
