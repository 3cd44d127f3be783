"""The command line: commands, printing, exit codes. Nothing else prints or exits.

Imports of the rooms stand inside the commands, so that `circnav --help` does not wait for numpy and filterpy.
"""

import gc
import sys
import warnings

import click

from circnav_mav import __version__
from circnav_mav.cli.exits import Exit, Refused
from circnav_mav.cli.terminal import mind_output

CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100}
SET_HELP = "Override a mission value, e.g. --set orbit.radius_m=80. May be repeated."

SELDOM = 200_000
"""Objects between two garbage collections. What a command loads stays; to look through it again and again took a
seventh of the time that `check` takes."""
WEB_HELP = "Show the flight in a browser on this computer, too, at http://127.0.0.1:PORT. [default port: 8080]"


@click.group(context_settings=CONTEXT)
@click.version_option(__version__, prog_name="circnav")
def circnav() -> None:
    """Circle an unknown target with nothing but a range, over MAVLink.

    \b
    First flight, no hardware needed:
        circnav fly config/quickstart.toml

    \b
    Exit codes:
        0    flown to its end (or: nothing found wrong)
        1    internal error
        2    bad usage or mission file
        3    no vehicle or no ranging received
        4    ended by a safety rule, or the operator took over
        5    flown to its end, but the recording is incomplete (disk full or too slow, log.max_mb)
        130  interrupted (after a safe setpoint)
    """


@circnav.command()
@click.argument("mission", type=click.Path())
@click.option("--endpoint", metavar="URL", help="The vehicle: udpin:, udpout:, tcp:HOST:PORT or serial:PATH:BAUD.")
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help=SET_HELP)
@click.option("--speed", type=float, metavar="N", help="Fly the bundled vehicle N times faster than real time.")
@click.option("--duration", type=float, metavar="S", help="Seconds to fly after engaging.")
@click.option("--out", type=click.Path(), metavar="DIR", help="Run folder. [default: runs/<time>-<name>]")
@click.option("--dry-run", is_flag=True, help="Compute and log everything, but send no setpoint and request no mode.")
@click.option("--shadow", is_flag=True, help="Like --dry-run, and send nothing but our heartbeat and the plot values.")
@click.option("--web", is_flag=False, flag_value="8080", metavar="[PORT]", help=WEB_HELP)
def fly(
    mission: str,
    endpoint: str | None,
    overrides: tuple[str, ...],
    speed: float | None,
    duration: float | None,
    out: str | None,
    dry_run: bool,
    shadow: bool,
    web: str | None,
) -> int:
    """Fly MISSION, show it live, and record it in a run folder.

    Switch to any other flight mode and circnav stops sending immediately. Ctrl-C ends the flight safely.

    \b
    Examples:
        circnav fly config/quickstart.toml --set orbit.radius_m=80
        circnav fly config/quickstart.toml --web
        circnav fly config/vehicle_udp.toml --endpoint udpin:0.0.0.0:14550
    """
    from circnav_mav.cli.fly import FlyOptions, fly_mission

    return fly_mission(FlyOptions(mission, endpoint, overrides, speed, duration, out, dry_run, shadow, web))


@circnav.command()
@click.argument("vehicle", required=False, type=click.Path(), metavar="[VEHICLE.toml]")
@click.option(
    "--endpoint", default="udpout:127.0.0.1:14550", show_default=True, metavar="URL", help="Where it sends to."
)
@click.option("--ranging-endpoint", metavar="URL", help='Where its radio sends to, for ranging that goes "direct".')
@click.option("--speed", type=float, default=1.0, show_default=True, metavar="N", help="Times real time.")
def emulate(vehicle: str | None, endpoint: str, ranging_endpoint: str | None, speed: float) -> int:
    """Run the bundled simulated vehicle alone. Any ground station or client may connect; Ctrl-C ends it.

    VEHICLE.toml is a vehicle file, or a mission file with a [sim] table; without it, a copter hovers.

    \b
    Example, in two terminals (at --speed 8 the flight needs --set 'link.clock="autopilot"', too):
        circnav emulate config/quickstart.toml --endpoint udpout:127.0.0.1:14550
        circnav fly config/quickstart.toml --endpoint udpin:0.0.0.0:14550
    """
    from circnav_mav.cli.emulate import run_emulator

    return run_emulator(vehicle, endpoint, ranging_endpoint, speed)


