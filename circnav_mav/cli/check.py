"""`circnav check`: checks of a mission file, and of its [sim] table against the mission."""

import shutil
import sys
from collections.abc import Collection, Iterator
from math import cos, hypot, radians, sin
from pathlib import Path
from textwrap import wrap

import click
from circnav_sim.config import VehicleConfig, parse_vehicle

from circnav_mav.cli.exits import Exit, Refused, say
from circnav_mav.mav.autopilots.table import AUTOPILOTS
from circnav_mav.mav.check_result import Check, Grade
from circnav_mav.mission.checks import check_mission, drift_allowed
from circnav_mav.mission.load import MissionError, load_mission
from circnav_mav.mission.mission import SIM, Mission
from circnav_mav.runtime.endpoint import LinkError, parse_endpoint
from circnav_mav.runtime.keys import KeyFileError, read_key
from circnav_mav.runtime.radio_link import radio_port

COLOURS = {Grade.PASS: "green", Grade.WARN: "yellow", Grade.FAIL: "red"}

FLIES = {
    profile: (autopilot, kind.split()[0])
    for (autopilot, kind), vehicle in AUTOPILOTS.items()
    for profile in vehicle.bundled
}
"""Autopilot and vehicle kind that each profile of the bundled vehicle emulates."""
NO_WIND = (
    "sim.wind.speed_mps has no effect: this vehicle holds its speed over ground. Planes, copters"
    " without GPS and campaign-mission drift with the wind"
)
INDENT = 20
"""Width of grade and subject before the text of a check line, characters."""


def read_mission(path: str, overrides: tuple[str, ...]) -> Mission:
    """Load a mission file. Also check its endpoints, [sim] table and signing key. Raises
    Refused."""
    try:
        mission = load_mission(path, overrides)
        link = mission.file.link.endpoint
        ranging = mission.file.ranging.endpoint
        if link != SIM:
            parse_endpoint(link)
        if ranging is not None and mission.ranging_driver:
            radio_port(ranging)
        elif ranging not in (None, SIM):
            parse_endpoint(ranging)
        if mission.file.sim is not None:
            parse_vehicle(mission.file.sim, f"{path}: sim")
        if mission.file.signing is not None:
            read_key(Path(mission.file.signing.key_file))
    except KeyFileError as error:
        raise Refused(f"{path}: signing.key_file: {error}") from None
    except (MissionError, LinkError, ValueError) as error:
        raise Refused(_with_options(str(error), path, overrides)) from None
    return mission


def flown_overrides(
    overrides: tuple[str, ...], endpoint: str | None, duration: float | None = None
) -> tuple[str, ...]:
    """Return the overrides of a mission with the options --endpoint and --duration."""
    options = (
        *([] if endpoint is None else [f'link.endpoint="{endpoint}"']),
        *([] if duration is None else [f"limits.duration_s={duration}"]),
    )
    return (*overrides, *options)


def _with_options(error: str, path: str, overrides: tuple[str, ...]) -> str:
    """Return the error text of a mission. If the error is about keys that --set changed, the text
    names these options instead of the file."""
    given = [one for one in overrides if one.partition("=")[0].strip() in error]
    if not given or error.startswith("--set"):
        return error
    return f"--set {' --set '.join(given)}: {error.removeprefix(f'{path}: ')}"


def all_checks(mission: Mission) -> list[Check]:
    """Return the check lines of the mission, and of the bundled vehicle if the mission flies it."""
    lines = check_mission(mission)
    if mission.flies_sim and mission.file.sim is not None:
        misfits = _misfits(mission, parse_vehicle(mission.file.sim, "sim"))
        lines += [Check(grade, "sim", text) for grade, text in misfits]
    return lines


def refuse_failing(
    path: str, mission: Mission, shown: Collection[Grade] = tuple(Grade)
) -> list[Check]:
    """Print the check lines of these grades, or all lines if any line fails. Return all lines.
    Raises Refused if any line fails."""
    lines = all_checks(mission)
    failed = any(line.grade is Grade.FAIL for line in lines)
    show_checks([line for line in lines if failed or line.grade in shown])
    if failed:
        raise Refused(f"{path}: refused by its checks, see FAIL above")
    return lines


