"""`circnav fly MISSION --fleet N`: a fleet on the bundled emulator, with one run folder per
member."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from math import degrees
from pathlib import Path
from typing import Any

from circnav_mav.cli.check import flown_overrides, read_mission, refuse_failing
from circnav_mav.cli.closing import close_flight, write_manifest
from circnav_mav.cli.connect import open_listeners
from circnav_mav.cli.exits import Exit, Refused, outlive_terminal, refusing, say
from circnav_mav.cli.fly import EXITS, new_folder
from circnav_mav.cli.progress import each, progress
from circnav_mav.cli.verdict import verdict
from circnav_mav.extras.fleet.flight import FleetFlight, Member, Tracks, member_overrides
from circnav_mav.extras.fleet.link import FleetLink, LocalNetwork
from circnav_mav.extras.fleet.metrics import FleetFigures, figures
from circnav_mav.extras.fleet.settings import table_of
from circnav_mav.mav.check_result import Grade
from circnav_mav.mission.mission import Mission
from circnav_mav.pilot import Pilot
from circnav_mav.runlog.atomic_write import write_json
from circnav_mav.runtime.clock import steady
from circnav_mav.runtime.recorder import Recorder, RecorderError
from circnav_mav.runtime.runner import StopRequest, wait
from circnav_mav.runtime.status import AlarmLog


def fly_fleet(
    path: str,
    *,
    endpoint: str | None,
    overrides: tuple[str, ...],
    speed: float | None,
    duration: float | None,
    out: str | None,
    output_mode: str | None,
    fleet: int,
    fleet_loss: float,
    fleet_delay: float,
    fleet_compass: float,
    **options: Any,
) -> int:
    """Fly, print the table of the fleet, and return the exit code. Raises Refused."""
    for name, value in (
        ("--endpoint", endpoint),
        ("--speed", speed),
        ("--dry-run, --shadow", output_mode),
    ):
        if value is not None:
            raise Refused(
                f"{name}: cannot be used with --fleet, which flies the bundled vehicles at full"
                " speed: omit the option"
            )
    outlive_terminal()
    stop = StopRequest()
    given = flown_overrides(overrides, endpoint, duration)
    missions = [
        read_mission(path, tuple(member_overrides(path, i + 1, given, fleet, fleet_compass)))
        for i in range(fleet)
    ]
    if not missions[0].flies_sim:
        raise Refused(f"{path}: --fleet flies the bundled vehicle: set link.endpoint to sim")
    refuse_failing(path, missions[0], shown=[Grade.WARN])
    folder = _fleet_folder(out, Path(path).stem)
    seed = (missions[0].file.sim or {}).get("seed", 0)
    network = LocalNetwork(fleet_loss, fleet_delay, seed)
    with ExitStack() as opened:
        # Only the first member has a live page: it shows the other members too.
        rest = options | {"web": None}
        members = [
            _member(one, network, folder, rest if i else options, opened)
            for i, one in enumerate(missions)
        ]
        epoch_us = members[0].clock.epoch_us
        for member in members:
            _start(member, epoch_us)
        flight = FleetFlight(members, network)
        flight.fly(watch=_watch(members[0].listeners.pace, stop), stopped=lambda: stop.signal_name)
        found = figures(flight.tracks)
        codes = [
            _close(member, epoch_us)
            for member in each("writing the run folders", members, len(members))
        ]
    rows = [_row(member, code) for member, code in zip(flight.members, codes, strict=True)]
    link = {"loss": fleet_loss, "delay_s": fleet_delay}
    with refusing(folder):
        write_json(
            folder / "fleet.json", {"mission": path, "link": link, **found.plain(), "each": rows}
        )
    _show(found, flight.tracks.radius, rows)
    say(f"  fleet folder {folder}")
    _draw(flight.tracks, folder)
    return max(codes)


def _draw(tracks: Tracks, folder: Path) -> None:
    """Draw fleet.png and fleet.gif."""
    try:
        with progress("drawing fleet.png and fleet.gif"):
            from circnav_mav.extras.fleet.picture import animate_fleet, draw_fleet

            draw_fleet(tracks, folder / "fleet.png")
            animate_fleet(tracks, folder / "fleet.gif")
    except Exception as error:
        say(f"  WARNING    the pictures in {folder} could not be made: {error}")


def _fleet_folder(out: str | None, name: str) -> Path:
    """Return a new or empty folder for the fleet. Raises Refused."""
    if out is None:
        return new_folder(f"{name}-fleet")
    folder = Path(out)
    with refusing(folder):
        if folder.exists() and any(folder.iterdir()):
            raise Refused(f"--out {out}: the folder is not empty, name another one")
    return folder


def _member(
    mission: Mission,
    network: LocalNetwork,
    folder: Path,
    options: dict[str, Any],
    opened: ExitStack,
) -> Member:
    table = table_of(mission)
    assert table.id is not None
    pilot = Pilot(mission)
    link = FleetLink(network.port(table.id), table.id)
    listeners = open_listeners(mission, pilot, None, options | {"fleet_link": link}, opened)
    try:
        recorder = Recorder(folder / f"{table.id:02d}", mission.text)
    except RecorderError as error:
        raise Refused(str(error)) from None
    opened.enter_context(closing(recorder))
    return Member(mission, link, recorder, listeners, pilot)


def _start(member: Member, epoch_us: int) -> None:
    recorder = member.recorder
    assert isinstance(recorder, Recorder)
    member.vehicle.set_time(epoch_us / 1e6)
    recorder.start(epoch_us, at_once=True)
    member.listeners.start(epoch_us)
    member.alarms = AlarmLog(member.pilot, member.listeners)
    member.listeners.attached.append(member.alarms)
    with refusing(recorder.folder):
        write_manifest(recorder.folder, member.mission, member.pilot, epoch_us)


def _watch(pace: float | None, stop: StopRequest) -> Callable[[FleetFlight], None]:
    """Return a function to call after each sample: it prints progress lines, and waits to limit the
    simulation speed.

    pace: largest simulated seconds per real second, None for no limit.
    """
    began = steady()

    def watch(flight: FleetFlight) -> None:
        _show_progress(flight)
        if pace is not None:
            wait({}, stop, max(began + flight.tracks.time[-1] / pace - steady(), 0.0))

    return watch


def _show_progress(flight: FleetFlight) -> None:
    tracks = flight.tracks
    # 20.0: simulated time between two progress lines, s.
    if tracks.time[-1] % 20.0 < 1e-6:
        words = "  ".join(
            f"{state.name.lower().replace('_', ' '):9s}" for state in tracks.state[-1]
        )
        errors = [m.fleet.adjusted.error for m in flight.members if m.fleet.adjusted is not None]
        known = [abs(error) for error in errors if error is not None]
        worst = f"farthest from its slot {degrees(max(known)):.0f} deg" if known else ""
        say(f"{tracks.time[-1]:7.0f} s  {words}  {worst}")


def _close(member: Member, epoch_us: int) -> Exit:
    """Write the summary and manifest of a member. Return its exit code."""
    outcome = member.pilot.mission.outcome
    recorder = member.recorder
    assert outcome is not None and isinstance(recorder, Recorder) and member.alarms is not None
    code = EXITS[outcome.ending]
    summary, code = close_flight(
        member.pilot,
        recorder,
        member.mission,
        epoch_us,
        code,
        member.alarms.begun,
        member.listeners,
    )
    member.listeners.show_verdict(verdict(summary, recorder.folder), recorder.folder)
    return code


def _row(member: Member, code: Exit) -> dict[str, Any]:
    """Return the entry of a member in fleet.json."""
    ident = member.fleet.spacing.settings.member
    outcome = member.pilot.mission.outcome
    return {
        "id": ident,
        "folder": f"{ident:02d}",
        "outcome": outcome.reason if outcome else "",
        "exit": int(code),
        "link": member.link.summary(),
        "alarms": member.alarms.begun if member.alarms else [],
    }


def _show(found: FleetFigures, radius: float, members: Sequence[dict[str, Any]]) -> None:
    """Print the results of the fleet. radius: radius of the circle, m."""

    def shown(value: float | None, unit: str, unknown: str = "unknown") -> str:
        return unknown if value is None else f"{value:.1f} {unit}"

    even = shown(found.even_after_s, "s later, all gaps within 5 deg", "never all within 5 deg")
    worst = found.worst_gap_deg if found.even_after_s is not None else None
    on_circle = shown(found.all_on_circle_s, "s until all were on it", "never all members")
    flat = shown(found.smallest_horizontal_m, "m")
    say(f"FLEET of {found.members} on {radius:g} m")
    say(f"  on circle   {on_circle}")
    say(f"  even        {even}")
    say(f"  worst gap   {shown(worst, 'deg rms off even spacing')}")
    say(f"  radius      {shown(found.radius_rms_m, 'm rms error')}")
    say(f"  separation  {flat} horizontally, {shown(found.smallest_vertical_m, 'm')} vertically")
    say(f"  too near    {found.too_near} pairs (within 10 m vertically and 25 m horizontally)")
    say("  member  end                          alarms  reports accepted, rejected")
    for one in members:
        link = one["link"]
        say(
            f"  {one['id']:6d}  {one['outcome'][:27]:27s}  {len(one['alarms']):6d} "
            f" {link['accepted']:8d} {sum(link['rejected'].values()):9d}"
        )