@circnav.command()
@click.argument("mission", type=click.Path())
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help=SET_HELP)
def check(mission: str, overrides: tuple[str, ...]) -> int:
    """Check MISSION without flying it. Prints PASS, WARN or FAIL for each point, with the number and its limit.

    \b
    Example:
        circnav check config/quickstart.toml --set guidance.law=smooth --set guidance.gain=1e-5
    """
    from circnav_mav.cli.check import check_file

    return check_file(mission, overrides)


@circnav.command()
@click.argument("mission", type=click.Path())
@click.option("--endpoint", metavar="URL", help="The vehicle: udpin:, udpout:, tcp:HOST:PORT or serial:PATH:BAUD.")
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help=SET_HELP)
@click.option("--seconds", type=float, default=10.0, show_default=True, metavar="N", help="How long to listen.")
def preflight(mission: str, endpoint: str | None, overrides: tuple[str, ...], seconds: float) -> int:
    """Listen to vehicle and ranging of MISSION; command nothing. Prints PASS, WARN or FAIL for each point.

    Checks identity, mode, streams, range noise and age, clocks, and the parameters that matter. Exit codes: 0 no FAIL,
    2 bad mission, 3 no vehicle received, 4 at least one FAIL.

    \b
    Example:
        circnav preflight config/vehicle_udp.toml --endpoint udpin:0.0.0.0:14550
    """
    from circnav_mav.cli.preflight import preflight_file

    return preflight_file(mission, endpoint, overrides, seconds)


@circnav.command()
@click.argument("log", type=click.Path(), metavar="RUN_OR_TLOG")
@click.option("--mission", type=click.Path(), metavar="FILE", help="Another mission; a plain tlog needs one.")
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help=SET_HELP)
@click.option("--estimator", metavar="NAME", help="Another estimator: guidance.estimator.")
@click.option("--law", metavar="NAME", help="Another law: guidance.law.")
@click.option("--out", type=click.Path(), metavar="DIR", help="Write the replay's ticks.csv and replay.png there.")
def replay(
    log: str,
    mission: str | None,
    overrides: tuple[str, ...],
    estimator: str | None,
    law: str | None,
    out: str | None,
) -> int:
    """Run a recorded flight through the pilot again, and compare. Estimates and commands are set against those of the
    flight.

    RUN_OR_TLOG is a run folder, or a tlog of Mission Planner or MAVProxy with ranging telemetry in it (which needs
    --mission, and is replayed as a dry run). The vehicle's path stays as flown. Exit codes: 0 replayed, 2 bad
    usage, 3 nothing in the log to steer by.

    \b
    Examples:
        circnav replay runs/20260101-120000-quickstart --law switching
        circnav replay yesterday.tlog --mission config/vehicle_udp.toml --out what-if
    """
    from circnav_mav.cli.replay import ReplayOptions, replay_log

    return replay_log(ReplayOptions(log, mission, overrides, estimator, law, out))


@circnav.command()
@click.argument("run", type=click.Path())
@click.option("--mcap", "mcap", is_flag=False, flag_value="", metavar="[FILE]", help="MCAP. [default: RUN/flight.mcap]")
def export(run: str, mcap: str | None) -> int:
    """Convert RUN, a run folder, for Foxglove or PlotJuggler. The file holds ticks, truth and events.

    \b
    Example:
        circnav export runs/20260101-120000-quickstart --mcap
    """
    if mcap is None:
        raise Refused("export: say what to write: --mcap")
    from circnav_mav.cli.export import export_run

    return export_run(run, mcap or None)


