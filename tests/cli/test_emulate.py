"""How `circnav emulate` begins and ends; its flights are tested with the emulator."""

import signal

import pytest

from tests.process import PATIENCE
from tests.process import circnav as process_of


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
