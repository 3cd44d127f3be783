"""Mission files: their meaning, and one line for each mistake."""

import json
import re
import tomllib
from pathlib import Path

import pytest
from circnav_sim.config import ConfigError, VehicleConfig, parse_vehicle
from hypothesis import example, given, settings
from hypothesis import strategies as st

from circnav_mav.guidance.types import Direction
from circnav_mav.mission.checks import check_mission
from circnav_mav.mission.load import MissionError, load_mission, parse_mission
from circnav_mav.mission.problems import keys_of
from circnav_mav.mission.schema import MissionFile
from circnav_mav.pilot import RANGING, VEHICLE
from tests.small_mission import TEXT

CONFIG = sorted((Path(__file__).parents[2] / "config").glob("*.toml"))


def refusal(text, *overrides):
    """Return the error message, which is one line."""
    with pytest.raises(MissionError) as caught:
        parse_mission(text, "m.toml", overrides)
    line = str(caught.value)
    assert "\n" not in line
    return line


# --- bundled mission files


@pytest.mark.parametrize(
    ("example", "law", "k", "settles"),
    [(1, "smooth", 0.01, 10.98684113), (2, "smooth", 0.01, 10.0), (3, "switching", 0.12, 10.0)],
)
def test_paper_examples_contain_values_of_the_paper(config, example, law, k, settles):
    """In the paper V = 1, r_d = 10 and the target is at (0, -10). Starts are in [0, 10] x [0, 10] x
    [0, 2 pi]. A gain k > 0 circles clockwise."""
    mission = load_mission(config / f"paper_example_{example}.toml")
    assert (mission.orbit.speed, mission.orbit.radius, mission.orbit.direction) == (
        1.0,
        settles,
        Direction.CLOCKWISE,
    )
    assert (mission.law.name, mission.law.gain) == (law, k)
    target = mission.file.sim["target"]
    random = mission.file.sim["start"]["random"]
    assert (target["east_m"], target["north_m"]) == (0.0, -10.0)
    assert random == {"north_m": [0.0, 10.0], "east_m": [0.0, 10.0], "heading_deg": [0.0, 360.0]}


@pytest.mark.parametrize("name", ["arduplane", "home", "px4_copter_nogps"])
def test_commented_wind_and_events_of_bundled_mission_are_valid(config, name):
    text, end = (config / f"{name}.toml").read_text().split("[sim]", 1)
    end = re.sub(r"^# (?=\[|\w+ = )", "", end, flags=re.MULTILINE)
    sim = parse_mission(f"{text}[sim]{end}", "m.toml").file.sim
    vehicle = parse_vehicle(sim, "sim")
    assert vehicle.wind.speed_mps > 0 and vehicle.wind.gust_rms_mps > 0
    assert {"mode", "mute_ranging"} <= {event.action for event in vehicle.events}


# --- meaning of a file


def test_mission_derives_values_of_flight(mission):
    settings = mission(
        "orbit.direction=counterclockwise",
        "orbit.height_above_target_m=30.0",
        "ranging.sensor_id=3",
        "ranging.orientation=24",
        "ranging.system_id=9",
        "ranging.component_id=5",
        "link.component_id=192",
        "link.wait_s=12.0",
        "limits.stale_s=0.4",
        "limits.coast_s=3.0",
        "limits.tick_hz=25.0",
        "engage.request_mode=true",
        "engage.on_takeover=wait",
        "vehicle.system_id=4",
        "ranging.stamp=arrival",
        "bounds.min_altitude_m=-20",
        "bounds.max_altitude_m=-5.5",
    )
    assert settings.orbit.direction is Direction.COUNTERCLOCKWISE
    ranging = settings.ranging
    assert (ranging.sensor_id, ranging.orientation, ranging.system_id, ranging.component_id) == (
        3,
        24,
        9,
        5,
    )
    assert (ranging.max_age, ranging.stamp, ranging.rate_hz) == (0.4, "arrival", 10.0)
    assert (settings.stale, settings.slowest_answer) == (0.4, pytest.approx(0.48))
    assert (settings.file.limits.tick, settings.file.limits.outage) == (0.04, 60.0)


@pytest.mark.parametrize("second", ["target_altitude_m=584.0", "target_above_home_m=-2.0"])
def test_mission_refuses_two_keys_for_height(mission, second):
    key = second.split("=")[0]
    assert getattr(mission(f"orbit.{second}").file.orbit, key) == float(second.split("=")[1])
    clash = (
        rf"small\.toml: orbit\.height_above_target_m and orbit\.{key}: only one of them may be"
        r" given"
    )
    with pytest.raises(MissionError, match=clash):
        mission("orbit.height_above_target_m=30.0", f"orbit.{second}")


