"""Command line: commands, printing and exit codes. Elsewhere only the display of a flight prints,
and no other code ends the process.

This file declares the commands. The code of each command is a module of its own, imported when the
command runs, so that `circnav --help` does not wait for numpy and filterpy.
"""

import io
import os
import sys
import warnings
from collections.abc import Callable
from functools import partial

import click
from circnav_sim.__main__ import main as emulator

from circnav_mav import __version__
from circnav_mav.cli.bundled import FileOrName
from circnav_mav.cli.describe import Finite, Folder
from circnav_mav.cli.describe import command as described
from circnav_mav.cli.exits import Exit, Refused, in_one_line, mind_output, say
from circnav_mav.extension import extensions, load
from circnav_mav.foreign import printable
from circnav_mav.runtime.clock import unix_time

CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100, "show_default": True}

MISSION = click.argument("path", metavar="MISSION", type=FileOrName("mission"))
SET = click.option(
    "--set",
    "overrides",
    metavar="KEY=VALUE",
    multiple=True,
    help="Override a mission value, e.g. --set orbit.radius_m=80. May be repeated.",
)
ENDPOINT = click.option(
    "--endpoint",
    metavar="URL",
    help=(
        "Link to the vehicle: udpin:, udpout: or tcp:HOST:PORT, serial:PATH:BAUD. [default:"
        " link.endpoint of the mission]"
    ),
)
SPEED_HELP = (
    "Simulation speed of the bundled vehicle, times real time. [default: as fast as possible, or 6"
    " with --web]"
)
YEAR_2100 = 4_102_444_800
"""Commands are refused if this computer's clock is at or after this time, s since 1970: in a tlog,
timestamps after 2103 look like damage."""


