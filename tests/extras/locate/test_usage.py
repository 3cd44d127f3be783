"""Wrong options and mission keys of the locator: one line, and no file written."""

import pytest


@pytest.mark.parametrize(
    ("command", "error"),
    [
        (
            "check mission.toml --set locate.camera=true",
            "--set locate.camera=true: locate.camera: unknown key",
        ),
        ("locate nowhere", "nowhere: no such file"),
        ("locate x --out=", "--out: is empty, give it a name"),
    ],
)  # fmt: skip
def test_wrong_usage_prints_one_error_line_without_writing(circnav, mission, command, error):
    assert circnav(*command.split()).refused.startswith(error)
    assert list(mission.parent.iterdir()) == [mission]
