"""What `fly` and `preflight` open: links, key and clock of a mission, and the bundled vehicle at their other end."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack, closing
from math import inf
from pathlib import Path

import click

from circnav_mav.cli.exits import Refused, refusing
from circnav_mav.emulator.config import parse_vehicle
from circnav_mav.emulator.vehicle import Vehicle
from circnav_mav.locate.locator import Locator
from circnav_mav.mav.session import Session
from circnav_mav.mav.signing import Signing
from circnav_mav.mission.mission import SIM, Mission
from circnav_mav.mission.schema import MOST_PORT
from circnav_mav.pilot import RANGING, VEHICLE, Pilot
from circnav_mav.runlog.metrics import TOLERANCE
from circnav_mav.runtime.clock import AutopilotClock, Clock
from circnav_mav.runtime.endpoint import LinkError, explain
from circnav_mav.runtime.keys import KeyFileError, SigningTime, read_key, timestamp_path
from circnav_mav.runtime.links import Link, open_link
from circnav_mav.runtime.locating import Locating
from circnav_mav.runtime.lockstep import Lockstep
from circnav_mav.runtime.radio_link import open_radio
from circnav_mav.runtime.web.feed import LivePage, WebError

PAGE_SPEED = 6.0
"""Times real time that the bundled vehicle flies for people who watch the live page and have asked for no speed."""


def open_links(mission: Mission, open_things: ExitStack) -> dict[str, Link]:
    """The mission's endpoints, opened; the bundled vehicle has none. Raises Refused."""
    endpoints = {VEHICLE: mission.file.link.endpoint, RANGING: mission.file.ranging.endpoint}
    links: dict[str, Link] = {}
    for name, endpoint in endpoints.items():
        if endpoint in (None, SIM):
            continue
        opens = open_radio if name == RANGING and mission.ranging_driver else open_link
        with refusing(endpoint, LinkError):
            links[name] = open_things.enter_context(closing(opens(endpoint, mission.file.link.peer or ())))
    return links


def link_troubles(links: dict[str, Link], mission: Mission) -> Iterator[str]:
    """What went wrong on the endpoints, a line for each."""
    for name, link in links.items():
        endpoint = mission.file.ranging.endpoint if name == RANGING else mission.file.link.endpoint
        if link.troubles:
            yield f"{endpoint}: " + "; ".join(
                words if count == 1 else f"{words} ({count} times)" for words, count in link.troubles.items()
            )


def open_signing(mission: Mission, open_things: ExitStack) -> tuple[Signing, SigningTime] | tuple[None, None]:
    """The mission's key, and what keeps its time; nothing where it has none. Raises Refused."""
    table = mission.file.signing
    if table is None:
        return None, None
    path = Path(table.key_file)
    try:
        signing = Signing(read_key(path), link_id=table.link_id)
        return signing, open_things.enter_context(closing(SigningTime(signing, timestamp_path(path))))
    except KeyFileError as error:
        raise Refused(f"signing.key_file: {error}") from None


def open_locating(mission: Mission, pilot: Pilot, signing: Signing | None, open_things: ExitStack) -> Locating | None:
    """The survey of the target beside the pilot, where the mission wants one. Raises Refused."""
    settings = mission.locate_settings
    if settings is None:
        return None
    cot, name, locator = None, f"{mission.file.name}.target", Locator(settings, pilot, signing)
    if mission.file.locate.cot is not None:
        host, _, port = mission.file.locate.cot.rpartition(":")
        try:  # once: in flight setpoints would wait for a name server
            cot = socket.gethostbyname(host), int(port)
        except (OSError, UnicodeError) as error:
            raise Refused(f"locate.cot: {host}: {explain(error)}") from None
    return open_things.enter_context(closing(Locating(locator, name, cot, waits=mission.flies_sim)))


def open_page(
    port: str | None, pilot: Pilot, mission: Mission, open_things: ExitStack, locator: Locator | None
) -> LivePage | None:
    """The live page on a port, where one is wanted. Raises Refused."""
    if port is None:
        return None
    if not port.isdecimal() or int(port) > MOST_PORT:
        raise Refused(f"--web {port}: is not a port; write: circnav fly MISSION --web [PORT]")
    tolerance, speed = TOLERANCE * mission.orbit.radius, run_speed(mission, page=True)
    with refusing("--web", WebError):
        page = LivePage(
            pilot, int(port), name=mission.file.name, tolerance=tolerance, speed=speed, truth=mission.flies_sim,
            locator=locator,
        )  # fmt: skip
    open_things.callback(page.close)
    click.echo(f"live page at {page.url}")
    return page


def start_clock(mission: Mission, session: Session, links: dict[str, Link], *, page: bool = False) -> Clock:
    """The mission's clock, started: simulated time with the bundled vehicle, whose links join the others."""
    if mission.flies_sim and mission.file.sim is not None:
        vehicle = Vehicle(parse_vehicle(mission.file.sim, "sim"))
        clock = Lockstep(vehicle, run_speed(mission, page=page), others=bool(links))
        vehicle.tell_time(clock.epoch_us / 1e6)  # once: simulated time would carry signatures, and our key's, far ahead
        links.update(clock.links(ranging_apart=mission.file.ranging.endpoint == SIM))
        return clock
    return AutopilotClock(lambda: session.vehicle.boot.newest) if mission.file.link.clock == "autopilot" else Clock()


def run_speed(mission: Mission, *, page: bool = False) -> float:
    """Times real time that the run goes, as far as it is known beforehand; infinite: as fast as the computer allows.
    page: whether people watch it in a browser. A radio of somebody's own beside the bundled vehicle is in real time."""
    file = mission.file
    if not mission.flies_sim:
        return 1.0
    if file.link.sim_speed is not None:
        return file.link.sim_speed
    if file.ranging.endpoint not in (None, SIM):
        return 1.0
    return PAGE_SPEED if page else inf
