"""Progress of commands that take longer than a second, on a terminal. The other tests of these
commands check that stderr is empty without a terminal."""

import os
import pty

import pytest

from tests.process import circnav, python


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("progress") / "run"
    flight = circnav("fly", "quickstart", "--duration", "20", "--out", str(folder), drawn=False)
    assert flight.wait() == 0
    return folder


@pytest.mark.parametrize(
    ("arguments", "shown"),
    [
        (("replay", "{run}"), "replaying "),
        (("report", "{run}"), "drawing flight.png and report.html"),
        (("plan", "plane"), "computing circles at 22 m/s"),
        (("paper", "--starts", "1", "--out", "{run}/../paper"), "flying the examples"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_slow_command_shows_progress_on_terminal(flown, arguments, shown):
    command = [word.format(run=flown) for word in arguments]
    terminal, other_end = pty.openpty()
    running = python("-m", "circnav_mav", *command, stderr=other_end, TERM="xterm")
    os.close(other_end)
    on_terminal = b"".join(iter(lambda: received(terminal), b""))
    output, _ = running.communicate()
    os.close(terminal)
    assert running.returncode == 0
    assert shown in on_terminal.decode()
    assert shown not in output
    assert output


def received(terminal):
    """Return what a program has written to the terminal, and nothing after its end."""
    try:
        return os.read(terminal, 1 << 16)
    except OSError:
        return b""