@pytest.mark.parametrize(
    ("rate", "stale"), [(0.2, 5.0), (1.0, 2.5), (3.0, 2.5 / 3), (10.0, 0.5), (100.0, 0.5)]
)
def test_default_stale_age_follows_ranging_rate(mission, rate, stale):
    settings = mission(f"ranging.rate_hz={rate}")
    assert (settings.stale, settings.ranging.max_age) == pytest.approx((stale, stale))


@pytest.mark.parametrize(
    ("overrides", "farthest"),
    [
        ((), pytest.approx(639, abs=0.5)),
        (("bounds.max_range_m=300",), 300),
        (('ranging.message="named_value_float"',), None),
        (('ranging.message="ranging_beacon"',), None),
    ],
    ids=["distance_sensor", "given", "named_value_float", "ranging_beacon"],
)
def test_default_farthest_range_follows_ranging_message(mission, overrides, farthest):
    assert mission(*overrides).farthest == farthest


@pytest.mark.parametrize(("law", "default"), [("smooth", 1e-4), ("switching", 0.18)])
def test_default_gain_depends_on_law(mission, law, default):
    """Default gains: twice 1/(2 r_d^2) for `smooth`, 1.2 times V/r_d for `switching`, at r_d = 100
    m and V = 15 m/s."""
    assert mission(f"guidance.law={law}").law.gain == pytest.approx(default)
    assert mission(f"guidance.law={law}", "guidance.gain=0.7").law.gain == 0.7


def test_required_range_rate_raises_default_gain(mission):
    """If a measured range rate is dropped in flight, the range filter's lag returns. The default
    gain allows for this lag, except if the mission requires the range rate."""
    keys = ["guidance.law=feedforward", "ranging.message=named_value_float"]
    rate = ["ranging.rate_name=RR", "ranging.rate_sign=closing"]
    alone = mission(*keys)
    beside = mission(*keys, *rate)
    assert beside.law.gain == alone.law.gain
    assert mission(*keys, *rate, "guidance.estimator=measured").law.gain > alone.law.gain
    ranging = beside.ranging
    assert (ranging.rate_name, ranging.rate_sign) == ("RR", "closing")


def test_mission_with_noisy_radio_loads_with_matching_sigma(mission):
    assert mission("ranging.sigma_m=60").ranging.max_sigma > 60


def test_endpoint_sim_uses_vehicle_of_sim_table(text):
    assert parse_mission(text + "\n[sim]\nseed = 1\n", "m.toml", ["link.endpoint=sim"]).flies_sim


@pytest.mark.parametrize(
    ("link", "ranging", "streams"),
    [
        ("udpin:0.0.0.0:14550", None, set()),
        ("tcp:127.0.0.1:5760", None, {"vehicle"}),
        ("serial:/dev/ttyUSB0:57600", "udpin:0.0.0.0:14560", {"vehicle"}),
        ("udpin://0.0.0.0:14550", "tcp://10.0.0.1:5760", {"ranging"}),
        ("tcpout://10.0.0.1:5760", "serial:///dev/ttyACM0:115200", {"vehicle", "ranging"}),
    ],
)
def test_tcp_and_serial_endpoints_are_stream_links(mission, link, ranging, streams):
    overrides = [f'link.endpoint="{link}"', *([f'ranging.endpoint="{ranging}"'] if ranging else [])]
    settings = mission(*overrides)
    assert settings.stream_links == streams
    assert settings.ranging_apart == (ranging is not None)


# --- overrides


def test_saved_mission_contains_its_overrides(mission):
    """An override may add a table. Of two overrides of a key, the last one is used."""
    changed = mission(
        "engage.request_mode=true",
        "orbit.radius_m=90",
        "orbit.radius_m=80",
        "orbit.direction=counterclockwise",
    )
    assert changed.orbit.radius == 80.0
    assert changed.file.engage.request_mode
    assert tomllib.loads(changed.text)["orbit"] == {"radius_m": 80, "direction": "counterclockwise"}


def test_override_keeps_comments_of_mission_file():
    text = (Path(__file__).parents[2] / "config" / "quickstart.toml").read_text(encoding="utf-8")
    flown = parse_mission(text, "quickstart.toml", ["orbit.radius_m=80.0"]).text
    assert flown.count("#") == text.count("#")
    assert parse_mission(flown, "again").orbit.radius == 80.0


@pytest.mark.parametrize("override", ["orbit.radius_m", "=80", "", " = 3"])
def test_malformed_override_is_refused(text, override):
    assert refusal(text, override).startswith(f"--set {override}: write it as table.key=value")


