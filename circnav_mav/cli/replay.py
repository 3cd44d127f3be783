"""`circnav replay`: feeds a recorded flight to the guidance loop."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from circnav_sim.config import ConfigError

from circnav_mav.cli.check import refuse_failing
from circnav_mav.cli.exits import Exit, Refused, refusing, say, warn
from circnav_mav.cli.progress import Show, progress
from circnav_mav.foreign import printable
from circnav_mav.guidance.laws import LAWS
from circnav_mav.mav.ranging.interface import describe_rejected
from circnav_mav.mission.load import MissionError, load_mission, parse_mission
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import VEHICLE, OutputMode, Pilot
from circnav_mav.pilot.controller import FlownCommands
from circnav_mav.pilot.loop_step import STEPS, LoopStep
from circnav_mav.runlog.atomic_write import atomic_write
from circnav_mav.runlog.loop_steps import check_tlog, recorded_steps, tlog_steps
from circnav_mav.runlog.replay import (
    ReplayResult,
    as_ticks,
    differences,
    flown_commands,
    replay,
    truth_errors,
    without_timeouts,
)
from circnav_mav.runlog.run_folder import Run, RunError, open_run
from circnav_mav.runlog.summary import UNRECORDED
from circnav_mav.runlog.ticks import Ticks
from circnav_mav.runtime.recorder import write_ticks

UNITS = {
    "r": ("range", "m"),
    "r_dot": ("range rate", "m/s"),
    "position": ("position", "m"),
    "demanded": ("law's turn rate", "rad/s"),
    "turn_rate": ("turn rate", "rad/s"),
}
TICKS = "ticks.csv"
PICTURE = "replay.png"
"""Names of the files that a replay writes."""


def replay_log(
    log: str,
    mission: str | None = None,
    overrides: Sequence[str] = (),
    estimator: str | None = None,
    law: str | None = None,
    out: str | None = None,
) -> int:
    """Replay a log, print the results, and return the exit code. Raises Refused."""
    path = Path(log)
    chosen = {"estimator": estimator, "law": law}
    overrides = [
        *overrides,
        *(f'guidance.{key}="{name}"' for key, name in chosen.items() if name is not None),
    ]
    # User-defined code that the operator names needs no permission: a replay steers no vehicle.
    if law or estimator:
        overrides.append("guidance.own_code_on_vehicle=true")
    with refusing(path, RunError, MissionError, ConfigError):
        _check_out(out)
        if path.is_file() and path.name != "flight.tlog":
            _replay_plain(log, mission, overrides, out)
        else:
            _replay_run(log, mission, overrides, out)
    return Exit.DONE


def _replay_run(log: str, other: str | None, overrides: Sequence[str], out: str | None) -> None:
    """Replay the recorded steps of a run folder, with its own mission or another."""
    run = open_run(Path(log).parent if Path(log).is_file() else Path(log))
    if not (run.folder / STEPS).is_file():
        raise Refused(
            f"{run.folder}: has no steps.csv; copy its flight.tlog to another folder and replay the"
            " copy with --mission"
        )
    own = str(run.folder / "mission.toml")
    parse = partial(load_mission, other) if other else partial(parse_mission, run.mission_text, own)
    name = other or own
    mission = _mission(name, parse, overrides)
    # Check only a changed mission. The mission as flown may fail checks that an older version did
    # not have.
    if other or overrides:
        refuse_failing(name, mission, shown=())
    try:
        output_mode = OutputMode(run.output_mode)
    except ValueError:
        raise Refused(
            f"{run.folder / 'manifest.json'}: output_mode: {run.output_mode!r} is unknown"
        ) from None
    with refusing(run.folder):
        pilot = Pilot(mission, output_mode=output_mode)
    if pilot.flies:
        pilot.controller.flown = _flown_commands(run, mission)
    empty = "nothing to replay: flight.tlog or steps.csv is empty, or damaged from its beginning on"
    until = None
    with suppress(RunError):  # damaged ticks are reported after the replay
        until = run.ticks.end
    done = _replayed(run.folder, pilot, recorded_steps(run.folder), empty=empty, until=until)
    whole = _say_damage(run, done, pilot)
    if pilot.controller.flown is not None:
        say("  response   learned from the commands of the flight, to which the vehicle responded")
    _say_setpoints(done, whole)
    _say_ticks(done, pilot, run.ticks)
    _say_truth(done, run)
    _write(log, out, done, run.ticks, mission)
    _check_steered(run.folder, pilot)


def _replay_plain(log: str, path: str | None, overrides: Sequence[str], out: str | None) -> None:
    """Replay a plain tlog as a dry run. Ticks are added when they are due, and timeouts are
    disabled."""
    if path is None:
        raise Refused(
            f"{Path(log)}: a plain tlog needs --mission, a mission with its vehicle, circle and"
            " ranging"
        )
    mission = _mission(path, partial(load_mission, path), overrides)
    refuse_failing(path, mission, shown=())
    tlog = Path(log)
    check_tlog(tlog)
    pilot = Pilot(without_timeouts(mission), output_mode=OutputMode.DRY_RUN)
    steps = tlog_steps(tlog, mission.file.link.component_id)
    done = _replayed(
        tlog,
        pilot,
        steps,
        ticking=True,
        empty="no MAVLink frame in it: not a tlog, or an empty one",
    )
    _check_steered(tlog, pilot)
    _say_ticks(done, pilot, None)
    _write(log, out, done, None, mission)


def _replayed(
    name: Path,
    pilot: Pilot,
    steps: Iterable[LoopStep],
    *,
    empty: str,
    ticking: bool = False,
    until: float | None = None,
) -> ReplayResult:
    """Replay, and print how much was replayed. Raises Refused.

    ticking: True for a plain tlog. empty: message for a log without steps. until: time of the last
        tick in the log, s, None if it is unknown.
    """
    began = time.perf_counter()
    with progress(f"replaying {name}", until) as show:
        done = replay(pilot, _shown(steps, show), ticking=ticking)
    took = time.perf_counter() - began
    if not done.steps:
        raise Refused(f"{name}: {empty}", Exit.NOTHING_RECEIVED)
    if ticking and done.until == 0:
        raise Refused(
            f"{name}: its timestamps do not increase: it cannot be replayed", Exit.NOTHING_RECEIVED
        )
    say(f"{name}: {done.until:.1f} s, {done.frames} received frames, replayed in {took:.2f} s")
    return done


def _shown(steps: Iterable[LoopStep], show: Show) -> Iterator[LoopStep]:
    """Yield the steps, and show the time of each."""
    for step in steps:
        show(step.time, "")
        yield step


def _mission(where: str, parse: Callable[..., Mission], overrides: Sequence[str]) -> Mission:
    """Return the mission with overrides. Raises MissionError, and Refused if the gain belongs to
    another law."""
    as_it_is = parse()
    mission = parse(overrides=overrides)
    gain = as_it_is.file.guidance.gain
    if (
        gain is not None
        and mission.law.name != as_it_is.law.name
        and mission.law.name in LAWS
        and mission.file.guidance.gain == gain
    ):
        raise Refused(
            f"{where}: guidance.gain {gain:g} belongs to the law {as_it_is.law.name}: "
            f"give the gain of {mission.law.name}: --set guidance.gain=..."
        )
    return mission


def _flown_commands(run: Run, mission: Mission) -> FlownCommands | None:
    """Return the result of `flown_commands`. None if mission or ticks cannot be read, which is
    reported later."""
    try:
        flown = parse_mission(run.mission_text, str(run.folder / "mission.toml"))
        return flown_commands(mission, flown, run.ticks)
    except (MissionError, RunError):
        return None


def _check_steered(name: Path, pilot: Pilot) -> None:
    """Raise Refused with the reason if the replay never steered."""
    if pilot.mission.engaged_at is not None:
        return
    if pilot.mission.outcome is not None:
        why = pilot.mission.outcome.reason
    elif not pilot.session.up:
        misfits = "; ".join(pilot.session.identity.misfits.values())
        why = f"no vehicle: {misfits or pilot.connection.counts[VEHICLE].describe()}"
    else:
        refused = describe_rejected(pilot.tracker.ranging.rejected)
        why = (
            f"{pilot.tracker.accepted} ranges of {pilot.settings.ranging.message} accepted,"
            f" rejected: {refused}"
        )
    raise Refused(f"{name}: never steered: {why}", Exit.NOTHING_RECEIVED)


def _say_damage(run: Run, done: ReplayResult, pilot: Pilot) -> bool:
    """Print warnings about missing or damaged parts of the log. Return True if the log is
    complete."""
    end = run.ticks.end
    short = end - done.until > UNRECORDED
    spoilt = pilot.connection.counts[VEHICLE].bad
    problems = [run.damage_text] if run.damage_text else []
    if short and not (run.damage and run.damage.cut):
        where = "is damaged" if run.damage else "ends"
        problems.append(
            f"replayed up to {done.until:.1f} s of {end:.1f} s, where flight.tlog or steps.csv"
            f" {where}"
        )
    if spoilt:
        problems.append(f"flight.tlog: {spoilt} damaged frames left out")
    warn(*problems)
    return not (short or spoilt)


def _say_setpoints(done: ReplayResult, whole: bool) -> None:
    """Print the comparison of sent and replayed setpoints."""
    was = done.was_setpoints
    would = done.setpoints
    if done.identical:
        until = "" if whole else f" up to {done.until:.1f} s"
        say(
            f"  setpoints  {len(was)} as flown, byte for byte the same{until}, as are all other"
            " sent frames"
        )
        return
    same = len(set(was) & set(would))
    say(f"  setpoints  {len(was)} in the flight, {len(would)} in the replay, {same} identical")
    say(f"             first difference: a frame at {done.first_difference:.3f} s")


def _say_ticks(done: ReplayResult, pilot: Pilot, was: Ticks | None) -> None:
    """Print differences of estimates and commands, if the log has ticks, and the figures of the
    replay."""
    would = as_ticks(done.ticks)
    if was is not None:
        for gap in differences(was, would):
            name, unit = UNITS[gap.column]
            far = f"differs by {gap.rms:.4g} {unit} RMS, at most {gap.largest:.4g} {unit}"
            # 1e-6: resolution of numbers in ticks.csv. Smaller differences are rounding errors.
            difference = far if gap.largest > 1e-6 else "the same"
            say(f"  {name:<16} {difference}, in {gap.ticks} ticks")
    steered = sum(phase == "engaged" for phase in would.words["phase"])
    saturated = sum(record.saturated for record in done.ticks)
    say(
        f"  ticks      {len(done.ticks)}, {steered} of them steering, {saturated} at the turn-rate"
        " limit"
    )
    refused = describe_rejected(dict(sorted(pilot.tracker.ranging.rejected.items())))
    say(f"  ranges     {pilot.tracker.accepted} accepted, rejected: {refused}")
    if pilot.mission.outcome is not None:
        early = done.ended is not None and done.until - done.ended > UNRECORDED
        until = f" (at {done.ended:.1f} s; the log goes on to {done.until:.1f} s)" if early else ""
        say(
            f"  outcome    {pilot.mission.outcome.ending.value}:"
            f" {pilot.mission.outcome.reason}{until}"
        )


def _say_truth(done: ReplayResult, run: Run) -> None:
    """Print the errors of the replay's estimates in the steering ticks, if the log has the
    simulator's truth."""
    truth = None
    with suppress(RunError):  # damage of the log is reported before
        truth = run.truth
    errors = truth_errors(as_ticks(done.ticks), truth) if truth is not None else {}
    if errors:
        words = (f"{UNITS[name][0]} {value:.3g} {UNITS[name][1]}" for name, value in errors.items())
        say(f"  truth      RMS errors of the estimates while steering: {', '.join(words)}")


def _write(
    log: str, out: str | None, done: ReplayResult, was: Ticks | None, mission: Mission
) -> None:
    """Write picture and ticks if `out` is given. Write the picture first: `_check_out` takes a
    folder with ticks but no picture for a recorded flight."""
    if out is None:
        return
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    with progress(f"drawing {PICTURE} and writing {TICKS}"):
        from circnav_mav.report.plots import plot_replay  # imported here: it loads matplotlib

        title = f"{printable(log)}, replayed"
        plot_replay(folder / PICTURE, was, as_ticks(done.ticks), mission.orbit, title)
        with atomic_write(folder / TICKS) as fresh:
            write_ticks(fresh, done.ticks)
    say(f"  written    {folder}/{TICKS}, {folder}/{PICTURE}")


def _check_out(out: str | None) -> None:
    """Raise Refused if `out` holds a recorded flight. Files of an earlier replay may be
    overwritten."""
    folder = Path(out or "")
    if out is None or not folder.is_dir():
        return
    if (folder / "flight.tlog").exists() or (
        (folder / TICKS).exists() and not (folder / PICTURE).exists()
    ):
        raise Refused(f"--out {out}: holds a recorded flight, name another folder for the replay")
