"""Whose telemetry a plain tlog was replayed with, in words."""

from collections.abc import Iterable

import click

from circnav_mav.mav.autopilots.interface import Autopilot
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from circnav_mav.runlog.loop_steps import LogSources, RangeSource

MOST = 6
"""Senders that are named; a ground station may plot dozens of values."""


def say_who(sources: LogSources, adapter: Autopilot) -> None:
    """The vehicle and the source of ranges that were used, and who else speaks in the log."""
    if sources.vehicle is not None:
        system, component = sources.vehicle
        kind = sources.vehicles.get(sources.vehicle, "unknown")
        click.echo(f"  vehicle    system {system}, component {component}: {kind}, flown as {adapter.name}")
    ranging = sources.ranging
    for source, counts in ranging.items():
        if counts.taken:
            click.echo(f"  ranging    {_name(source)}: {counts.taken} of {counts.messages} usable")
    idle = ((counts.messages, source) for source, counts in ranging.items() if not counts.taken)
    unused = (f"{_name(source)}: {count}" for count, source in sorted(idle, key=lambda each: -each[0]))
    others = (
        f"system {system}, component {component}: {kind}, {sources.heartbeats[system, component]} heartbeats"
        for (system, component), kind in sources.vehicles.items()
        if (system, component) != sources.vehicle
    )
    for title, senders in (("unused", unused), ("others", others)):
        if said := _some(senders):
            click.echo(f"  {title:<10} {said}")
    if candidates := sources.candidates:
        keys = " or ".join(sources.distinguishing_keys)
        mixed = sum(ranging[candidate].taken > 0 for candidate in candidates) > 1
        done = "their ranges were mixed" if mixed else "the first heard was taken"
        click.echo(f"  WARNING    {len(candidates)} sensors fit the mission, {done}: name yours with {keys}")


def _name(source: RangeSource) -> str:
    fields = RANGING_MESSAGES[source.message].marks
    marks = ", ".join(f"{mark} {value}" for mark, value in zip(fields, source.marks, strict=True))
    return f"{source.message.upper()} of {source.system}/{source.component} ({marks})"


def _some(names: Iterable[str]) -> str:
    """The first of them, and how many more there are."""
    every = list(names)
    more = [f"and {len(every) - MOST} more"] if len(every) > MOST else []
    return "; ".join(every[:MOST] + more)
