"""The vehicle on real sockets, in real or scaled time. No other module of the emulator reads a
clock."""

import select
import signal
import time
from collections.abc import Callable

from .config import VehicleConfig
from .vehicle import MAIN, RANGING, Vehicle
from .wires import EndpointError, Wire, open_wire, parse_endpoint

# largest delay until a signal or the end of the flight is noticed, s of wall time
LONGEST_SLEEP = 0.25
LATE = 0.2  # lag of the simulated time above which it is reported, s
MAX_CATCH_UP = 0.5  # largest lag that the simulation makes up, s; with a larger lag it slows down


def serve(
    config: VehicleConfig,
    endpoint: str,
    ranging_endpoint: str | None = None,
    speed: float = 1.0,
    duration: float | None = None,
    ready: Callable[[str], None] = lambda line: None,
    stopped: Callable[[], bool] = lambda: False,
    say: Callable[[str], None] = lambda line: None,
) -> None:
    """Fly until `duration` (simulated s) is over or `stopped()` returns True. Raises EndpointError
    if a port cannot be opened or the ranging endpoint is missing.

    ready: called with one line when the ports are open.
    say: called with one line when this computer cannot simulate fast enough.
    """
    if config.ranging.via == "direct" and not ranging_endpoint:
        raise EndpointError(
            'ranging via = "direct" needs --ranging-endpoint, for example udpout:127.0.0.1:14560'
        )
    main = parse_endpoint(endpoint)
    ranging = parse_endpoint(ranging_endpoint) if ranging_endpoint else None
    wires: dict[str, Wire] = {}  # keyed by the name of the first link
    try:
        wires[MAIN] = open_wire(main, MAIN)
        if ranging is not None:
            wires[RANGING] = open_wire(ranging, RANGING)
        vehicle = Vehicle(config)
        also = "" if ranging is None else f", ranging on {ranging}"
        ready(f"sim: {config.vehicle.profile} system {config.vehicle.system_id} on {main}{also}")
        _fly(vehicle, wires, speed, duration, stopped, say)
    finally:
        for wire in wires.values():
            wire.close()


def stop_signals() -> Callable[[], bool]:
    """Catch SIGINT and SIGTERM. Return a function that is True after either signal was received."""
    caught: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _frame: caught.append(received))
    return lambda: bool(caught)


def _fly(
    vehicle: Vehicle, wires: dict[str, Wire], speed: float, duration: float | None,
    stopped: Callable[[], bool], say: Callable[[str], None],
) -> None:  # fmt: skip
    started = quiet_until = time.monotonic()
    lost = 0.0  # lag that the simulation does not make up, s
    while not stopped():
        wall = time.monotonic()
        simulated = (wall - started) * speed
        if duration is not None and simulated >= duration:
            return
        behind = simulated - vehicle.time
        if behind > LATE and wall >= quiet_until:
            # 10.0: wall time between two reports of the lag, s.
            quiet_until = wall + 10.0
            say(
                f"sim: this computer cannot keep up: simulated time is {lost + behind:.1f} s behind"
            )
        # The computer cannot simulate fast enough. Long steps would delay received setpoints until
        # the autopilot's timeouts expire, so the simulation slows down instead.
        if behind > MAX_CATCH_UP:
            started += (behind - MAX_CATCH_UP) / speed
            lost += behind - MAX_CATCH_UP
            simulated -= behind - MAX_CATCH_UP
        vehicle.set_time(time.time())
        vehicle.advance(simulated)
        # Receive after `advance`, so that messages take effect now, not at the previous step.
        for (
            name,
            wire,
        ) in wires.items():
            for link, data in wire.receive():
                vehicle.receive(data, RANGING if name == RANGING else link, stream=wire.stream)
        _send(vehicle, wires)
        _sleep(wires, (vehicle.next_event - simulated) / speed)


def _send(vehicle: Vehicle, wires: dict[str, Wire]) -> None:
    """Send the vehicle's frames. Links have the name of their wire: main, main-2. All ranging links
    send the same frames."""
    ranging = vehicle.outgoing(RANGING) if RANGING in wires else []
    for link in vehicle.links:
        if link != RANGING:
            wires[MAIN].send(link, vehicle.outgoing(link))
    if ranging:
        for link in wires[RANGING].links():
            wires[RANGING].send(link, ranging)


def _sleep(wires: dict[str, Wire], seconds: float) -> None:
    sockets = [s for wire in wires.values() for s in wire.sockets()]
    select.select(sockets, [], [], max(0.0, min(LONGEST_SLEEP, seconds)))
