"""Vehicle files of the emulator: flyable defaults, and mistakes reported in one line with the
remedy."""

import math
import tomllib
from pathlib import Path

import pytest
from circnav_sim.config import ConfigError, load_vehicle, parse_vehicle
from circnav_sim.vehicle import Vehicle


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        ({"vehicel": {}}, 'vehicel: unknown key, did you mean "vehicle"?'),
        ({"ranging": {"noise": 1.0}}, 'ranging.noise: unknown key, did you mean "noise_m"?'),
        ({"ranging": {"rate_hz": "fast"}}, "ranging.rate_hz: should be a valid number, not 'fast'"),
        ({"ranging": {"noise_m": math.nan}}, "ranging.noise_m: should be a finite number"),
        ({"ranging": {"name": "MUCHTOOLONG"}}, "ranging.name: longer than 10 characters"),
        ({"vehicle": {"system_id": 0}}, "vehicle.system_id: should be greater than or equal to 1"),
        ({"start": {"random": {"north_m": [5, 1]}}}, "start.random.north_m: [5, 1] is empty"),
        ({"start": {"random": {"north_m": [5]}}}, "start.random.north_m[1]: is missing"),
        ({"start": 5}, "start: should be a table of keys and values, not 5"),
        ({"start": {"mode": "GUIDE"}}, 'start.mode: "GUIDE" is not a mode of arducopter, did you'),
        ({"start": {"armed": False, "altitude_m": 10}}, "start.armed: false needs altitude_m = 0"),
        ({"events": [{"action": "explode"}]}, "events[0].action: should be 'mode', 'arm', "),
        ({"events": [{"action": "mode"}]}, "events[0].mode: is missing"),
        ({"ranging": {"message": "ranging_beacon"}}, "ranging.via: autopilots do not forward"),
        ({"ranging": {"via": "autopilot", "rate_name": "R"}}, "ranging.rate_name: the autopilot"),
        ({"ranging": {"via": "autopilot", "message": "named_value_float"}}, "ranging.message: the"),
        ({"ranging": {"component_id": 1}}, "ranging.component_id: 1 is the autopilot itself"),
        ({"vehicle": {"profile": "arduplane", "dynamics": "airborne"}}, "vehicle.dynamics: "),
    ],
)
def test_mistake_in_vehicle_file_gives_one_line_message(table, complaint):
    with pytest.raises(ConfigError) as caught:
        parse_vehicle(table, "f.toml")
    assert str(caught.value).startswith(f"f.toml: {complaint}") and "\n" not in str(caught.value)


def test_sim_table_of_mission_is_used(tmp_path):
    mission = tmp_path / "mission.toml"
    mission.write_text(
        '[vehicle]\nkind = "plane"\nspeed_mps = 14.0\n[orbit]\nradius_m = 80\n[sim]\nseed = 4\n'
        "[sim.start]\nnorth_m = 12\n"
    )
    config = load_vehicle(mission)
    assert (config.seed, config.start.north_m) == (4, 12.0)
    assert config.vehicle.cruise_speed_mps == 14


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[sim.start]\nnorht_m = 12\n", 'sim.start.norht_m: unknown key, did you mean "north_m"?'),
        (
            'name = "mine"\n[vehicle]\nkind = "copter"\n[orbit]\nradius_m = 80\n',
            "a mission without the table [sim]: ",
        ),
        (None, "cannot be read"),
        ("[vehicle\n", "not a TOML file"),
        ("\xff", "not a TOML file"),
    ],
)
def test_unreadable_vehicle_file_gives_one_line_message(tmp_path, text, complaint):
    path = tmp_path / "vehicle.toml"
    if text is not None:
        path.write_bytes(text.encode("latin-1"))
    with pytest.raises(ConfigError) as caught:
        load_vehicle(path)
    assert str(caught.value).startswith(f"{path}: {complaint}") and "\n" not in str(caught.value)


def test_random_start_depends_only_on_seed_and_bounds():
    table = {
        "target": {"north_m": 50.0, "east_m": -20.0},
        "start": {
            "random": {"range_m": [100, 300], "bearing_deg": [0, 360], "heading_deg": [-180, 180]}
        },
    }
    truths = [Vehicle(parse_vehicle({"seed": seed, **table}, "x")).truth for seed in range(30)]
    distances = [math.hypot(t.north - 50.0, t.east + 20.0) for t in truths]
    assert all(100 <= d <= 300 for d in distances) and max(distances) - min(distances) > 100
    assert truths[3] == Vehicle(parse_vehicle({"seed": 3, **table}, "x")).truth


def test_vehicle_file_of_readme_flies():
    """The example of sim/README.md flies, and the page names every key of the schema."""
    text = (Path(__file__).parents[2] / "sim" / "README.md").read_text()
    example = tomllib.loads(text.split("```toml")[1].split("```")[0])
    vehicle = Vehicle(parse_vehicle(example, "README.md"))
    vehicle.advance(1.0)
    documented = {
        f"{section}.{key}"
        for section, table in example.items()
        if isinstance(table, dict)
        for key in table
    }
    for section in ("vehicle", "start", "target", "wind", "ranging", "truth", "sensors", "battery"):
        for name in type(getattr(vehicle.config, section)).model_fields:
            assert f"{section}.{name}" in documented or name in text, f"{section}.{name}"
