"""`circnav replay`: a flight that already happened, through the same pilot."""

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import click

from circnav_mav.cli.exits import Exit, Refused, refusing
from circnav_mav.cli.replay_who import say_who
from circnav_mav.mav.ranging.interface import describe_rejected
from circnav_mav.mission.load import MissionError, load_mission, parse_mission
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import OutputMode, Pilot, PilotSettings
from circnav_mav.report.plots import plot_replay
from circnav_mav.runlog.atomic_write import atomic_write
from circnav_mav.runlog.loop_steps import LogClock, LogSources, LoopStep, recorded_steps, tlog_steps
from circnav_mav.runlog.replay import Replayed, as_ticks, differences, held_gain, replay, without_timeouts
from circnav_mav.runlog.run_folder import Run, RunError, open_run, printable
from circnav_mav.runlog.summary import UNRECORDED
from circnav_mav.runlog.ticks import Ticks
from circnav_mav.runlog.tlog import find_damage
from circnav_mav.runtime.recorder import write_ticks

UNITS = {"r": ("range", "m"), "r_dot": ("range rate", "m/s"), "demanded": ("law's turn rate", "rad/s"),
         "turn_rate": ("turn rate", "rad/s")}  # fmt: skip
TICKS, PICTURE = "ticks.csv", "replay.png"
"""What a replay leaves behind."""
LAST_DIGIT = 1e-6
"""ticks.csv holds six decimals."""


@dataclass(frozen=True, slots=True)
class ReplayOptions:
    """The command line of `replay`."""

    log: str
    mission: str | None
    overrides: tuple[str, ...]
    estimator: str | None
    law: str | None
    out: str | None


def replay_log(options: ReplayOptions) -> int:
    """Replay, print what came of it, and return the exit code. Raises Refused."""
    path = Path(options.log)
    with refusing(path, RunError, MissionError):
        _check_out(options.out)
        if path.is_file() and path.name != "flight.tlog":
            return _replay_plain(path, options)
        return _replay_run(open_run(path.parent if path.is_file() else path), options)


def _replay_run(run: Run, options: ReplayOptions) -> int:
    """A run folder: every step of the loop as it was."""
    if not (run.folder / "turns.csv").is_file():
        raise Refused(f"{run.folder}: has no turns.csv; copy its flight.tlog out and replay that with --mission")
    mission = _mission(run.mission_text, str(run.folder / "mission.toml"), options)
    try:
        voice = OutputMode(run.voice)
    except ValueError:
        raise Refused(f"{run.folder / 'manifest.json'}: voice: {run.voice!r} is none that a flight has") from None
    settings = mission.pilot_settings(voice)
    gain = _held_gain(run, settings)
    pilot = Pilot(settings if gain is None else replace(settings, turn_gain=gain))
    done = _replayed(run.folder, pilot, recorded_steps(run.folder), empty="an empty run, nothing was recorded")
    whole = _say_damage(run, done, pilot)
    if gain is not None:
        click.echo(f"  turn gain  held at {gain:.3g}, as at the end of the flight, which flew other turns")
    _say_setpoints(done, whole)
    _say_ticks(done, pilot, run.ticks)
    _write(options, done, run.ticks, mission)
    _check_steered(run.folder, pilot)
    return Exit.DONE


def _replay_plain(path: Path, options: ReplayOptions) -> int:
    """A tlog of anybody's: dry, with ticks added, and without patience running out."""
    if options.mission is None:
        raise Refused(f"{path}: a plain tlog needs --mission: which vehicle, circle and ranging to replay it with")
    mission = _mission("", str(path), options)
    pilot = Pilot(without_timeouts(mission.pilot_settings(OutputMode.DRY_RUN)))
    clock, sources = LogClock(), LogSources(pilot.settings.ranging)
    steps = sources.watch(tlog_steps(path, mission.file.link.component_id, clock), pilot)
    empty = "no MAVLink frame in it: not a tlog, or an empty one"
    done = _replayed(path, pilot, steps, ticking=True, empty=empty)
    if damage := find_damage(path):
        until = f": replayed up to {done.until:.1f} s" if damage.cut else ""
        click.echo(f"  WARNING    {path.name}: {damage}{until}")
    if spoilt := pilot.counts().bad:
        click.echo(f"  WARNING    {path.name}: left out as damaged: {spoilt} of the frames")
    if said := str(clock):
        click.echo(f"  WARNING    {path.name}: {said}")
    say_who(sources, pilot.session.adapter)
    _check_steered(path, pilot)
    _say_ticks(done, pilot, None)
    _write(options, done, None, mission)
    return Exit.DONE


def _replayed(name: Path, pilot: Pilot, steps: Iterable[LoopStep], *, empty: str, ticking: bool = False) -> Replayed:
    """Replay, and say how much that was. ticking: for a plain log. empty: what one without steps is. Raises Refused."""
    began = time.perf_counter()
    done = replay(pilot, steps, ticking=ticking)
    took = time.perf_counter() - began
    if not done.steps:
        raise Refused(f"{name}: {empty}", Exit.NOTHING_HEARD)
    if ticking and done.until == 0:
        raise Refused(f"{name}: its stamps never go on: there is no time in it to replay it by", Exit.NOTHING_HEARD)
    click.echo(f"{name}: {done.until:.1f} s, {done.frames} frames in, replayed in {took:.2f} s")
    return done


