"""Wrong use of any command: one line that names the mistake, exit code 2, and no file written."""

import pytest

from circnav_mav.cli.bundled import names

PORT_IN_USE = (
    "endpoint udpin:127.0.0.1:BUSY: port is in use by another program: close it, or choose another"
    " port"
)


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ("fly nowhere.toml", "nowhere.toml: cannot be read: No such file or directory"),
        (
            "fly quikstart",
            "quikstart: is not a file and not a bundled mission, did you mean quickstart?; "
            f"bundled: {', '.join(names('mission'))}",
        ),
        (
            "fly config/px4_plane.toml",
            "config/px4_plane.toml: no such file; give the bundled one by its name: px4-",
        ),
        (
            "fly mission.toml --set orbit.radius_m",
            "--set orbit.radius_m: write it as table.key=value",
        ),
        (
            "fly mission.toml --duration -5",
            "mission.toml: limits.duration_s: must be above 0, not -5",
        ),
        (
            "fly mission.toml --speed 8",
            "--speed: only the bundled vehicle can be simulated faster, not udpin:127.",
        ),
        ("fly mission.toml --endpoint udpin:127.0.0.1:BUSY", PORT_IN_USE),
        ("fly mission.toml --set ranging.endpoint=udpin:127.0.0.1:BUSY", PORT_IN_USE),
        (
            "check mission.toml --set signing.key_file=~nosuchuser/key",
            "mission.toml: signing.key_file: ",
        ),
        ("fly mission.toml --out LONG", "LONG: File name too long"),
        ("check LONG.toml", "LONG.toml: File name too long"),
        (
            "fly mission.toml --out /dev/null/run",
            "/dev/null/run: cannot be written: Not a directory",
        ),
        ("check mission.toml --set link.endpoint=udpin:14550", "endpoint 'udpin:14550': "),
        ("check mission.toml --set ranging.endpoint=udpin:14550", "endpoint 'udpin:14550': "),
        (
            "check mission.toml --set link.endpoint=udpin::14550",
            "endpoint 'udpin::14550': host is missing, write ",
        ),
        (
            "fly mission.toml --set guidance.gain=1e-5",
            "mission.toml: refused by its checks, see FAIL above",
        ),
        (
            "preflight mission.toml --set guidance.gain=1e-5",
            "mission.toml: refused by its checks, see FAIL above",
        ),
        *(
            (f"{command} mission.toml --set {override}", f"mission.toml: {says}")
            for command in ("check", "fly", "preflight")
            for override, says in (
                ("orbit.raduis_m=80", "orbit.raduis_m: unknown key, did you mean radius_m?"),
                (
                    "link.endpoint=sim",
                    'link.endpoint: is "sim": add a [sim] table that describes the vehicle',
                ),
                (
                    "sim.ranging.nois_m=1.0",
                    'sim.ranging.nois_m: unknown key, did you mean "noise_m"?',
                ),
            )
        ),
        ("preflight copter --seconds 0", "--seconds: must be at least 1 and at most 600, not 0"),
        (
            "preflight copter --seconds 601",
            "--seconds: must be at least 1 and at most 600, not 601",
        ),
        (
            "init zeppelin",
            "init: zeppelin is not one of campaign-mission, copter, copter-nogps, home, home-",
        ),
        (
            "init plane my+plane.toml",
            "init: my+plane.toml: a mission's name may have letters, digits, '.', '_'",
        ),
        (
            "init plane mission.toml",
            "init: mission.toml: exists already, name another file: circnav init plane FILE",
        ),
        ("emulate --speed 0", "--speed: must be above 0 and at most 100, not 0"),
        ("emulate --speed 101", "--speed: must be above 0 and at most 100, not 101"),
        ("emulate --speed nan", "--speed: must be above 0 and at most 100, not nan"),
        ("emulate nowhere.toml", "nowhere.toml: "),
        (
            "emulate --endpoint ftp:here:21",
            '"ftp:here:21" is not an endpoint, write udpin:127.0.0.1:14550',
        ),
        (
            "emulate --endpoint udpin:127.0.0.1:BUSY",
            "udpin:127.0.0.1:BUSY: cannot be opened: address already in use",
        ),
        ("report nowhere", "nowhere: no such run folder"),
        ("replay nowhere", "nowhere: no such run folder"),
        *(
            (f"{command} --out=", "--out: is empty, give it a name")
            for command in ("fly mission.toml", "replay x")
        ),
    ],
)
def test_wrong_usage_is_one_line_and_writes_nothing(circnav, mission, busy_port, command, says):
    command, says = (
        text.replace("BUSY", str(busy_port)).replace("LONG", 300 * "x") for text in (command, says)
    )
    assert circnav(*command.split()).refused.startswith(says)
    assert list(mission.parent.iterdir()) == [mission]


def test_parser_errors_exit_with_2_and_interrupts_130(circnav, monkeypatch):
    wrong = ("fligh", "fly", "check a.toml b.toml", "fly quickstart --speed fast")
    for arguments in wrong:
        ran = circnav(*arguments.split())
        assert ran.code == 2
        assert "Error: " in ran.err
        assert "Traceback" not in ran.err

    def interrupted(path, text):
        raise KeyboardInterrupt

    monkeypatch.setattr("circnav_mav.cli.init.write_text", interrupted)
    assert circnav("init", "plane").code == 130
