"""Feed of the live page: its contents, and the pipe to the server's process. The pipe is the only
queue. A line that does not fit into the pipe is dropped, so that a slow, stopped or dead server
never delays a tick. The page cannot influence the flight."""

import getpass
import importlib.util
import json
import os
import select
import socket
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from enum import Enum
from math import isfinite
from pathlib import Path
from typing import Any

import circnav_mav
from circnav_mav.cli.exits import Refused, refusing, say
from circnav_mav.mav.truth import is_truth_frame, relative_truth
from circnav_mav.mission.schema import MOST_PORT
from circnav_mav.pilot import Pilot, TickRecord
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.pilot.record import COLUMNS
from circnav_mav.runlog.metrics import TOLERANCE
from circnav_mav.runtime.clock import utc_minute
from circnav_mav.runtime.listeners import Listener, Listeners, ListenerSettings
from circnav_mav.runtime.status import SILENCED, Status, StatusSource, status_facts

HOST = "127.0.0.1"
LINES_A_SECOND = 10
"""Updates of the page per real second. Chosen."""
START_PATIENCE = 10.0
"""Longest time to wait until the server's process is ready, s. Chosen."""
STOP_PATIENCE = 3.0
"""Longest time to wait at the end, for room in the pipe and for the server's process, s. Chosen."""
AWAY = 30.0
"""Time without a browser after which the page of a finished flight is no longer served, s. Chosen:
long enough to reload the page or to reconnect a tunnel."""
LONGEST_TEXT = 300
"""Maximum length of a text on the page, characters. Chosen: only external names are longer."""
NEEDED = ("starlette", "uvicorn")
PAGE_SPEED = 6.0
"""Default simulation speed of the bundled vehicle with the live page, times real time."""


class WebError(Exception):
    """The live page cannot be served. The error message is one line."""