def _mission(text: str, where: str, options: ReplayOptions) -> Mission:
    """The mission to replay with: the run's own or another, with the changes asked for. Raises MissionError."""
    chosen = {"estimator": options.estimator, "law": options.law}
    overrides = [*options.overrides, *(f'guidance.{key}="{name}"' for key, name in chosen.items() if name is not None)]
    parse = partial(load_mission, options.mission) if options.mission else partial(parse_mission, text, where)
    as_it_is, mission = parse(), parse(overrides=overrides)
    gain = as_it_is.file.guidance.gain
    if gain is not None and mission.law.name != as_it_is.law.name and mission.file.guidance.gain == gain:
        raise Refused(
            f"{options.mission or where}: guidance.gain {gain:g} belongs to the law {as_it_is.law.name}: "
            f"give one for {mission.law.name} with --set guidance.gain=..."
        )
    return mission


def _held_gain(run: Run, settings: PilotSettings) -> float | None:
    """See `held_gain`; None where mission or ticks of the flight cannot be read, which is told later."""
    try:
        flown = parse_mission(run.mission_text, str(run.folder / "mission.toml")).pilot_settings(settings.output_mode)
        return held_gain(settings, flown, run.ticks)
    except (MissionError, RunError):
        return None


def _check_steered(name: Path, pilot: Pilot) -> None:
    """A replay that never steered says why, and its exit code does. Raises Refused."""
    if pilot.engaged_at is not None:
        return
    if pilot.outcome is not None:
        why = pilot.outcome.reason
    elif not pilot.session.up:
        why = f"no vehicle: {'; '.join(pilot.session.misfits.values()) or pilot.counts().describe()}"
    else:
        refused = describe_rejected(pilot.tracker.ranging.rejected)
        why = f"{pilot.tracker.accepted} ranges of {pilot.settings.ranging.message} taken, rejected: {refused}"
    raise Refused(f"{name}: nothing to steer by: {why}", Exit.NOTHING_HEARD)


def _say_damage(run: Run, done: Replayed, pilot: Pilot) -> bool:
    """A warning where not all of the flight is in the log as it was; tells whether all is."""
    end = float(run.ticks.time[-1]) if len(run.ticks.time) else 0.0
    short = end - done.until > UNRECORDED
    spoilt = pilot.counts().bad
    problems = [run.damage_text] if run.damage_text else []
    if short and not (run.damage and run.damage.cut):
        where = "is damaged" if run.damage else "ends"
        problems.append(f"replayed up to {done.until:.1f} s of {end:.1f} s, where flight.tlog or turns.csv {where}")
    if spoilt:
        problems.append(f"flight.tlog: left out as damaged: {spoilt} of the frames that came in")
    for problem in problems:
        click.echo(f"  WARNING    {problem}")
    return not (short or spoilt)


def _say_setpoints(done: Replayed, whole: bool) -> None:
    """What was sent against what would have been."""
    was, would = done.was_setpoints, done.setpoints
    if done.identical:
        until = "" if whole else f" up to {done.until:.1f} s"
        click.echo(f"  setpoints  {len(was)} as flown, byte for byte the same{until}, and so is all else that was sent")
        return
    same = len(set(was) & set(would))
    click.echo(f"  setpoints  {len(was)} as flown, {len(would)} in the replay, {same} of them the same")
    click.echo(f"             first frame that differs: {done.first_difference:.3f} s")


def _say_ticks(done: Replayed, pilot: Pilot, was: Ticks | None) -> None:
    """What was estimated and commanded against what would have been."""
    would = as_ticks(done.ticks)
    if was is not None:
        for gap in differences(was, would):
            name, unit = UNITS[gap.column]
            far = f"differs by {gap.rms:.4g} {unit} RMS, {gap.largest:.4g} {unit} at most"
            says = far if gap.largest > LAST_DIGIT else "the same"
            click.echo(f"  {name:<16} {says}, in {gap.ticks} ticks")
    steered = sum(phase == "engaged" for phase in would.phases)
    saturated = sum(record.saturated for record in done.ticks)
    click.echo(f"  ticks      {len(done.ticks)}, {steered} of them steering, {saturated} at the turn-rate limit")
    refused = describe_rejected(dict(sorted(pilot.tracker.ranging.rejected.items())))
    click.echo(f"  ranges     {pilot.tracker.accepted} taken, rejected: {refused}")
    if pilot.outcome is not None:
        early = done.ended is not None and done.until - done.ended > UNRECORDED
        until = f" (at {done.ended:.1f} s; the log goes on to {done.until:.1f} s)" if early else ""
        click.echo(f"  outcome    {pilot.outcome.ending.value}: {pilot.outcome.reason}{until}")


def _write(options: ReplayOptions, done: Replayed, was: Ticks | None, mission: Mission) -> None:
    """The replay's own picture and ticks, where they are asked for. The picture comes first: it tells the ticks for
    those of a replay."""
    if options.out is None:
        return
    folder = Path(options.out)
    folder.mkdir(parents=True, exist_ok=True)
    plot_replay(folder / PICTURE, was, as_ticks(done.ticks), mission.orbit, f"{printable(options.log)}, replayed")
    with atomic_write(folder / TICKS) as fresh:
        write_ticks(fresh, done.ticks)
    click.echo(f"  written    {folder}/{TICKS}, {folder}/{PICTURE}")


def _check_out(out: str | None) -> None:
    """What was recorded is never written over, only what an earlier replay wrote. Raises Refused."""
    folder = Path(out or "")
    if out is None or not folder.is_dir():
        return
    if (folder / "flight.tlog").exists() or ((folder / TICKS).exists() and not (folder / PICTURE).exists()):
        raise Refused(f"--out {out}: holds a recorded flight, name another folder for the replay")
