"""What `fly` and `preflight` share: the mission's links and key opened, the bundled vehicle started, the clock of the
run."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import click

from circnav_mav.cli.emulate import EmulatedVehicle
from circnav_mav.cli.exits import Exit, Refused
from circnav_mav.locate.locator import Locator
from circnav_mav.mav.session import Session
from circnav_mav.mav.signing import Signing
from circnav_mav.mission.mission import SIM, Mission
from circnav_mav.pilot import RANGING, VEHICLE, Pilot
from circnav_mav.runlog.metrics import TOLERANCE
from circnav_mav.runtime.clock import AutopilotClock, Clock
from circnav_mav.runtime.keys import KeyFileError, SigningTime, read_key, timestamp_path
from circnav_mav.runtime.links import Link, LinkError, UdpLink, open_link
from circnav_mav.runtime.locating import Locating
from circnav_mav.runtime.web.feed import LivePage, WebError

MOST_PORT = 65535
LOOPBACK = "udpin:127.0.0.1:0"


def open_links(mission: Mission, open_things: ExitStack) -> dict[str, Link]:
    """The mission's endpoints, opened. Raises Refused."""
    endpoints = {VEHICLE: mission.file.link.endpoint}
    if mission.file.ranging.endpoint:
        endpoints[RANGING] = mission.file.ranging.endpoint
    links: dict[str, Link] = {}
    for name, endpoint in endpoints.items():
        try:
            peers = () if endpoint == SIM else mission.file.link.peer or ()
            links[name] = open_link(LOOPBACK if endpoint == SIM else endpoint, peers)
        except LinkError as error:
            raise Refused(str(error), Exit.NOTHING_HEARD if error.nobody else Exit.USAGE) from None
        open_things.callback(links[name].close)
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
        signing_time = SigningTime(signing, timestamp_path(path))
    except KeyFileError as error:
        raise Refused(f"signing.key_file: {error}") from None
    open_things.callback(signing_time.close)
    return signing, signing_time


def open_locating(mission: Mission, pilot: Pilot, signing: Signing | None, open_things: ExitStack) -> Locating | None:
    """The survey of the target beside the pilot, where the mission wants one."""
    settings = mission.locate_settings
    if settings is None:
        return None
    cot = mission.file.locate.cot
    host, _, port = (cot or "").rpartition(":")
    name = f"{mission.file.name}.target"
    locating = Locating(Locator(settings, pilot, signing), name, (host, int(port)) if cot else None)
    open_things.callback(locating.close)
    return locating


def open_page(
    port: str | None, pilot: Pilot, mission: Mission, open_things: ExitStack, locator: Locator | None
) -> LivePage | None:
    """The live page on a port, where one is wanted. Raises Refused."""
    if port is None:
        return None
    if not port.isdecimal() or int(port) > MOST_PORT:
        raise Refused(f"--web {port}: is not a port; write: circnav fly MISSION --web [PORT]")
    orbit = mission.orbit
    try:
        page = LivePage(
            pilot,
            int(port),
            name=mission.file.name,
            tolerance=TOLERANCE * orbit.radius,
            speed=run_speed(mission),
            truth=mission.flies_sim,
            locator=locator,
        )
    except WebError as error:
        raise Refused(str(error)) from None
    open_things.callback(page.close)
    click.echo(f"live page at {page.url}")
    return page


def start_vehicle(mission: Mission, vehicle_file: Path, links: dict[str, Link], open_things: ExitStack) -> None:
    """The bundled vehicle, if the mission flies it, speaking to our links. Raises Refused."""
    if not mission.flies_sim:
        return
    ports = {name: link.port for name, link in links.items() if isinstance(link, UdpLink)}
    vehicle = EmulatedVehicle(vehicle_file, ports[VEHICLE], ports.get(RANGING), run_speed(mission))
    open_things.callback(vehicle.stop)


def start_clock(mission: Mission, session: Session) -> Clock:
    """The clock that the mission asks for; it starts the run."""
    if mission.file.link.clock == "autopilot":
        return AutopilotClock(lambda: session.boot_time, run_speed(mission))
    return Clock(run_speed(mission))


def run_speed(mission: Mission) -> float:
    """Times real time that the run goes, as far as it is known beforehand."""
    return mission.file.link.sim_speed if mission.flies_sim else 1.0
