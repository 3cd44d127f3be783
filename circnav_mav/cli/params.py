"""`circnav params`: autopilot parameters for a mission, as a file for ground stations."""

from collections.abc import Collection, Iterator

import click

from circnav_mav.cli.check import read_mission
from circnav_mav.cli.exits import Exit, Refused
from circnav_mav.mav.autopilots.interface import Autopilot, rules_by_parameter
from circnav_mav.mav.autopilots.parameters import Rule
from circnav_mav.mav.check_result import Grade
from circnav_mav.mission.mission import Mission
from circnav_mav.preflight.checks import parameter_context

INT8 = 2
INT16 = 4
INT32 = 6
REAL32 = 9
"""MAV_PARAM_TYPE of 8-bit, 16-bit and 32-bit integers and floats. QGroundControl ignores a line of
the file if its type differs from the type that the vehicle reports for this parameter."""
INTEGERS = {
    "ANGLE_MAX": INT16,
    "FS_EKF_ACTION": INT8,
    "GUID_OPTIONS": INT32,
    "LIM_ROLL_CD": INT16,
    "TRIM_ARSPD_CM": INT32,
}
"""Parameters that ArduPilot stores as integers. The others are floats."""


def print_parameters(path: str, format: str | None, overrides: tuple[str, ...]) -> int:
    """Print the parameter file. format: pairs or qgroundcontrol, None for the format of the
    autopilot's usual ground station. Raises Refused if the mission does not name one vehicle."""
    mission = read_mission(path, overrides)
    if len(mission.vehicles) != 1:
        raise Refused(f"{path}: vehicle.autopilot: choose one: --set vehicle.autopilot=ardupilot")
    click.echo("\n".join(parameter_lines(mission, mission.vehicles[0], format)))
    return Exit.DONE


def parameter_lines(
    mission: Mission, vehicle: type[Autopilot], format: str | None = None
) -> Iterator[str]:
    """Yield the lines of the file: `NAME,VALUE`, or QGroundControl's five columns (default for
    PX4)."""
    px4 = vehicle.firmware.key == "px4"
    columns = px4 if format is None else format == "qgroundcontrol"
    system = mission.file.vehicle.system_id or 1
    yield f"# {vehicle.name}, circnav mission {mission.file.name}"
    yours = []
    methods = mission.methods(vehicle)
    for names, rules in rules_by_parameter(methods).items():
        value = _advised(rules, mission, system)
        if value is None:
            yours.append(" or ".join(map(str, names)))
            continue
        context = parameter_context(mission, system, {names[0].name: value})
        for reason in dict.fromkeys(rule.judge(value, context)[1] for rule in rules):
            yield f"# {reason}"
        if names[0].since or names[0].until:
            versions = ", ".join(map(str, names))
            yield f"# name by firmware version: {versions}; an unknown name is ignored"
        for name, factor, *_ in names:
            number = f"{value / factor:g}"
            kind = INT32 if isinstance(value, int) else INTEGERS.get(name, REAL32)
            yield f"{system}\t1\t{name}\t{number}\t{kind}" if columns else f"{name},{number}"
    yield f"# not set here, but checked by circnav preflight: {', '.join(yours)}"


def _advised(rules: Collection[Rule], mission: Mission, system: int) -> float | None:
    """Return the value of a parameter that suits all its rules best, among the values that they
    advise. None if no rule advises a value."""
    values = [
        rule.advised(parameter_context(mission, system, {}))
        for rule in rules
        if rule.advised is not None
    ]

    def worst(value: float) -> int:
        context = parameter_context(mission, system, {})
        return max(list(Grade).index(rule.judge(value, context)[0]) for rule in rules)

    return min(values, key=worst, default=None)
