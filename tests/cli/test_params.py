"""`circnav params`: the output contains the values that preflight demands."""

import struct

import pytest
from pymavlink.dialects.v20 import all as mavlink
from pymavlink.mavparm import MAVParmDict

from circnav_mav.cli.bundled import bundled
from circnav_mav.cli.params import parameter_lines
from circnav_mav.mav.check_result import FAIL, PASS
from circnav_mav.mission.load import load_mission
from circnav_mav.preflight.checks import parameter_context
from tests.pilot.test_preflight import Bench
from tests.rig import Voice

MISSIONS = ["arduplane", "arducopter", "ardurover", "px4_copter", "px4_plane"]
WITHOUT_GPS = ["arducopter_nogps", "px4_copter_nogps"]


def grades_of(mission, values):
    """Return the grades of all methods of the mission for the parameters that the file sets."""
    context = parameter_context(mission, 1, values)
    methods = mission.methods(mission.vehicles[0])
    checks = [
        rule.check(context)
        for method in methods
        for rule in method.parameters
        if {name.name for name in rule.names} & set(values)
    ]
    return {check.grade for check in checks}


def values_of(lines):
    rows = [
        line.split("\t")[2:4] if "\t" in line else line.split(",")
        for line in lines
        if not line.startswith("#")
    ]
    return {name: float(value) for name, value in rows}


@pytest.mark.parametrize("name", MISSIONS + WITHOUT_GPS)
@pytest.mark.parametrize("change", [(), ("vehicle.speed_mps=14.5",)], ids=["as bundled", "faster"])
def test_printed_parameters_pass_preflight(name, change):
    mission = load_mission(bundled("mission", name), change)
    (vehicle,) = mission.vehicles
    values = values_of(parameter_lines(mission, vehicle))
    assert values and grades_of(mission, values) == {PASS}


def load(vehicle, lines, bytewise):
    """Set the parameters as a ground station that loads the file does. For PX4, the float field
    contains the bytes of an integer."""
    for line in lines:
        if line.startswith("#"):
            continue
        name, value, *kind = line.split("\t")[2:] if bytewise else line.split(",")
        number = float(value)
        kind = int(kind[0]) if kind else mavlink.MAV_PARAM_TYPE_REAL32
        if bytewise and kind == mavlink.MAV_PARAM_TYPE_INT32:
            (number,) = struct.unpack("<f", struct.pack("<i", int(number)))
        vehicle.receive(
            Voice(255, 190).pack(
                mavlink.MAVLink_param_set_message(1, 1, name.encode(), number, kind)
            )
        )


@pytest.mark.parametrize("name", MISSIONS)
def test_loaded_parameters_pass_preflight_of_emulator(name):
    bench = Bench(name, "vehicle.speed_mps=14.5")
    (vehicle,) = bench.mission.vehicles
    load(bench.vehicle, parameter_lines(bench.mission, vehicle), vehicle.firmware.key == "px4")
    lines = [line for line in bench.lines() if line.subject == "parameter"]
    assert lines and [line for line in lines if line.grade is FAIL] == []


@pytest.mark.parametrize("name", MISSIONS)
def test_both_parameter_file_formats_contain_equal_passing_values(name, circnav, tmp_path):
    mission = load_mission(bundled("mission", name))
    file = tmp_path / "pairs.param"
    file.write_text(circnav("params", name, "--format", "pairs").out)
    loaded = MAVParmDict()
    assert loaded.load(file)
    assert grades_of(mission, loaded) == {PASS}
    rows = [
        line.split("\t")
        for line in circnav("params", name, "--format", "qgroundcontrol").out.splitlines()
        if not line.startswith("#")
    ]
    assert [row[:2] for row in rows] == len(loaded) * [["1", "1"]]
    assert {row[2]: float(row[3]) for row in rows} == loaded
    assert all(row[4] == "4" for row in rows if row[2] == "ANGLE_MAX")


@pytest.mark.parametrize(
    ("bank", "lean"), [(25, 30), (40, 40)], ids=["autopilot's default", "tilt of the mission"]
)
def test_parameters_suit_flight_after_gps_loss(bank, lean):
    """The lean limit suits velocities in wind and the attitudes after a loss of GPS."""
    mission = load_mission(bundled("mission", "arducopter"), [f"vehicle.max_bank_deg={bank}"])
    values = values_of(parameter_lines(mission, mission.vehicles[0]))
    assert (values["ATC_ANGLE_MAX"], values["ANGLE_MAX"]) == (lean, 100 * lean)
    assert (values["GUID_OPTIONS"], values["FS_EKF_ACTION"]) == (0, 1)


def test_parameter_file_names_versions_of_parameters():
    mission = load_mission(bundled("mission", "px4_copter_nogps"))
    text = "\n".join(parameter_lines(mission, mission.vehicles[0]))
    assert "version: MAN_DEADZONE (from 1.17), MPC_HOLD_DZ (up to 1.16);" in text
    assert "version: MPC_YAW_EXPO (up to 1.16);" in text


def test_parameter_file_names_operator_parameters_without_value():
    mission = load_mission(bundled("mission", "arduplane"))
    lines = list(parameter_lines(mission, mission.vehicles[0]))
    assert "AIRSPEED_MIN" in lines[-1] and "FENCE_ENABLE" in lines[-1]
    assert not {"AIRSPEED_MIN", "ARSPD_FBW_MIN", "FENCE_ENABLE", "FS_GCS_ENABL"} & set(
        values_of(lines)
    )


def test_params_refuses_mission_with_autopilot_auto(circnav):
    ran = circnav("params", "arducopter", "--set", "vehicle.autopilot=auto")
    assert ran.code == 2 and "vehicle.autopilot: choose one" in ran.err
