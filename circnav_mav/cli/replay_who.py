"""Whose telemetry a plain tlog was replayed with, in words."""

from collections.abc import Iterable, Iterator

import click

from circnav_mav.mav.autopilots.interface import Autopilot
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from circnav_mav.runlog.log_sources import Heard, Sender, Witness

MOST = 6
"""Senders that are named; a ground station may plot dozens of values."""


def say_who(witness: Witness, adapter: Autopilot) -> None:
    """The vehicle and the sender of ranges that were used, and who else speaks in the log."""
    if witness.vehicle is not None:
        system, component = witness.vehicle
        kind = witness.vehicles.get(witness.vehicle, "unknown")
        click.echo(f"  vehicle    system {system}, component {component}: {kind}, flown as {adapter.name}")
    senders = witness.senders
    for sender, heard in senders.items():
        if heard.taken:
            click.echo(f"  ranging    {_name(sender)}: {heard.taken} of {heard.messages} usable")
    idle = {sender: heard for sender, heard in senders.items() if not heard.taken}
    if idle:
        click.echo(f"  unused     {_some(_unused(idle))}")
    others = (
        f"system {system}, component {component}: {kind}, {witness.heartbeats[system, component]} heartbeats"
        for (system, component), kind in witness.vehicles.items()
        if (system, component) != witness.vehicle
    )
    if said := _some(others):
        click.echo(f"  others     {said}")
    if rivals := witness.rivals:
        keys = " or ".join(witness.choosing)
        mixed = sum(senders[rival].taken > 0 for rival in rivals) > 1
        done = "their ranges were mixed" if mixed else "the first heard was taken"
        click.echo(f"  WARNING    {len(rivals)} sensors fit the mission, {done}: name yours with {keys}")


def _unused(idle: dict[Sender, Heard]) -> Iterator[str]:
    for sender, heard in sorted(idle.items(), key=lambda item: -item[1].messages):
        yield f"{_name(sender)}: {heard.messages}"


def _name(sender: Sender) -> str:
    fields = RANGING_MESSAGES[sender.message].marks
    marks = ", ".join(f"{mark} {value}" for mark, value in zip(fields, sender.marks, strict=True))
    return f"{sender.message.upper()} of {sender.system}/{sender.component} ({marks})"


def _some(names: Iterable[str]) -> str:
    """The first of them, and how many more there are."""
    every = list(names)
    more = [f"and {len(every) - MOST} more"] if len(every) > MOST else []
    return "; ".join(every[:MOST] + more)