def test_override_is_validated_like_mission_key(text):
    assert (
        refusal(text, "orbit.radius_m=far")
        == "m.toml: orbit.radius_m: should be a valid number, not 'far'"
    )
    line = "--set orbit.radius_m.x=1: radius_m is a value, not a table"
    assert refusal(text, "orbit.radius_m.x=1") == line


# --- one line for each mistake


@pytest.mark.parametrize(
    ("content", "error"),
    [(None, "cannot be read: No such file or directory"),
     (b"\xff\xfe\x00name", "is not a text file in UTF-8: save it as one"),
     (b'name = "M\xfcnchen"', "is not a text file in UTF-8: save it as one")],
)  # fmt: skip
def test_unreadable_mission_file_is_refused(tmp_path, content, error):
    if content is not None:
        (tmp_path / "m.toml").write_bytes(content)
    with pytest.raises(MissionError, match=rf"m\.toml: {error}$"):
        load_mission(tmp_path / "m.toml")


@pytest.mark.parametrize(
    ("content", "error"),
    [
        (".".join(["a"] * 20_000) + " = 1", "19999 dots in one line, at most 500 are read"),
        ("\n".join(f"[t{n}]" for n in range(30_000)), "[0-9]+ characters, at most 200000"),
        ("\n".join(f"[t{n}]" for n in range(3000)), "3000 keys and tables, at most 2000"),
    ],
    ids=["dots", "characters", "tables"],
)
def test_huge_toml_text_is_refused_before_parsing(monkeypatch, content, error):
    monkeypatch.setattr("circnav_mav.mission.load.tomllib", None)
    with pytest.raises(MissionError, match=f"^m: is not a mission: {error}"):
        parse_mission(content, "m")


def test_error_of_empty_mission_lists_missing_tables():
    assert (
        refusal("")
        == "m.toml: name, vehicle, orbit, guidance, ranging, link, limits: missing, add them"
    )


WORDS = (
    "nan",
    "-inf",
    "-1",
    "0",
    "1e308",
    "5e-324",
    "true",
    '""',
    "[]",
    "[[1]]",
    "{}",
    "{a=1}",
    '"x"',
    '"\\u0000"',
    "2026-01-01",
    400 * "9",
    5000 * "9",
    "0x" + 5000 * "f",
    2000 * "[",
)
LINES = [
    *TEXT.splitlines(),
    "[sim]",
    "[signing]",
    "[external_position]",
    'key_file = "\\u0000"',
    "\x1b",
    "é=",
    "orbit.x.y = 1",
]
KEYS = [*keys_of(MissionFile), *(f"sim.{key}" for key in keys_of(VehicleConfig))]


@settings(max_examples=500)
@given(
    st.one_of(st.text(), st.lists(st.sampled_from(LINES)).map("\n".join)),
    st.lists(
        st.tuples(st.sampled_from(KEYS), st.one_of(st.sampled_from(WORDS), st.text())), max_size=3
    ),
)
@example("", [("orbit.radius_m", "[1, " + 5000 * "9" + "]")])
@example("", [("sim.seed", "nan"), ("vehicle.autopilot", "nan"), ("sim", "nan")])
def test_any_text_gives_mission_or_one_error_line(text, changes):
    """Valid or damaged files with random overrides are loaded, including the settings of pilot and
    emulated vehicle."""
    overrides = [f"{key}={value}" for key, value in changes]
    for whole in (text, TEXT + text):
        try:
            mission = parse_mission(whole, "m.toml", overrides, Path("/"))
            check_mission(mission)
            parse_vehicle(mission.file.sim or {}, "m.toml: sim")
        except (MissionError, ConfigError) as error:
            assert str(error).startswith(("m.toml: ", "--set "))


def test_invalid_toml_line_is_quoted():
    assert refusal("[orbit]\nradius_m 150\n").endswith("(at line 2, column 10): 'radius_m 150'")


