"""Resources that `fly` and `preflight` open: links, signing key, listeners, clock, and the bundled
vehicle."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import Any

from circnav_sim.config import parse_vehicle
from circnav_sim.vehicle import Vehicle

from circnav_mav.cli.exits import Exit, Refused, refusing, warn
from circnav_mav.extension import extensions, load
from circnav_mav.mav.session import Session
from circnav_mav.mav.signing import Signing
from circnav_mav.mission.mission import SIM, Mission
from circnav_mav.pilot import RANGING, VEHICLE, Pilot
from circnav_mav.runtime.clock import AutopilotClock, Clock, steady
from circnav_mav.runtime.endpoint import LinkError
from circnav_mav.runtime.keys import KeyFileError, SigningTime, read_key, timestamp_path
from circnav_mav.runtime.links import RETRY, Link, open_link
from circnav_mav.runtime.listeners import Listeners, ListenerSettings
from circnav_mav.runtime.lockstep import Lockstep
from circnav_mav.runtime.radio_link import open_radio
from circnav_mav.runtime.runner import StopRequest, wait


def open_links(
    mission: Mission, open_things: ExitStack, stop: StopRequest | None = None
) -> dict[str, Link]:
    """Open the endpoints of a mission, except for the bundled vehicle. Raises Refused.

    stop: with this argument, wait up to `link.wait_s` for each address, name or TCP peer that is
        not there yet, until a signal arrives.
    """
    endpoints = {VEHICLE: mission.file.link.endpoint, RANGING: mission.file.ranging.endpoint}
    links: dict[str, Link] = {}
    for name, endpoint in endpoints.items():
        if endpoint in (None, SIM):
            continue
        opens = open_radio if name == RANGING and mission.ranging_driver else open_link
        with refusing(endpoint, LinkError):
            opened = partial(opens, endpoint, mission.file.link.peer or ())
            waits = mission.file.link.wait_s
            link = opened() if stop is None else _await(opened, waits, stop)
            links[name] = open_things.enter_context(closing(link))
        for trouble in links[name].troubles:
            warn(f"{endpoint}: {trouble}: waiting for the device")
    return links


def _await(opened: Callable[[], Link], waits: float, stop: StopRequest) -> Link:
    """Return the link that a function opens. Try again each second if the endpoint may appear
    later. Raises LinkError `waits` seconds after the first failure, and Refused after a signal."""
    shown = ""
    until = None
    while True:
        try:
            return opened()
        except LinkError as error:
            # from the first failure: the import of a driver takes longer than a short wait
            until = steady() + waits if until is None else until
            if not error.no_peer or steady() >= until:
                raise
            if str(error) != shown:
                shown = str(error)
                warn(f"{shown}: waiting")
        wait({}, stop, RETRY)
        if stop.signal_name is not None:
            raise Refused(f"stopped by {stop.signal_name}", Exit.INTERRUPTED)


def link_troubles(links: dict[str, Link], mission: Mission) -> Iterator[str]:
    """Yield one line for each endpoint with errors."""
    for name, link in links.items():
        endpoint = mission.file.ranging.endpoint if name == RANGING else mission.file.link.endpoint
        if link.troubles:
            yield f"{endpoint}: " + "; ".join(
                words if count == 1 else f"{words} ({count} times)"
                for words, count in link.troubles.items()
            )


def open_signing(
    mission: Mission, open_things: ExitStack
) -> tuple[Signing, SigningTime] | tuple[None, None]:
    """Open the signing key of a mission and its timestamp file. (None, None) without signing.
    Raises Refused."""
    table = mission.file.signing
    if table is None:
        return None, None
    path = Path(table.key_file)
    try:
        signing = Signing(read_key(path))
        return signing, open_things.enter_context(
            closing(SigningTime(signing, timestamp_path(path)))
        )
    except KeyFileError as error:
        raise Refused(f"signing.key_file: {error}") from None


def open_listeners(
    mission: Mission,
    pilot: Pilot,
    signing: Signing | None,
    options: Mapping[str, Any],
    open_things: ExitStack,
) -> Listeners:
    """Open the listeners of extensions. options: options of `circnav fly`. Raises Refused."""
    listeners = Listeners()
    open_things.callback(listeners.close)
    settings = ListenerSettings(mission, pilot, signing, options, listeners)
    for extension in extensions():
        if (
            extension.listener is not None
            and (one := load(extension.listener)(settings)) is not None
        ):
            listeners.attached.append(one)
    return listeners


def start_clock(
    mission: Mission,
    session: Session,
    links: dict[str, Link],
    speed: float | None = None,
    pace: float | None = None,
) -> Clock:
    """Start the clock of a mission. With the bundled vehicle, the clock is simulated time, and the
    vehicle's links are added to `links`.

    speed: simulation speed that the user requests, times real time.
    pace: simulation speed that a listener requests, times real time.
    """
    if mission.flies_sim and mission.file.sim is not None:
        vehicle = Vehicle(parse_vehicle(mission.file.sim, "sim"))
        clock = Lockstep(vehicle, mission.run_speed(speed, pace), others=bool(links))
        # Set the vehicle's Unix time only once. A Unix time that followed fast simulated time would
        # advance the timestamps of signatures far beyond real time, also the one stored with the
        # signing key.
        vehicle.set_time(clock.epoch_us / 1e6)
        links.update(clock.links(ranging_apart=mission.file.ranging.endpoint == SIM))
        return clock
    return (
        AutopilotClock(lambda: session.vehicle.boot.newest)
        if mission.file.link.clock == "autopilot"
        else Clock()
    )
