"""`circnav preflight`: checks of the mission, then of the connected vehicle and ranging."""

from contextlib import ExitStack

from circnav_mav.cli.check import (
    flown_overrides,
    read_mission,
    refuse_failing,
    show_checks,
    show_counts,
)
from circnav_mav.cli.connect import link_troubles, open_links, open_signing, start_clock
from circnav_mav.cli.exits import Exit, Refused, say
from circnav_mav.extension import added_checks
from circnav_mav.mav.check_result import Check, Grade
from circnav_mav.preflight.checks import judge
from circnav_mav.preflight.listener import PreflightListener
from circnav_mav.runtime.clock import AutopilotClock
from circnav_mav.runtime.runner import StopRequest, listen

MEASURED = frozenset({"vehicle", "mode", "ranging", "distance"})
"""Subjects of check lines that are printed even if they pass: they contain measured values."""


def preflight_file(
    path: str, endpoint: str | None, overrides: tuple[str, ...], seconds: float, verbose: bool
) -> int:
    """Check the mission, listen to the vehicle, print check lines, and return the exit code. Raises
    Refused."""
    if not 1 <= seconds <= 600:
        raise Refused(f"--seconds: must be at least 1 and at most 600, not {seconds:g}")
    mission = read_mission(path, flown_overrides(overrides, endpoint))
    shown = list(Grade) if verbose else [Grade.WARN, Grade.FAIL]
    of_mission = refuse_failing(path, mission, shown)
    say(f"listening on {mission.file.link.endpoint} for {seconds:g} s, no setpoint is sent ...")
    with ExitStack() as open_things:
        signing, signing_time = open_signing(mission, open_things)
        links = open_links(mission, open_things)
        listener = PreflightListener(mission, seconds=seconds, signing=signing)
        clock = start_clock(mission, listener.session, links)
        stop = StopRequest()
        listen(listener, links, clock, stop, signing_time)
        if stop.signal_name:
            raise Refused(f"stopped by {stop.signal_name}", Exit.INTERRUPTED)
        clock_speed = clock.speed if isinstance(clock, AutopilotClock) else 1.0
        troubles = [Check(Grade.WARN, "endpoint", words) for words in link_troubles(links, mission)]
    added = list(added_checks("preflight", mission))
    lines = [*judge(mission, listener, clock_speed), *troubles, *added]
    show_checks([line for line in lines if line.grade in shown or line.subject in MEASURED])
    failed = show_counts(path, [*of_mission, *lines])
    if mission.flies_sim:
        remedy = "set link.endpoint, or give --endpoint"
        say(f'{path}: judged the bundled emulator (link.endpoint = "sim"), no vehicle: {remedy}')
    if not listener.session.up:
        return Exit.NOTHING_RECEIVED
    return Exit.ABORTED if failed else Exit.DONE
