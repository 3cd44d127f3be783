"""`circnav params`: autopilot parameters for a mission, as a file for ground stations."""

from collections.abc import Iterator

import click

from circnav_mav.cli.check import read_mission
from circnav_mav.cli.exits import Exit, Refused
from circnav_mav.mav.autopilots.interface import Autopilot
from circnav_mav.mission.mission import Mission
from circnav_mav.mission.preflight import parameter_context

INT16 = 4
INT32 = 6
REAL32 = 9
"""MAV_PARAM_TYPE of 16-bit integers, 32-bit integers and floats. QGroundControl ignores a line of
the file if its type differs from the type that the vehicle reports for this parameter."""
INTEGERS = {"ANGLE_MAX": INT16, "LIM_ROLL_CD": INT16, "TRIM_ARSPD_CM": INT32}
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
    for rule in vehicle.parameters:
        if rule.advised is None:
            yours.append(" or ".join(name for name, _ in rule.names))
            continue
        value = rule.advised(parameter_context(mission, system, {}))
        _, reason = rule.judge(value, parameter_context(mission, system, {rule.names[0][0]: value}))
        yield f"# {reason}"
        if len(rule.names) > 1:
            yield "# its name and unit depend on the firmware version: an unknown name is ignored"
        for name, factor in rule.names:
            number = f"{value / factor:g}"
            kind = INT32 if isinstance(value, int) else INTEGERS.get(name, REAL32)
            yield f"{system}\t1\t{name}\t{number}\t{kind}" if columns else f"{name},{number}"
    yield f"# not set here, but checked by circnav preflight: {', '.join(yours)}"
