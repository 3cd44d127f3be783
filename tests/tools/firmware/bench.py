"""Test bench for one simulated vehicle: the bench relays between autopilot and circnav, records the
truth, and acts as the operator.

Two links to the firmware: one for circnav through the relay, which records every setpoint and hides
positions; one for the truth, the operator and the ranging radio. Truth is NED and clockwise from
north. Time is the autopilot's own clock, in simulated seconds.
"""

import select
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from math import cos, degrees, nan, radians
from pathlib import Path
from typing import Any, Protocol

from pymavlink.dialects.v20 import all as mavlink

from tests.tools.firmware.flight import Flight
from tests.tools.firmware.wire import (
    GLOBAL_POSITION_INT,
    GPS_HEALTH,
    LOOPBACK,
    POSITIONS,
    Setpoint,
    bound,
    frames,
    mode_shown,
    parser,
    setpoint,
    without_position,
)

BRING_UP_PATIENCE = 300.0
ACCEPTED = 0
IN_PROGRESS = 5


def _unix_time() -> float:
    return time.time()


class NoFlightError(Exception):
    """Raised if the vehicle does not start to fly, so there is no result about circnav."""


@dataclass(frozen=True)
class Truth:
    """True state from the simulator: m from the first position, altitude above the sea, angles in
    rad. wall: Unix time of receipt, s, for comparison with other vehicles."""

    time: float
    north: float
    east: float
    altitude: float
    v_north: float
    v_east: float
    v_down: float
    roll: float
    yaw: float
    airspeed: float
    wall: float = field(default_factory=_unix_time)


@dataclass(frozen=True)
class Reported:
    """State reported by the autopilot, with the autopilot's timestamp: position north and east in
    the frame of the truth, m; velocity, m/s; heading, rad."""

    time: float
    north: float
    east: float
    v_north: float
    v_east: float
    heading: float


class Firmware(Protocol):
    """Differences between ArduPilot and PX4, and the conversion of positions that both use. earth:
    radius of the sphere, m."""

    earth: float
    guided: int
    steered: frozenset[int]
    """Modes in which circnav steers."""
    holding: int
    system: int
    shared: socket.socket
    own: socket.socket
    own_peer: tuple[str, int] | None = None
    _origin: tuple[int, int] | None = None

    def start(self, folder: Path) -> subprocess.Popen[bytes]: ...
    def truth(self, bench: "Bench", message: Any) -> Truth | None: ...
    def bring_up(self, bench: "Bench") -> None: ...
    def weather(self, bench: "Bench") -> None: ...
    def wind(self, bench: "Bench", speed: float, from_: float) -> None: ...
    def without_gps(self, bench: "Bench") -> None: ...
    def ask_mode(self, bench: "Bench", mode: int) -> None: ...
    def circle(self, bench: "Bench", north: float, east: float) -> tuple[float, float]: ...
    def climb(
        self, bench: "Bench", at: float, meters: float
    ) -> Iterator[tuple[float, Callable[[], None]]]:
        """Yield the operator's actions with which the vehicle climbs, with their times, s."""
        ...

    def take_off(self, bench: "Bench") -> Iterator[tuple[float, Callable[[], None]]]:
        """Yield the operator's inputs of a take-off that begins after the start of circnav, with
        their times, s."""
        ...

    def beat(self, bench: "Bench") -> None:
        """Send the operator's repeated inputs, called once per second. The default sends
        nothing."""
        return

    def circling(self, bench: "Bench") -> None:
        """Send repeated inputs that the autopilot's own circle mode requires. The default sends
        nothing."""
        return

    def metres(self, latitude: int, longitude: int) -> tuple[float, float]:
        """Return the position north and east of the first position, m, from degrees times 1e7."""
        self._origin = self._origin or (latitude, longitude)
        north = radians((latitude - self._origin[0]) * 1e-7) * self.earth
        return north, radians((longitude - self._origin[1]) * 1e-7) * self.earth * cos(
            radians(self._origin[0] * 1e-7)
        )

    def degrees_e7(self, north: float, east: float) -> tuple[int, int]:
        """Return the inverse of `metres`."""
        assert self._origin is not None
        latitude, longitude = self._origin[0] * 1e-7, self._origin[1] * 1e-7
        at = (
            latitude + degrees(north / self.earth),
            longitude + degrees(east / (self.earth * cos(radians(latitude)))),
        )
        return round(at[0] * 1e7), round(at[1] * 1e7)


def note(*words: object) -> None:
    """Print progress to stderr; the result is printed to stdout."""
    print(*words, file=sys.stderr, flush=True)