@circnav.command()
@click.option("--out", type=click.Path(), default="paper", show_default=True, metavar="DIR", help="Where to write.")
@click.option("--starts", type=int, default=200, show_default=True, metavar="N", help="Random starts of each example.")
@click.option("--seed", type=int, default=1, show_default=True, metavar="N", help="Of the random starts.")
def paper(out: str, starts: int, seed: int) -> int:
    """Reproduce the three examples of the paper. Draws six figures, and prints a table of predicted and reached radius.

    \b
    Example:
        circnav paper --out paper --starts 500
    """
    from circnav_mav.cli.paper import reproduce

    return reproduce(out, starts, seed)


@circnav.command()
@click.option("--flights", type=int, default=1000, show_default=True, metavar="N", help="Flights of each cell.")
@click.option("--law", "laws", multiple=True, metavar="NAME", help="Only this law (law+estimator). May be repeated.")
@click.option("--situation", "situations", multiple=True, metavar="NAME", help="Only this situation. May be repeated.")
@click.option("--seed", type=int, default=1, show_default=True, metavar="N", help="Of all worlds.")
@click.option("--out", type=click.Path(), metavar="DIR", help="Write table.csv, table.md and table.png there.")
@click.option("--cost", is_flag=True, help="Only measure how long a step of each estimator takes on this computer.")
def bench(
    flights: int, laws: tuple[str, ...], situations: tuple[str, ...], seed: int, out: str | None, cost: bool
) -> int:
    """Compare the laws over many flights. Wind, gusts, moving targets, bad sensors; the result is one table.

    \b
    Examples:
        circnav bench --flights 50 --out bench
        circnav bench --law auto --situation "wind .33 V"
    """
    from circnav_mav.cli.bench import fly_bench

    return fly_bench(flights, laws, situations, seed, out, cost)


@circnav.command()
@click.argument("file", type=click.Path(), metavar="FILE.toml")
@click.option("--runs", type=click.IntRange(1), metavar="N", help="Flights. [default: as the file says]")
@click.option("--out", type=click.Path(), metavar="DIR", help="Folder. [default: campaigns/<time>-<name>]")
@click.option("--resume", is_flag=True, help="Go on with the campaign in DIR where it stopped.")
@click.option("--processes", type=click.IntRange(1), metavar="N", help="Processes. [default: all cores]")
@click.option("--scheduler", metavar="ADDR", help="Fly on a Dask scheduler's workers, e.g. tcp://host:8786.")
def campaign(
    file: str, runs: int | None, out: str | None, resume: bool, processes: int | None, scheduler: str | None
) -> int:
    """Fly a mission many times with varied values. FILE.toml says which; the result is a table, a summary and plots.

    \b
    Examples:
        circnav campaign config/campaigns/wind.toml
        circnav campaign config/campaigns/wind.toml --runs 20000 --out wind --resume
    """
    from circnav_mav.cli.campaign import CampaignOptions, fly_campaign

    return fly_campaign(CampaignOptions(file, runs, out, resume, scheduler, processes))


@circnav.command()
@click.argument("run", type=click.Path())
@click.option(
    "--after-flight", is_flag=True, hidden=True, help="As fly ends: what it makes, and a line for what fails."
)
def report(run: str, after_flight: bool) -> int:
    """Draw the report of RUN, a run folder. Writes report.html (one page, opens offline, prints), flight.png and
    estimates.png.

    `fly` makes report.html and flight.png by itself.

    \b
    Example:
        circnav report runs/20260101-120000-quickstart
    """
    from circnav_mav.cli.report import report_flight, report_run

    return report_flight(run) if after_flight else report_run(run)


def main() -> None:
    """Entry point of the `circnav` command."""
    gc.set_threshold(SELDOM)
    warnings.filterwarnings("ignore", message="Glyph .* missing from")  # of names that no font of the pictures has
    mind_output()
    try:
        result = circnav.main(standalone_mode=False)
    except click.ClickException as error:
        error.show()
        result = Exit.USAGE
    except (click.Abort, KeyboardInterrupt):
        result = Exit.INTERRUPTED
    except Refused as refusal:
        click.echo(f"circnav: {refusal}", err=True)
        result = refusal.exit
    sys.exit(int(result or 0))
