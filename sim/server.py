"""The vehicle on real sockets in real or scaled time: the only place of the emulator that reads a clock."""

import select
import signal
import time
from collections.abc import Callable

from .config import VehicleConfig
from .vehicle import MAIN, RANGING, Vehicle
from .wires import EndpointError, Wire, open_wire, parse_endpoint

LONGEST_SLEEP = 0.25  # s of wall time: signals and the end of the flight are seen by then
LATE = 0.2  # s of simulated time behind that are worth a line
BURST = 0.5  # s of simulated time at most caught up in one go
TELL_EVERY = 10.0  # s of wall time between two such lines


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
    """Fly until `duration` (simulated s) is over or `stopped()`; `ready` gets one line once the ports are open, `say`
    one when this computer cannot keep up.

    Raises EndpointError when a port cannot be opened or the ranging endpoint is missing.
    """
    if config.ranging.via == "direct" and not ranging_endpoint:
        raise EndpointError('ranging via = "direct" needs --ranging-endpoint, for example udpout:127.0.0.1:14560')
    main, ranging = parse_endpoint(endpoint), parse_endpoint(ranging_endpoint) if ranging_endpoint else None
    wires: dict[str, Wire] = {}  # by the name of their first link
    try:
        wires[MAIN] = open_wire(main, MAIN)
        if ranging is not None:
            wires[RANGING] = open_wire(ranging, RANGING)
        vehicle, also = Vehicle(config), "" if ranging is None else f", ranging on {ranging}"
        ready(f"sim: {config.vehicle.profile} system {config.vehicle.system_id} on {main}{also}")
        _fly(vehicle, wires, speed, duration, stopped, say)
    finally:
        for wire in wires.values():
            wire.close()


def stop_signals() -> Callable[[], bool]:
    """From here on SIGINT and SIGTERM end nothing by themselves; tells whether one has come."""
    heard: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _frame: heard.append(received))
    return lambda: bool(heard)


def _fly(
    vehicle: Vehicle, wires: dict[str, Wire], speed: float, duration: float | None,
    stopped: Callable[[], bool], say: Callable[[str], None],
) -> None:  # fmt: skip
    started = quiet_until = time.monotonic()
    lost = 0.0  # simulated time left out for good, s
    while not stopped():
        wall = time.monotonic()
        simulated = (wall - started) * speed
        if duration is not None and simulated >= duration:
            return
        behind = simulated - vehicle.time
        if behind > LATE and wall >= quiet_until:
            quiet_until = wall + TELL_EVERY
            say(f"sim: this computer cannot keep up: simulated time is {lost + behind:.1f} s behind")
        if behind > BURST:  # the machine cannot keep up: fly slower rather than deaf
            started += (behind - BURST) / speed
            lost += behind - BURST
            simulated -= behind - BURST
        vehicle.tell_time(time.time())
        vehicle.advance(simulated)
        for name, wire in wires.items():  # what has arrived acts now, not when the vehicle was last looked at
            for link, data in wire.receive():
                vehicle.receive(data, RANGING if name == RANGING else link, stream=wire.stream)
        _speak(vehicle, wires)
        _sleep(wires, (vehicle.next_event - simulated) / speed)


def _speak(vehicle: Vehicle, wires: dict[str, Wire]) -> None:
    """Links are named after their wire: main, main-2; the ranging wire's listeners all hear the same radio."""
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
