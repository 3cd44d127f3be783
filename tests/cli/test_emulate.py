"""`circnav emulate` where it cannot run; its flights are tested with the emulator."""

import signal

import pytest

from tests.process import PATIENCE
from tests.process import circnav as process_of


@pytest.mark.parametrize("speed", ["0", "-1", "101", "nan"])
def test_a_speed_out_of_its_bounds(circnav, speed):
    line = circnav("emulate", "--speed", speed).refused
    assert line == f"--speed: must be above 0 and at most 100, not {float(speed):g}"


@pytest.mark.parametrize(
    ("arguments", "named"),
    [(["nowhere.toml"], "nowhere.toml"), (["--endpoint", "ftp:here:21"], "ftp"), (["--endpoint", "BUSY"], "in use")],
    ids=["no file", "no endpoint", "port in use"],
)
def test_what_cannot_be_started_is_one_line(circnav, busy_port, arguments, named):
    arguments = [word.replace("BUSY", f"udpin:127.0.0.1:{busy_port}") for word in arguments]
    assert named in circnav("emulate", *arguments).refused


def test_at_another_speed_it_says_how_to_be_flown(circnav, busy_port, monkeypatch):
    monkeypatch.setattr("circnav_mav.emulator.server._fly", lambda *_arguments: None)
    emulate = ("emulate", "--endpoint", f"udpout:127.0.0.1:{busy_port}")
    _, how = circnav(*emulate, "--speed", "8").done.splitlines()
    assert how == """8 times real time: fly it with --set 'link.clock="autopilot"'"""
    assert len(circnav(*emulate).done.splitlines()) == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_ends_when_asked(number, busy_port):
    """It speaks to a port that somebody has, once its own are open it says so in a line."""
    with process_of("emulate", "--endpoint", f"udpout:127.0.0.1:{busy_port}") as process:
        try:
            assert process.stdout.readline()
            process.send_signal(number)
            _, err = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    assert (process.returncode, err) == (0, "")
