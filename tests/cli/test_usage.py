"""Wrong use of any command: one line that names the mistake, exit code 2, and no file written."""

import pytest


@pytest.mark.parametrize(
    ("command", "error"),
    [
        ("fly nowhere.toml", "nowhere.toml: cannot be read: No such file or directory"),
        ("fly quikstart", "quikstart: is not a file and not a bundled mission, did you mean quick"),
        ("fly config/px4_plane.toml", "config/px4_plane.toml: no such file; give the bundled one"),
        ("fly mission.toml --set orbit.radius_m", "--set orbit.radius_m: write it as"),
        (
            "check mission.toml --set orbit.radius_m=0",
            "--set orbit.radius_m=0: orbit.radius_m: must",
        ),
        ("fly mission.toml --speed 8", "--speed: only the bundled vehicle can be simulated faster"),
        ("fly mission.toml --endpoint udpin:127.0.0.1:BUSY", "endpoint udpin:127.0.0.1:BUSY: port"),
        (
            "fly mission.toml --set ranging.endpoint=udpin:127.0.0.1:BUSY",
            "endpoint udpin:127.0.0.1:BUSY: port is in use",
        ),
        ("check mission.toml --set signing.key_file=~nosuchuser/key", "mission.toml: signing.key_"),
        ("fly mission.toml --out LONG", "LONG: File name too long"),
        ("check LONG.toml", "LONG.toml: File name too long"),
        ("fly mission.toml --out /dev/null/run", "/dev/null/run: cannot be written: Not a direct"),
        ("check mission.toml --set ranging.endpoint=udpin:14550", "endpoint 'udpin:14550': "),
        *(
            (f"{command} mission.toml --set guidance.gain=1e-5", "mission.toml: refused by its")
            for command in ("fly", "preflight")
        ),
        *(
            (
                f"{command} mission.toml --set sim.ranging.nois_m=1.0",
                "--set sim.ranging.nois_m=1.0: sim.r",
            )
            for command in ("check", "fly", "preflight")
        ),
        ("preflight copter --seconds 0", "--seconds: must be at least 1 and at most 600, not 0"),
        ("init zeppelin", "init: zeppelin is not one of campaign-mission, copter,"),
        ("init plane my+plane.toml", "init: my+plane.toml: a mission's name may have letters"),
        ("init plane mission.toml", "init: mission.toml: exists already"),
        ("emulate --speed 0", "--speed: must be above 0 and at most 100, not 0"),
        ("emulate --speed nan", "--speed: must be above 0 and at most 100, not nan"),
        ("emulate nowhere.toml", "nowhere.toml: "),
        ("emulate --endpoint ftp:here:21", '"ftp:here:21" is not an endpoint'),
        ("emulate --endpoint udpin:127.0.0.1:BUSY", "udpin:127.0.0.1:BUSY: cannot be opened"),
        ("report nowhere", "nowhere: no such run folder"),
        ("replay nowhere", "nowhere: no such run folder"),
        ("fly mission.toml --out=", "--out: is empty, give it a name"),
        ("replay x --out=", "--out: is empty, give it a name"),
    ],
)
def test_wrong_usage_prints_one_error_line_without_writing(
    circnav, mission, busy_port, command, error
):
    command, error = (
        text.replace("BUSY", str(busy_port)).replace("LONG", 300 * "x") for text in (command, error)
    )
    assert circnav(*command.split()).refused.startswith(error)
    assert list(mission.parent.iterdir()) == [mission]


def test_parser_errors_exit_with_2_and_interrupts_130(circnav, monkeypatch):
    wrong = ("fligh", "fly", "check a.toml b.toml", "fly quickstart --duration -5")
    infinite = ("--speed nan", "--fleet 2 --fleet-loss nan", "--fleet 2 --fleet-delay nan")
    for arguments in (*wrong, *(f"fly quickstart {option}" for option in infinite)):
        ran = circnav(*arguments.split())
        assert ran.code == 2
        assert "Error: " in ran.err
        assert "Traceback" not in ran.err

    def interrupted(path, text):
        raise KeyboardInterrupt

    monkeypatch.setattr("circnav_mav.cli.init.write_text", interrupted)
    assert circnav("init", "plane").code == 130
