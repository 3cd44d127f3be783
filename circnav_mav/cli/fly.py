"""`circnav fly`: flies a mission file."""

import traceback
from collections.abc import Callable
from contextlib import ExitStack, closing, nullcontext, suppress
from functools import partial
from importlib import import_module
from itertools import chain, count
from pathlib import Path
from threading import Thread
from typing import Any

from rich.console import Console

from circnav_mav.cli.check import flown_overrides, read_mission, refuse_failing
from circnav_mav.cli.closing import close_flight, write_manifest
from circnav_mav.cli.connect import (
    link_troubles,
    open_links,
    open_listeners,
    open_signing,
    start_clock,
)
from circnav_mav.cli.drawing import Drawing
from circnav_mav.cli.exits import Exit, Refused, in_one_line, outlive_terminal, refusing, say, warn
from circnav_mav.cli.verdict import verdict
from circnav_mav.extension import flown_by
from circnav_mav.foreign import read_text
from circnav_mav.mav.check_result import Grade
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import VEHICLE, Ending, OutputMode, Pilot
from circnav_mav.pilot.loop_step import STEPS
from circnav_mav.runtime.clock import Clock, local_time_name
from circnav_mav.runtime.display import display_for
from circnav_mav.runtime.links import Link
from circnav_mav.runtime.lockstep import Lockstep
from circnav_mav.runtime.recorder import Recorder, RecorderError, TakenError
from circnav_mav.runtime.reserve import Reserve, take_memory
from circnav_mav.runtime.runner import StopRequest, run
from circnav_mav.runtime.status import AlarmLog
from circnav_mav.time_limit import time_limit

EXITS = {
    Ending.COMPLETED: Exit.DONE,
    Ending.NOTHING_RECEIVED: Exit.NOTHING_RECEIVED,
    Ending.ABORTED: Exit.ABORTED,
    Ending.TAKEN_OVER: Exit.ABORTED,
    Ending.INTERRUPTED: Exit.INTERRUPTED,
}
MOST_WATCHED = 10.0
"""Simulation speed, times real time, up to which the display is refreshed a constant number of
times per real second. Above it, the display is refreshed a constant number of times per simulated
second."""
CLOCK_BEHIND = 60.0
"""The run folder is renamed by the autopilot's UTC if this computer's clock is later than this
behind the autopilot's UTC, s."""
RECORDED = ("flight.tlog", STEPS, "ticks.csv", "summary.json", "manifest.json")
"""Files that mark a folder as a recorded flight."""


def fly_mission(path: str, **options: Any) -> int:
    """Fly a mission with the options of `fly`, and return the exit code. Raises Refused before the
    flight begins, or after a crash of the loop."""
    return int((flown_by(options) or _fly_vehicle)(path, **options))


def _fly_vehicle(
    path: str,
    *,
    endpoint: str | None,
    overrides: tuple[str, ...],
    speed: float | None,
    duration: float | None,
    out: str | None,
    output_mode: str | None,
    **options: Any,
) -> int:
    """Fly one vehicle. options: options that extensions add."""
    outlive_terminal()
    Thread(target=_import_libraries, daemon=True).start()
    # From now on, a signal ends the flight, not the process.
    stop = StopRequest()
    mission = _mission(path, flown_overrides(overrides, endpoint, duration), speed)
    # Refuse a bad folder before anything is opened.
    _run_folder(out, mission)
    with ExitStack() as watched_open:
        with ExitStack() as open_things:
            signing, signing_time = open_signing(mission, open_things)
            links = open_links(mission, open_things, stop)
            stop.claim()
            pilot = Pilot(mission, signing, OutputMode(output_mode or "fly"))
            listeners = open_listeners(
                mission, pilot, signing, options | {"speed": speed}, watched_open
            )
            recorder = open_things.enter_context(closing(_recorder(out, mission)))
            folder = recorder.folder
            with refusing(folder):
                reserve = watched_open.enter_context(closing(Reserve(folder)))
            take_memory(pilot.settings)
            clock = start_clock(mission, pilot.session, links, speed, listeners.pace)
            recorder.start(clock.epoch_us, at_once=isinstance(clock, Lockstep))
            listeners.start(clock.epoch_us)
            write_manifest(folder, mission, pilot, clock.epoch_us)
            # With the bundled vehicle, load the plotting packages (1 s) during the flight. For a
            # real flight, start the drawing only at the end: a companion computer must send
            # setpoints, and has little memory.
            drawing = Drawing(folder) if isinstance(clock, Lockstep) else None
            alarms = AlarmLog(pilot, listeners)
            display = display_for(
                Console(),
                pilot,
                listeners,
                alarms,
                mission.file.name,
                min(clock.speed, MOST_WATCHED),
            )
            open_things.callback(display.close)
            listeners.attached += [alarms, display]
            # Only user-defined code may fail to return.
            own_limit = partial(time_limit, simulated=clock.simulated)
            limit = own_limit if mission.own_code else nullcontext
            loop = partial(run, pilot, links, clock, recorder, listeners, stop, signing_time, limit)
            crash = _crash_of(loop, pilot, links, clock, folder)
        assert pilot.mission.outcome is not None
        code = Exit.INTERNAL if crash is not None else EXITS[pilot.mission.outcome.ending]
        summary, code = close_flight(
            pilot, recorder, mission, clock.epoch_us, code, alarms.begun, listeners, reserve
        )
        if out is None and crash is None:
            folder = _dated(folder, mission.file.name, clock, pilot.session.vehicle.utc.offset)
        words = verdict(summary, folder)
        listeners.show_verdict(words, folder)
    say(words)
    problems = [
        *link_troubles(links, mission),
        *listeners.all_problems(),
        signing_time.problem if signing_time else None,
    ]
    warn(*problems, *(drawing or Drawing(folder)).draw())
    stop.release()
    if crash is not None:
        raise Refused(crash, Exit.INTERNAL)
    return code