class Commands(click.Group):
    """Command group that lists its commands in the order of use: commands of this file, then of
    extensions."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        added = (
            name for extension in extensions() for name in extension.commands if " " not in name
        )
        return [*self.commands, *added]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        added = {
            typed: reference
            for extension in extensions()
            for typed, reference in extension.commands.items()
        }
        command = load(added[name]) if name in added else super().get_command(ctx, name)
        for typed, reference in added.items():
            group, _, member = typed.partition(" ")
            if member and group == name and isinstance(command, click.Group):
                command.add_command(load(reference), member)
        return command


@click.group(cls=Commands, context_settings=CONTEXT, invoke_without_command=True)
@click.version_option(__version__, prog_name="circnav")
def circnav() -> None:
    """Circle a radio beacon with nothing but the distance to it, over MAVLink.

    \b
    First flight, no hardware needed:
        circnav fly quickstart

    \b
    A mission of your own, on the bundled vehicle:
        circnav init copter          (or plane, rover, px4-copter, px4-plane, ...)
        circnav fly copter.toml

    \b
    The same on your vehicle:
        circnav preflight copter.toml --endpoint udpin:0.0.0.0:14550
        circnav fly copter.toml --endpoint udpin:0.0.0.0:14550

    To stop: switch the vehicle to any other flight mode, or press Ctrl-C.

    \b
    Exit codes:
        0    flight completed (check, preflight: no FAIL)
        1    internal error
        2    bad usage or mission file
        3    no vehicle or no ranging received
        4    flight ended by a safety rule or by the operator (preflight: a FAIL)
        5    flight completed, recording incomplete (disk full, disk too slow, or 2000 MB written)
        130  interrupted by Ctrl-C or SIGTERM (a flight: after the exit action)
    """
    context = click.get_current_context()
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


command = partial(described, group=circnav)


def _options_of_extensions(function: Callable[..., None]) -> Callable[..., None]:
    """Add the options of extensions to `circnav fly`."""
    for extension in extensions():
        for reference in extension.fly_options:
            function = load(reference)(function)
    return function


@command("circnav_mav.cli.fly:fly_mission", short_help="Fly a mission, show it live, record it.")
@MISSION
@ENDPOINT
@SET
@click.option("--speed", type=Finite(0.01, 100), metavar="N", help=SPEED_HELP)
@click.option(
    "--duration",
    type=Finite(0, min_open=True),
    metavar="S",
    help="Flight time after guidance engages, s. [default: limits.duration_s of the mission]",
)
@click.option(
    "--out", type=Folder(), metavar="DIR", help="Run folder. [default: runs/<time>-<name>]"
)
@click.option(
    "--dry-run",
    "output_mode",
    flag_value="dry run",
    help="Compute and record the flight, but send no setpoint and request no mode.",
)
@click.option(
    "--shadow",
    "output_mode",
    flag_value="shadow",
    help="As --dry-run, but also request no streams: send only heartbeats and the values that a"
    " ground station plots. For a flight beside another controller, whose stream rates must stay.",
)
@_options_of_extensions
def fly() -> None:
    """Fly MISSION, show it live, and record it in a run folder.

    MISSION is a file, or the name of a bundled mission: quickstart; copter, plane, rover, home,
    home-copter, copter-nogps (ArduPilot); px4-copter, px4-copter-nogps, px4-plane; paper-example-1,
    -2, -3; campaign-mission, vehicle-udp.

    If the operator switches to any other flight mode, circnav immediately stops sending setpoints.
    Ctrl-C ends the flight with a safe setpoint and the exit action.

    \b
    Examples:
        circnav fly quickstart --set orbit.radius_m=80
        circnav fly quickstart --web
        circnav fly my.toml --endpoint udpin:0.0.0.0:14550
    """


@command(
    "circnav_mav.cli.init:write_mission", short_help="Write a commented mission file of your own."
)
@click.argument("vehicle", required=False, metavar="VEHICLE")
@click.argument("file", required=False, type=click.Path())
def init() -> None:
    """Write a commented mission for VEHICLE to FILE. [default: VEHICLE.toml] `circnav fly` can fly
    the mission on the bundled emulator at once. An existing file is never overwritten.

    VEHICLE is copter, plane or rover (ArduPilot), px4-copter, px4-plane; without GPS copter-nogps,
    px4-copter-nogps, home (plane), home-copter; or any other bundled mission.
    With mission.schema.json beside the file, an editor completes and checks the keys.

    \b
    Example:
        circnav init plane flight.toml
    """


@command("circnav_mav.cli.check:check_file", short_help="Check a mission without flying it.")
@MISSION
@SET
def check() -> None:
    """Check MISSION without flying it. Prints PASS, WARN or FAIL for each requirement, with the
    value and its limit. Exit codes: 0 no FAIL, 2 at least one FAIL, or bad usage or mission file.

    \b
    Example:
        circnav check quickstart --set guidance.law=smooth --set guidance.gain=1e-5
    """


@command(
    "circnav_mav.cli.preflight:preflight_file",
    short_help="Check vehicle and ranging; send no setpoint.",
)
@MISSION
@ENDPOINT
@SET
@click.option("--seconds", type=float, default=10.0, metavar="N", help="Listening time, s.")
@click.option("-v", "--verbose", is_flag=True, help="Also print the checks that pass.")
def preflight() -> None:
    """Check the connected vehicle and its ranging against MISSION. Requests streams and parameters,
    and sends no setpoint and no mode request. Prints the measured values, and WARN or FAIL for each
    check that does not pass.

    Checks identity, mode, streams, range noise and age, clocks, and the autopilot's parameters.
    Exit codes: 0 no FAIL, 2 bad mission, 3 no message of a vehicle received, 4 at least one FAIL.

    \b
    Example:
        circnav preflight my.toml --endpoint udpin:0.0.0.0:14550
    """


@command("circnav_mav.cli.report:report_run", short_help="Draw the report of a run again.")
@click.argument("folder", type=click.Path(), metavar="RUN")
@click.option(
    "--after-flight",
    is_flag=True,
    hidden=True,
    help="Wait for a line on standard input, then draw.",
)
def report() -> None:
    """Draw the report of RUN, a run folder, again: report.html (one page, readable offline,
    printable) and flight.png. `circnav fly` draws both after each flight.

    \b
    Example:
        circnav report runs/20260101-120000-quickstart
    """


@command("circnav_mav.cli.replay:replay_log", short_help="Replay a recorded flight.")
@click.argument("log", type=click.Path(), metavar="RUN_OR_TLOG")
@click.option(
    "--mission",
    type=FileOrName("mission"),
    metavar="FILE",
    help="Replay with this mission instead of the recorded one. Required for a plain tlog.",
)
@SET
@click.option("--estimator", metavar="NAME", help="Override guidance.estimator.")
@click.option("--law", metavar="NAME", help="Override guidance.law.")
@click.option(
    "--out", type=Folder(), metavar="DIR", help="Folder for the replay's ticks.csv and replay.png."
)
def replay() -> None:
    """Run the guidance on the messages of a recorded flight, and compare its estimates and commands
    with the recorded ones.

    RUN_OR_TLOG is a run folder, or a tlog of Mission Planner or MAVProxy that contains the ranges.
    Such a tlog needs --mission, and is replayed as a dry run. The vehicle's path stays as recorded.
    Exit codes: 0 replayed, 2 bad usage, 3 the replay never steered.

    \b
    Examples:
        circnav replay runs/20260101-120000-quickstart --law switching
        circnav replay yesterday.tlog --mission my.toml --out what-if
    """


@command(
    "circnav_mav.cli.emulate:run_emulator",
    short_help="Run the bundled vehicle alone, for any client.",
    params=emulator.params[1:],
)
@click.argument("vehicle", required=False, type=FileOrName("mission"), metavar="[VEHICLE]")
def emulate() -> None:
    """Run the bundled simulated vehicle alone, in real time. Any ground station or client may
    connect; Ctrl-C ends it.

    VEHICLE is a vehicle file, or a mission (file or name) with a [sim] table. [default: a hovering
    copter]

    \b
    Example, in two terminals (if --speed is not 1, add --set 'link.clock="autopilot"' to fly):
        circnav emulate quickstart --endpoint udpout:127.0.0.1:14550
        circnav fly quickstart --endpoint udpin:0.0.0.0:14550
    """


@command(
    "circnav_mav.cli.params:print_parameters",
    short_help="Print the autopilot parameters that a mission needs.",
)
@click.argument("path", type=FileOrName("mission"), metavar="MISSION")
@click.option(
    "--format",
    type=click.Choice(("pairs", "qgroundcontrol")),
    help="Lines NAME,VALUE for Mission Planner and MAVProxy (default for ArduPilot), or five"
    " columns for QGroundControl (default for PX4).",
)
@SET
def params() -> None:
    """Print a parameter file for the autopilot of MISSION: the values that `circnav preflight`
    checks, each with its reason. Parameters that depend on the airframe or on the operator's choice
    (stall speed, fence, failsafes) are printed as comments, without a value.

    \b
    Examples, then load it with Mission Planner, MAVProxy (param load) or QGroundControl:
        circnav params plane.toml > plane.param
        circnav params plane.toml --format qgroundcontrol > plane.params
        circnav params px4-copter > copter.params
    """


@command(
    "circnav_mav.cli.init:print_schema", short_help="Print the JSON schema of a file, for editors."
)
@click.argument(
    "kind", type=click.Choice(["mission", *(name for one in extensions() for name in one.schemas)])
)
def schema() -> None:
    """Print the JSON schema of mission or campaign files. Editors with TOML support (Even Better
    TOML, taplo, tombi) complete and check a file that begins with the line: #:schema
    mission.schema.json

    \b
    Example:
        circnav schema mission > mission.schema.json
    """


def main() -> None:
    """Entry point of the `circnav` command."""
    # A notebook that starts circnav sets this variable for its own plots. The plots of circnav need
    # no window.
    os.environ.pop("MPLBACKEND", None)
    # Read when numpy is imported. The matrices are small: several threads of the linear algebra
    # wait for each other (`locate` of 1,400 ranges: 44 s of processor time for 1.6).
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Mission names may contain characters that no font has.
    warnings.filterwarnings("ignore", message="Glyph .* missing from")
    mind_output()
    try:
        if not 0 < unix_time() < YEAR_2100:
            raise Refused("the clock of this computer is not between 1970 and 2100: set the clock")
        result = circnav.main(prog_name="circnav", standalone_mode=False)
    except click.ClickException as error:
        error.show(shown := io.StringIO())
        say(shown.getvalue().rstrip("\n"), err=True)
        result = Exit.USAGE
    except (click.Abort, KeyboardInterrupt):
        result = Exit.INTERRUPTED
    except Refused as refusal:
        say(f"circnav: {printable(str(refusal))}", err=True)
        result = refusal.exit
    except Exception as error:
        if sys.flags.dev_mode:
            raise
        say(f"circnav: {printable(in_one_line(error))}", err=True)
        result = Exit.USAGE if isinstance(error, OSError) else Exit.INTERNAL
    sys.exit(int(result or 0))