class LivePage(Listener):
    """Listener that runs the server's process and feeds it through a pipe. `on_step` never
    blocks."""

    name = "live page"

    def __init__(
        self,
        pilot: Pilot,
        listeners: Listeners,
        port: int,
        *,
        name: str,
        tolerance: float,
        speed: float,
        truth: bool = False,
    ) -> None:
        """port: TCP port of the page, 0 for any free port.
        tolerance: half width of the drawn band around the radius, m.
        speed: run seconds per real second.
        truth: True to show truth frames. Only the bundled vehicle sends genuine ones.

        Raises WebError.
        """
        missing = [package for package in NEEDED if importlib.util.find_spec(package) is None]
        if missing:
            raise WebError(
                f"--web needs the package{'s' * (len(missing) > 1)} {' and '.join(missing)}:"
                f" pip install {' '.join(missing)}"
            )
        self._watch = StatusSource(pilot, listeners)
        self._listeners = listeners
        self._period = speed / LINES_A_SECOND
        self._due = 0.0
        self._receives_truth = truth
        self._truth = b""
        self._place: tuple[float | None, float | None] = (None, None)
        with _listener(port) as listener:
            self.url = f"http://{HOST}:{listener.getsockname()[1]}/"
            self._process = _serve(listener)
        assert self._process.stdin is not None
        self._pipe: int | None = self._process.stdin.fileno()
        os.set_blocking(self._pipe, False)
        self._queue_event({"kind": "flight", **_facts(pilot, name, tolerance)})

    def on_step(
        self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None
    ) -> Sequence[bytes]:
        """Send the newest tick if an update is due."""
        if self._receives_truth:
            for _, _, frames in step.received:
                self._truth = next(filter(is_truth_frame, frames), self._truth)
        if newest is None or (step.time < self._due and newest.phase is not Phase.ENDED):
            return ()
        self._due = step.time + self._period
        place = relative_truth(self._truth) if self._truth else None
        if place is not None and all(
            map(isfinite, place)
        ):  # any sender may send a truth frame with NaN
            self._place = place
        status = self._watch.status(newest, step.time, recording_problem)
        (east, north) = map(_plain, self._place)
        # 20: maximum number of other vehicles on the page. A line of the feed must fit into
        # PIPE_BUF bytes.
        others = self._listeners.vehicles(step.time)[:20]
        tick = _tick(status) | {
            "east": east,
            "north": north,
            "vehicles": _plain(others),
        }
        self._queue_event({"kind": "tick", **tick})
        return ()

    def show_verdict(self, verdict: str, folder: Path) -> None:
        """Send the verdict and the path of the report. Wait up to STOP_PATIENCE for room in the
        pipe."""
        if self._pipe is not None:
            select.select([], [self._pipe], [], STOP_PATIENCE)
            self._queue_event(
                {
                    "kind": "end",
                    "verdict": verdict,
                    "report": str(folder.absolute() / "report.html"),
                }
            )

    def close(self) -> None:
        """End the feed. Kill the server if it does not close its stdout within STOP_PATIENCE. A
        server that does may keep running for a browser."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        if process.stdout.closed:
            return
        self._pipe = None
        with suppress(OSError):
            process.stdin.close()
        ended, _, _ = select.select([process.stdout], [], [], STOP_PATIENCE)
        if not ended:
            process.kill()
        process.stdout.close()
        process.poll()

    def _queue_event(self, what: dict[str, Any]) -> None:
        """Write a line to the pipe, or drop it if the pipe is full. Up to PIPE_BUF bytes are
        written atomically, so no line is partial."""
        line = json.dumps(what, allow_nan=False).encode() + b"\n"
        if self._pipe is None or len(line) > select.PIPE_BUF:
            return
        try:
            os.write(self._pipe, line)
        except BlockingIOError:
            return
        except OSError:
            self._pipe = None


def open_listener(given: ListenerSettings) -> LivePage | None:
    """Return the live page if `--web` is given, else None. Raises Refused."""
    port = given.options.get("web")
    mission = given.mission
    if port is None:
        return None
    if not port.isdecimal() or int(port) > MOST_PORT:
        raise Refused(f"--web {port}: is not a port; write: circnav fly MISSION --web [PORT]")
    tolerance = TOLERANCE * mission.orbit.radius
    speed = mission.run_speed(given.options.get("speed"), PAGE_SPEED)
    with refusing("--web", WebError):
        page = LivePage(
            given.pilot,
            given.others,
            int(port),
            name=mission.file.name,
            tolerance=tolerance,
            speed=speed,
            truth=mission.flies_sim,
        )
    page.pace = PAGE_SPEED
    say(f"live page at {page.url}")
    # In an SSH session, the page is served on the remote computer, but the operator's browser runs
    # on another one. Print the command for a tunnel.
    if len(connection := os.environ.get("SSH_CONNECTION", "").split()) == 4:
        tunnel = page.url.removeprefix("http://").rstrip("/")
        say(
            f"from your own computer: ssh -L {tunnel.rpartition(':')[2]}:{tunnel}"
            f" {getpass.getuser()}@{connection[2]}"
        )
    return page


def _listener(port: int) -> socket.socket:
    """Return a socket that listens on the loopback interface. It is opened before the flight.
    Raises WebError."""
    try:
        return socket.create_server((HOST, port))
    except OSError as error:
        why = os.strerror(error.errno or 0)
        raise WebError(
            f"--web {port}: {HOST}:{port} cannot be used: {why}; choose another port"
        ) from None


def _serve(listener: socket.socket) -> "subprocess.Popen[bytes]":
    """Start the server's process and wait until it is ready. Raises WebError."""
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "circnav_mav.extras.web", str(listener.fileno()), str(AWAY)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        pass_fds=[listener.fileno()],
        env={**os.environ, "PYTHONPATH": str(Path(circnav_mav.__file__).parents[1])},
        start_new_session=True,  # Ctrl-C reaches only the flight
    )
    assert process.stdout is not None
    ready, _, _ = select.select([process.stdout], [], [], START_PATIENCE)
    if not ready or not process.stdout.readline():
        process.kill()
        process.communicate()
        raise WebError("--web: the server of the live page did not start")
    return process


def _facts(pilot: Pilot, name: str, tolerance: float) -> dict[str, Any]:
    """Return the values that do not change in flight, SI units."""
    orbit = pilot.settings.orbit
    return {
        "name": name,
        "date": utc_minute(),
        "circle": orbit.words(),
        "radii": [orbit.radius],
        "radius": orbit.radius,
        "tolerance": tolerance,
        "limit": orbit.max_turn_rate,
        "steady": orbit.steady_turn_rate,
        "silenced": SILENCED.get(pilot.output_mode),
    }


def _tick(status: Status) -> dict[str, Any]:
    """Return a status as JSON values."""
    about = {
        "now": status.time,
        "state": status.phase,
        "alarms": [alarm[:LONGEST_TEXT] for alarm in status.alarms],
        "facts": {name: fact[:LONGEST_TEXT] for name, fact in status_facts(status).items()},
    }
    tick = {name: getattr(status.tick, name) for name in COLUMNS}
    return {name: _plain(value) for name, value in (tick | about).items()}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, float):
        return round(value, 5) if isfinite(value) else None
    return value