def check_file(path: str, overrides: tuple[str, ...]) -> int:
    """Print all check lines. Return the exit code, USAGE if one fails."""
    lines = all_checks(read_mission(path, overrides))
    show_checks(lines)
    return Exit.USAGE if show_counts(path, lines) else Exit.DONE


def show_counts(path: str, lines: list[Check]) -> int:
    """Print the number of lines per grade. Return the number that fail."""
    counts = {grade: sum(line.grade is grade for line in lines) for grade in Grade}
    say(f"{path}: " + ", ".join(f"{count} {grade.value}" for grade, count in counts.items()))
    return counts[Grade.FAIL]


def show_checks(lines: list[Check]) -> None:
    """Print check lines with colored grades. On a terminal, long lines break at words and continue
    below the text."""
    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else 0
    for line in lines:
        grade = click.style(
            f"{line.grade.value:<4}", fg=COLOURS[line.grade], bold=line.grade is not Grade.PASS
        )
        texts = wrap(line.text, columns - INDENT) if columns > 2 * INDENT else [line.text]
        say(f"  {line.subject:<12}  " + f"\n{'':{INDENT}}".join(texts), styled=grade)


def _misfits(mission: Mission, config: VehicleConfig) -> Iterator[tuple[Grade, str]]:
    """Yield grade and text for each value of the [sim] table that does not fit the mission."""
    wanted = mission.file.vehicle
    profile = config.vehicle.profile
    autopilot, kind = FLIES[profile]
    if kind != wanted.kind or wanted.autopilot not in ("auto", autopilot):
        yield (
            Grade.FAIL,
            (
                f"sim.vehicle.profile {profile} is not the {wanted.autopilot} {wanted.kind} of"
                " [vehicle]"
            ),
        )
        return
    cruise = config.vehicle.cruise_speed_mps or wanted.speed_mps
    # 0.05: largest accepted difference of the bundled plane's cruise speed from the mission's
    # speed, as a fraction of the mission's speed.
    if (
        any(vehicle.fixed_wing for vehicle in mission.vehicles)
        and abs(cruise / wanted.speed_mps - 1) > 0.05
    ):
        cruises = f"the bundled plane cruises at {cruise:g} m/s (sim.vehicle.cruise_speed_mps)"
        yield Grade.WARN, f"{cruises}, but vehicle.speed_mps = {wanted.speed_mps:g}"
    windy = drifts_with_wind(mission, config)
    if not windy and config.wind.speed_mps:
        yield Grade.WARN, NO_WIND
    noise = config.ranging.noise_m
    sigma = mission.file.ranging.sigma_m
    # 2: largest accepted ratio of the two. Noise of 0 is for ideal ranges.
    if config.ranging.preset == "gaussian" and noise and not 0.5 <= noise / sigma <= 2.0:
        yield (
            Grade.WARN,
            f"sim.ranging.noise_m = {noise:g}, but ranging.sigma_m = {sigma:g}: the estimators use"
            " ranging.sigma_m",
        )
    drift = _drift(config, windy=windy)
    tolerated = drift_allowed(mission)
    if drift > tolerated > 0:
        moves = f"sim.wind minus the target's motion is {drift:.1f} m/s"
        yield Grade.WARN, f"{moves}, more than the {tolerated:.1f} m/s that the circle allows"


def drifts_with_wind(mission: Mission, config: VehicleConfig) -> bool:
    """Return True unless the bundled vehicle holds its speed over ground."""
    in_air = any(not vehicle.holds_ground_speed for vehicle in mission.vehicles)
    return in_air or config.vehicle.dynamics == "airborne"


def _drift(config: VehicleConfig, *, windy: bool) -> float:
    """Return the speed of wind minus target motion at the start, m/s. For a vehicle that holds its
    speed over ground, the wind is 0."""
    wind = config.wind.speed_mps if windy else 0.0
    towards = radians(config.wind.from_deg + 180.0)
    north = wind * cos(towards) - config.target.velocity_north_mps
    return hypot(north, wind * sin(towards) - config.target.velocity_east_mps)