def _mission(path: str, overrides: tuple[str, ...], speed: float | None) -> Mission:
    """Return a mission that may be flown at this simulation speed. Raises Refused."""
    mission = read_mission(path, overrides)
    if speed is not None and not mission.flies_sim:
        raise Refused(
            "--speed: only the bundled vehicle can be simulated faster, not"
            f" {mission.file.link.endpoint}"
        )
    refuse_failing(path, mission, shown=[Grade.WARN])
    return mission


def _import_libraries() -> None:
    """Import the libraries of filter and lap plan. The import takes a second, in which the link
    opens and the heartbeats begin. The first range waits until it is done."""
    # An error, such as too many open files, is raised again where the flight imports the library.
    with suppress(Exception):
        for library in ("filterpy.kalman", "scipy.optimize"):
            import_module(library)


def _run_folder(out: str | None, mission: Mission) -> Path:
    """Return the folder to record into. Raises Refused if it holds a flight, or another
    mission.toml."""
    if out is None:
        return new_folder(mission.file.name)
    folder = Path(out)
    own = folder / "mission.toml"
    with refusing(own):
        for name in RECORDED:
            if (folder / name).exists():
                raise Refused(f"--out {out}: holds {name} already, name another folder")
        if own.exists() and read_text(own) != mission.text:
            raise Refused(f"--out {out}: holds another mission.toml, name another folder")
    return folder


def _dated(folder: Path, name: str, clock: Clock, unix_zero: float | None) -> Path:
    """Return the name of the run folder. Rename the folder by the autopilot's UTC if this
    computer's clock is behind, as on a computer without network and clock battery.

    unix_zero: autopilot's Unix time at run time zero, s.
    """
    # If the autopilot's time is the earlier one, the autopilot has no UTC from GPS, or is emulated.
    if unix_zero is None or unix_zero - clock.epoch_us / 1e6 < CLOCK_BEHIND:
        return folder
    dated = new_folder(name, unix_zero)
    with suppress(OSError):
        return folder.rename(dated)
    return folder


def new_folder(name: str, unix: float | None = None) -> Path:
    """Return the path of a new folder in runs/, named by time and mission. unix: Unix time, s, None
    for now."""
    base = f"{local_time_name(unix)}-{name}"
    names = chain((base,), (f"{base}-{number}" for number in count(2)))
    return next(folder for one in names if not (folder := Path("runs") / one).exists())


def _recorder(out: str | None, mission: Mission) -> Recorder:
    """Open a recorder in a new folder, even if two flights start at once. Raises Refused."""
    while True:
        try:
            return Recorder(_run_folder(out, mission), mission.text)
        except TakenError as error:
            if out is not None:
                raise Refused(f"--out {error}") from None
        except RecorderError as error:
            raise Refused(str(error)) from None


def _crash_of(
    loop: Callable[[], None], pilot: Pilot, links: dict[str, Link], clock: Clock, folder: Path
) -> str | None:
    """Run to the end and return None. After an exception, send a safe setpoint and return a
    description of the exception."""
    try:
        loop()
    except BaseException as error:  # includes sys.exit() in another package
        # Send first, because writing to the disk may block or fail.
        links[VEHICLE].send(pilot.last_frames(clock.now()), pilot.session.reply_to)
        cause = in_one_line(error)
        pilot.abandon(cause)
        report = folder / "error.txt"
        with suppress(OSError):
            report.write_text(traceback.format_exc(), encoding="utf-8")
        return f"{cause}, see {report}"
    return None
