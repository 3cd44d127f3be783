"""Wrong options and mission keys of the survey: one line, and no file written."""

import pytest


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ("check mission.toml --set locate.camera=true", "mission.toml: locate.camera: unknown key"),
        ("locate nowhere", "nowhere: no such file"),
        ("locate x --out=", "--out: is empty, give it a name"),
    ],
)  # fmt: skip
def test_it_is_one_line_and_nothing_is_written(circnav, mission, command, says):
    assert circnav(*command.split()).refused.startswith(says)
    assert list(mission.parent.iterdir()) == [mission]


def test_an_error_of_positions_that_no_receiver_has_is_exit_code_2(circnav):
    ran = circnav("locate", "x.csv", "--gps-sigma", "1e-200")
    assert ran.code == 2 and "Error: " in ran.err
