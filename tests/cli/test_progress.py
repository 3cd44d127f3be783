"""Progress of commands that take longer than a second, on a terminal. The other tests of these
commands check that stderr is empty without a terminal."""

import pytest

from tests.command_line import terminal


@pytest.mark.parametrize(
    ("arguments", "shown"),
    [
        (("replay", "{run}"), "replaying "),
        (("report", "{run}"), "drawing flight.png and report.html"),
        (("plan", "plane"), "computing circles at 22 m/s"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
@pytest.mark.usefixtures("no_pictures")
def test_slow_command_shows_progress_on_terminal(circnav, run, monkeypatch, arguments, shown):
    monkeypatch.setenv("TERM", "xterm")
    with terminal() as on_terminal:
        ran = circnav(*(word.format(run=run) for word in arguments))
    assert ran.code == 0
    assert shown in b"".join(on_terminal).decode()
    assert shown not in ran.out
    assert ran.out
