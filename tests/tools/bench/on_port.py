"""`circnav fly` in a separate process, in real time, and its vehicle on a UDP port of this
process."""

import select
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from circnav_sim.config import load_vehicle
from circnav_sim.vehicle import Vehicle

from tests.process import ROOT

SETPOINT = 84
LONGEST_WAIT = 0.05


class VehicleOnPort:
    """The emulated vehicle of a mission on a UDP port. It sends to the application that last sent
    to it. Times are in s since the start."""

    def __init__(self, mission: Path) -> None:
        self.vehicle = Vehicle(load_vehicle(mission))
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self._peer: tuple[str, int] | None = None
        self._began = time.monotonic()
        self.endpoint = f"udpout:127.0.0.1:{self._socket.getsockname()[1]}"

    @property
    def now(self) -> float:
        return time.monotonic() - self._began

    @property
    def received(self) -> bool:
        """True if the application has sent a datagram."""
        return self._peer is not None

    def speak(self) -> Iterator[bytes]:
        """Advance the vehicle to now. Send its frames, and yield each frame."""
        self.vehicle.advance(self.now)
        for frame in self.vehicle.outgoing():
            if self._peer is not None:
                self._socket.sendto(frame, self._peer)
                yield frame

    def receive(self) -> bytes:
        """Wait for a datagram of the application until the vehicle's next event. Pass it to the
        vehicle and return it."""
        wait = min(self.vehicle.next_event - self.now, LONGEST_WAIT)
        if not select.select([self._socket], [], [], max(wait, 0.0))[0]:
            return b""
        data, self._peer = self._socket.recvfrom(65535)
        self.vehicle.receive(data)
        return data

    def turn(self) -> bytes:
        """Send the vehicle's frames, then receive a datagram."""
        for _ in self.speak():
            pass
        return self.receive()


@contextmanager
def flown(
    mission: Path, *arguments: str
) -> Iterator[tuple[VehicleOnPort, "subprocess.Popen[bytes]", Path]]:
    """Start `circnav fly` on a vehicle. Yield the vehicle, the process, and the run folder."""
    vehicle = VehicleOnPort(mission)
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        program = [sys.executable, "-m", "circnav_mav", "fly", str(mission)]
        command = [*program, "--out", str(run), "--endpoint", vehicle.endpoint, *arguments]
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)
        try:
            yield vehicle, process, run
        finally:
            process.kill()
            process.wait()
