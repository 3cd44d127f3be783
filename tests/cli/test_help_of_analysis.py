"""The commands that look at flights: help with an example, bad usage is exit code 2."""

import pytest


@pytest.mark.parametrize("command", ["replay", "export", "paper", "report"])
def test_every_command_has_help_with_an_example(circnav, command):
    ran = circnav(command, "--help")
    assert ran.code == 0
    assert "Example" in ran.out
    assert f"    circnav {command} " in ran.out


@pytest.mark.parametrize("arguments", [["replay"], ["export"], ["report"], ["paper", "--starts", "x"]], ids=" ".join)
def test_bad_usage_is_exit_code_2(circnav, arguments):
    ran = circnav(*arguments)
    assert ran.code == 2
    assert "Traceback" not in ran.err