MISTAKES = [
    ("orbit.raduis_m=1", "orbit.raduis_m: unknown key, did you mean radius_m?"),
    ("orbit.max_range=9", "orbit.max_range: unknown key, did you mean bounds.max_range_m?"),
    ("orbits.radius_m=1", "orbits: unknown key, did you mean orbit?"),
    ("orbit.zzz=1", "orbit.zzz: unknown key, keys of this table: radius_m,"),
    ("orbit.radius_m=0.0", "orbit.radius_m: must be above 0, not 0"),
    ('orbit.radius_m="100"', "orbit.radius_m: should be a valid number, not '100'"),
    ("ranging.rate_hz=1e9", "ranging.rate_hz: must be at most 1000, not 1e+09"),
    ("limits.tick_hz=4.0", "limits.tick_hz: must be at least 5, not 4"),
    ("limits.stale_s=6.0", "limits.stale_s: must be at most 5, not 6"),
    # mistake: a time in milliseconds
    ("limits.coast_s=10000", "limits.coast_s: must be at most 3600, not"),
    ("limits.not_following_s=10000", "limits.not_following_s: must be at most 3600, not"),
    ("vehicle.turn_lag_s=400", "vehicle.turn_lag_s: must be at most 10, not 400"),
    ("bounds.min_battery_percent=0.2", "bounds.min_battery_percent: must be at least"),
    ("bounds.min_altitude_m=nan", "bounds.min_altitude_m: must be a finite number, not nan: omit"),
    ("orbit.radius_m=150,0", "orbit.radius_m: should be a valid number, not '150,0': write 150.0"),
    (
        "guidance.law=pid",
        "guidance.law: 'pid' is not one of 'smooth', 'switching', 'feedforward', 'drift', 'auto',"
        " or your own module:name",
    ),
    ("engage.request_mode=1", "engage.request_mode: should be a valid boolean, not 1: write true"),
    ("orbit.direction=left", "orbit.direction: 'left' is not one of 'clockwise' or"),
    (
        "orbit.direction=cw",
        "orbit.direction: 'cw' is not one of 'clockwise' or 'counterclockwise', did you mean"
        " 'clockwise'?",
    ),
    ("guidance.law=magic", "guidance.law: 'magic' is not one of 'smooth'"),
    ("name=../../etc", "name: "),
    (f"name={300 * 'x'}", "name: string should have at most 100 characters, not 'xxx"),
    ("link.component_id=190", "link.component_id: must be at least 191, not 190"),
    ("link.peer=drone.local", "link.peer: must be an address or network, such as"),
    ("link.peer=10.0.0.256", "link.peer: must be an address or network, such as"),
    ("link.peer=5", "link.peer: must be an address or network, such as"),
    ('link.peer=["10.0.0.5", "x"]', "link.peer: must be an address or network, such as"),
    ("signing.accept_unsigned=true", "signing.key_file: missing"),
    # an empty path must not be resolved to the folder of the mission
    ("signing.key_file=", "signing.key_file: "),
    ("signing=drone.key", "signing: must be a table"),
]


@pytest.mark.parametrize(("override", "line"), MISTAKES, ids=[key for key, _ in MISTAKES])
def test_mission_error_is_one_line_with_file_and_key(text, override, line):
    assert refusal(text, override).startswith(f"m.toml: {line}")


@pytest.mark.parametrize("line", ["radius_m = 100.0", "max_turn_rate_deg_s = 20.0"])
def test_mission_error_names_missing_key(text, line):
    assert text.count(line) == 1
    assert f".{line.split()[0]}: missing, add it" in refusal(text.replace(line, ""))


@pytest.mark.parametrize("value", ["nan", "inf"])
def test_mission_keys_refuse_nan_and_infinity(text, value):
    for key in keys_of(MissionFile):
        assert refusal(text, f"{key}={value}").startswith(f"m.toml: {key}")


@pytest.mark.parametrize(
    ("overrides", "line"),
    [
        ("ranging.rate_name=RR", 'ranging.rate_name: needs message = "named_value_float"'),
        (
            "ranging.message=named_value_float ranging.rate_name=RANGE",
            'ranging.rate_name: is "RANGE" as ranging.name',
        ),
        ("guidance.estimator=measured", 'guidance.estimator: is "measured": set ranging.rate_name'),
        (
            "signing.key_file=k signing.accept_unsigned=ranging",
            'signing.accept_unsigned: is "ranging": set ranging.endpoint',
        ),
        ("vehicle.kind=plane", "vehicle.max_bank_deg: missing"),
        ("ranging.endpoint=sim", 'ranging.endpoint: is "sim", but the vehicle is not'),
        (
            "ranging.endpoint=udpin:127.0.0.1:14550",
            'ranging.endpoint: is "udpin:127.0.0.1:14550" as link.endpoint',
        ),
        ("bounds.min_altitude_m=50 bounds.max_altitude_m=50", "bounds.min_altitude_m: 50 is not"),
        (
            "bounds.min_range_m=300 bounds.max_range_m=200 link.endpoint=sim",
            'link.endpoint: is "sim": add a [sim] table that describes the bundled vehicle, or set'
            " the endpoint of your vehicle; bounds.min_range_m: 300 is not below bounds.max_range_m"
            " = 200",
        ),
    ],
)
def test_contradicting_keys_are_refused(text, overrides, line):
    assert refusal(text, *overrides.split()).startswith(f"m.toml: {line}")