class Bench:
    """One simulated vehicle, from the start to the end of its process."""

    def __init__(self, flight: Flight, firmware: Firmware, folder: Path, app_port: int) -> None:
        self.flight = flight
        self.firmware = firmware
        self.app_port = app_port
        self.folder = folder
        self._shared = firmware.shared
        self._own = firmware.own
        self._relay = bound()
        self._shared_peer: tuple[str, int] | None = None
        self._own_peer = firmware.own_peer
        self._from_vehicle = parser()
        self._from_app = parser()
        self._operator = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.radio = mavlink.MAVLink(None, srcSystem=firmware.system, srcComponent=192)
        self._boot = 0.0
        self._boot_at = 0.0
        self._beat_at = 0.0
        self.latest: dict[str, Any] = {}
        self.counts: Counter[str] = Counter()
        self.from_app: Counter[str] = Counter()
        self._acks: list[tuple[int, int]] = []
        self._params: set[str] = set()
        self.modes: list[tuple[float, int]] = []
        self.texts: list[tuple[float, str]] = []
        self.track: list[Truth] = []
        self.setpoints: list[Setpoint] = []
        self.reported: list[Reported] = []
        self.hidden = 0
        """Number of frames with a position that were not forwarded, or forwarded without it."""
        self._hidden = POSITIONS - GPS_HEALTH if flight.gps_shown else POSITIONS
        if flight.external_position:
            self._hidden = frozenset()
        self.on_truth: Callable[[Truth], None] | None = None
        self.app: subprocess.Popen[bytes] | None = None
        self.relaying = False
        self.shown_modes: list[tuple[float, int]] = []
        self.longest_pause = 0.0
        self._truth_at = time.monotonic()
        self._process = firmware.start(folder)

    @property
    def now(self) -> float:
        """Simulated time, s, extrapolated by the computer's clock between the autopilot's
        messages."""
        return self._boot + min(time.monotonic() - self._boot_at, 0.2)

    @property
    def truth(self) -> Truth:
        return self.track[-1]

    @property
    def airspeed(self) -> float:
        """Airspeed reported by the autopilot, m/s; nan: not yet reported."""
        return self.latest["VFR_HUD"].airspeed if "VFR_HUD" in self.latest else nan

    @property
    def received(self) -> bool:
        return "HEARTBEAT" in self.latest

    def send(self, message: Any, by: mavlink.MAVLink | None = None) -> None:
        """Send a message to the vehicle, by default from the operator."""
        by = by or self._operator
        if self._own_peer:
            self._own.sendto(message.pack(by), self._own_peer)
            by.seq = (by.seq + 1) % 256

    def pump(self, wait: float = 0.005) -> None:
        """Process received datagrams. Wait if none has arrived."""
        if time.monotonic() - self._beat_at > 1.0:
            self._beat_at = time.monotonic()
            self.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
            radio = mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_ONBOARD_CONTROLLER, 8, 0, 0, 4, 3
            )
            self.send(radio, self.radio)
            self.firmware.beat(self)
        for ready in select.select([self._shared, self._own, self._relay], [], [], wait)[0]:
            for _ in range(100):
                try:
                    data, peer = ready.recvfrom(65535)
                except (BlockingIOError, ConnectionRefusedError):
                    break
                self._took(ready, data, peer)
        if self._process.poll() is not None:
            raise NoFlightError(f"the firmware ended with {self._process.returncode}")

    def _took(self, ready: Any, data: bytes, peer: tuple[str, int]) -> None:
        if ready is self._relay:
            self._on_app_data(data)
        elif ready is self._shared:
            self._shared_peer = peer
            self._to_app(data)
        else:
            self._own_peer = peer
            for message in self._from_vehicle.parse_buffer(data) or ():
                sender = (message.get_srcSystem(), message.get_srcComponent())
                if (
                    sender == (self.firmware.system, mavlink.MAV_COMP_ID_AUTOPILOT1)
                    and message.get_type() != "BAD_DATA"
                ):
                    self._on_vehicle_message(message)

    def _to_app(self, data: bytes) -> None:
        if not self.relaying:
            return
        kept = []
        for number, frame in frames(data):
            shown = mode_shown(number, frame)
            if shown is not None:
                self.shown_modes.append((self.now, shown))
            self.hidden += number in self._hidden
            if number == GLOBAL_POSITION_INT and self._hidden:
                kept.append(without_position(frame))
            elif number not in self._hidden:
                kept.append(frame)
        if kept:
            with suppress(ConnectionRefusedError, BlockingIOError):
                self._relay.sendto(b"".join(kept), (LOOPBACK, self.app_port))

    def _on_app_data(self, data: bytes) -> None:
        if self._shared_peer:
            self._shared.sendto(data, self._shared_peer)
        for message in self._from_app.parse_buffer(data) or ():
            self.from_app[message.get_type()] += 1
            one = setpoint(message, self.now, self.flight.speed)
            if one is not None:
                self.setpoints.append(one)

    def _on_vehicle_message(self, message: Any) -> None:
        kind = message.get_type()
        self.latest[kind] = message
        self.counts[kind] += 1
        handle = getattr(self, f"_on_{kind.lower()}", None)
        if handle is not None:
            handle(message)
        truth = self.firmware.truth(self, message)
        if truth is None:
            return
        self.longest_pause = max(self.longest_pause, time.monotonic() - self._truth_at)
        self._truth_at = time.monotonic()
        self.track.append(truth)
        if self.on_truth:
            self.on_truth(truth)

    def _on_attitude(self, message: Any) -> None:
        self._boot = message.time_boot_ms / 1000
        self._boot_at = time.monotonic()

    def _on_global_position_int(self, message: Any) -> None:
        if self.track:
            place = self.firmware.metres(message.lat, message.lon)
            motion = (message.vx / 100, message.vy / 100, radians(message.hdg / 100))
            self.reported.append(Reported(message.time_boot_ms / 1000, *place, *motion))

    def _on_command_ack(self, message: Any) -> None:
        self._acks.append((message.command, message.result))

    def _on_param_value(self, message: Any) -> None:
        self._params.add(message.param_id.rstrip("\0"))

    def _on_statustext(self, message: Any) -> None:
        self.texts.append((self.now, message.text))
        note(f"  [{self.now:8.2f}] {message.text}")

    def _on_heartbeat(self, message: Any) -> None:
        if not self.modes or self.modes[-1][1] != message.custom_mode:
            self.modes.append((self.now, message.custom_mode))

    def pump_until(self, condition: Callable[[], bool], seconds: float) -> bool:
        """Process datagrams until a condition is true, up to a time of the computer, s. Return True
        if the condition is true."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.pump()
            if condition():
                return True
        return False

    def until(self, condition: Callable[[], object], seconds: float, what: str) -> None:
        """Wait for a condition, up to a simulated time, s."""
        began = self.now
        wall = time.monotonic()
        while self.now - began < seconds and time.monotonic() - wall < BRING_UP_PATIENCE:
            self.pump()
            if condition():
                return
        raise NoFlightError(what)

    def rest(self, seconds: float) -> None:
        began = self.now
        self.until(
            lambda: self.now - began >= seconds, seconds + 5, "the simulation does not advance"
        )

    def request(self, number: int, *values: float, attempt: int = 0) -> None:
        """Send a command without waiting for its result. Other values are 0."""
        values = (*values, *[0.0] * (7 - len(values)))
        to = (self.firmware.system, 1)
        self.send(mavlink.MAVLink_command_long_message(*to, number, attempt, *values))

    def command(self, number: int, *values: float, tries: int = 5) -> int | None:
        """Return the result of a command; None without an answer."""
        requests = (partial(self.request, number, *values, attempt=one) for one in range(tries))
        results = (self._answer(number, one) for one in requests)
        return next((one for one in results if one is not None), None)

    def command_at(
        self, number: int, frame: int, values: tuple[float, ...], x: int, y: int, z: float
    ) -> int | None:
        """Send a command with a position and return its result, or None."""
        to = (self.firmware.system, 1)
        message = mavlink.MAVLink_command_int_message(*to, frame, number, 0, 0, *values, x, y, z)
        return self._answer(number, partial(self.send, message))

    def _answer(self, number: int, send: Callable[[], None]) -> int | None:
        self._acks.clear()
        send()
        self.pump_until(lambda: self._result(number) is not None, 1.0)
        return self._result(number)

    def _result(self, number: int) -> int | None:
        found = (result for command, result in self._acks if command == number)
        return next((result for result in found if result != IN_PROGRESS), None)

    def set_parameter(
        self, name: str, value: float, kind: int = mavlink.MAV_PARAM_TYPE_REAL32
    ) -> None:
        """Set a parameter and wait for the confirmation."""
        for _ in range(8):
            self._params.discard(name)
            self.send_parameter(name, value, kind)
            if self.pump_until(lambda: name in self._params, 0.7):
                return
        raise NoFlightError(f"parameter {name} was not confirmed")

    def send_parameter(
        self, name: str, value: float, kind: int = mavlink.MAV_PARAM_TYPE_REAL32
    ) -> None:
        """Send a parameter without waiting for the confirmation, because the radio must continue in
        flight."""
        to = (self.firmware.system, 1)
        self.send(mavlink.MAVLink_param_set_message(*to, name.encode(), float(value), kind))

    def ask_streams(self, wanted: Mapping[int, float], truth: str, least: float) -> None:
        """Request messages at these rates, Hz, until attitude and truth arrive often enough within
        2 s. An autopilot that is still booting refuses without an answer."""
        for _ in range(20):
            for number, hertz in wanted.items():
                self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1e6 / hertz, tries=1)
            self.counts.clear()
            self.rest(2)
            if min(self.counts["ATTITUDE"], self.counts[truth]) > least:
                return
        raise NoFlightError(f"no {truth}")

    def set_mode(self, mode: int) -> None:
        """Request a mode until the heartbeat reports it."""
        for _ in range(20):
            self.firmware.ask_mode(self, mode)
            began = self.now
            while self.now - began < 1.5:
                self.pump()
                if self.latest["HEARTBEAT"].custom_mode == mode:
                    return
        raise NoFlightError(f"mode {mode} was refused")

    def close(self) -> None:
        """Stop circnav, then the vehicle."""
        for process in (self.app, self._process):
            if process is not None and process.poll() is None:
                process.send_signal(signal.SIGTERM)
                try:
                    process.wait(8)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
        for one in (self._shared, self._own, self._relay):
            one.close()