def test_all_mission_mistakes_are_reported_in_one_line(text):
    wrong = (
        text.replace("radius_m", "raduis_m")
        .replace("rate_hz = 10.0", 'rate_hz = ".5"')
        .replace("sigma_m = 0.5", "")
    )
    assert (
        refusal(wrong) == "m.toml: orbit.raduis_m: unknown key, did you mean radius_m?; "
        "ranging.rate_hz: should be a valid number, not '.5': write 0.5; "
        "orbit.radius_m, ranging.sigma_m: missing, add them"
    )


def test_error_line_with_many_mistakes_is_shortened(text):
    wrong = text + "[bounds]\n" + "".join(f"no_{n} = 1\n" for n in range(20))
    with pytest.raises(MissionError, match=r"bounds\.no_7: .*; and 12 more$"):
        parse_mission(wrong, "m.toml")


@pytest.mark.parametrize("peer", ["10.0.0.5", "10.0.0.0/24", "10.0.0.7/24", "fe80::/10"])
def test_link_peer_is_address_or_network(mission, peer):
    assert mission(f"link.peer={peer}").file.link.peer == [peer]
    assert mission(f'link.peer=["{peer}", "::1"]').file.link.peer == [peer, "::1"]


def test_error_names_campaign_file_given_as_mission(config):
    path = config / "campaigns" / "wind.toml"
    with pytest.raises(
        MissionError, match=rf"is a campaign file, fly it with: circnav campaign {path}$"
    ):
        load_mission(path)


@pytest.mark.parametrize(
    "override", ["vehicle.turn_lag_s=0.5", "vehicle.speed_mps=14.0", "bounds.max_range_m=200.0"]
)
def test_mission_with_dotted_keys_is_saved_as_flown(text, override):
    """tomlkit writes a new nested table before the dotted keys, which would then belong to this
    table."""
    tables = {name: keys for name, keys in tomllib.loads(text).items() if name != "name"}
    dotted = [
        f"{name}.{key} = {json.dumps(value)}"
        for name, keys in tables.items()
        for key, value in keys.items()
    ]
    flown = parse_mission("\n".join(['name = "small"', *dotted]), "dotted.toml", [override])
    assert flown.file == parse_mission(text, "small.toml", [override]).file
    assert flown.file == parse_mission(flown.text, "flown.toml").file


# --- keys


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("keys/drone.key", "{folder}/keys/drone.key"),
        ("~/drone.key", "{home}/drone.key"),
        ("/etc/drone.key", "/etc/drone.key"),
    ],
)
def test_signing_key_path_is_relative_to_mission(text, tmp_path, given, meant):
    """The saved mission has absolute paths, so that it can be flown again from its run folder."""
    path = tmp_path / "small.toml"
    meant = meant.format(folder=tmp_path, home=Path.home())
    path.write_text(f'{text}[signing]\nkey_file = "{given}"\n[sim.signing]\nkey_file = "{given}"\n')
    flown = load_mission(path)
    again = tomllib.loads(flown.text)
    assert flown.file.signing.key_file == again["signing"]["key_file"] == meant
    assert again["sim"]["signing"]["key_file"] == meant


@pytest.mark.parametrize(
    ("accepted", "links"),
    [("false", set()), ("true", {VEHICLE, RANGING}), ('"ranging"', {RANGING})],
)
def test_accept_unsigned_applies_only_to_listed_links(mission, accepted, links):
    table = (
        "signing.key_file=k",
        f"signing.accept_unsigned={accepted}",
        "ranging.endpoint=udpin:0.0.0.0:14560",
    )
    assert mission(*table).unsigned_links == links


@pytest.mark.parametrize(
    ("line", "remedy"),
    [
        ("radius_m = 150,0", "'radius_m = 150,0': write 150.0"),
        ("direction = clockwise  # above", ': write "clockwise" in quotes'),
        ('direction = clockwise"', ': write "clockwise" in quotes'),
        ('direction = "clockwise', ': write "clockwise" in quotes'),
        ("radius_m = 1.0\nradius_m = 2.0", "The key is repeated: delete one (at line 3"),
        ("[sim.wind]\n[sim.wind]", "The table [sim.wind] is repeated: put all its keys under one"),
    ],
)
def test_invalid_toml_is_refused_with_remedy(line: str, remedy: str) -> None:
    with pytest.raises(MissionError, match=re.escape(remedy)):
        parse_mission(f"[orbit]\n{line}\n", "small.toml")
