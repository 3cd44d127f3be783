"""Time from a range to its setpoint, compared with a bare pymavlink loop in the same run. Prints
figures without asserting.

    python -m tests.tools.bench.bench_loop [--seconds 120]

1. Range datagram in to setpoint datagram out over UDP. `circnav fly` under `auto` and `smooth`,
   each in a separate process, and a minimal pymavlink loop receive the recorded quickstart flight
   in real time, in turn: attitudes, accelerations, airspeed, heartbeats and ranges at the rates
   that circnav requests. TIMESYNC requests are answered. Aim: at most 12 (`auto`) and 6 (`smooth`)
   times the median of the bare loop.
2. The same with ranges at 20 Hz and ATTITUDE at 25 Hz, each law alone on a quarter of one core: a
   control group grants 2.5 ms in 10 ms. Aim: 99 % within half a tick, 25 ms. Requires the right to
   make a control group (root).
"""

import argparse
import heapq
import multiprocessing as mp
import select
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from unittest.mock import patch

import numpy as np
from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.autopilots.table import AUTOPILOTS
from tests.flight.lockstep import SETPOINT_IDS, flight
from tests.frames import read
from tests.process import ROOT
from tests.tools.fault_link.frames import frames, message_id

MISSION = ROOT / "config" / "quickstart.toml"
BARE = "bare pymavlink"
LAWS = ("smooth", "auto")
RANGE = dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR
ANSWERED = {dialect.MAVLINK_MSG_ID_TIMESYNC, dialect.MAVLINK_MSG_ID_COMMAND_ACK}
"""Answers of the recorded vehicle. They are not replayed, because each request gets a new
answer."""
SETTLING = 40.0
"""Time after which every law has settled, s."""
PATIENCE = 0.03
"""Longest wait for an answer, s. Then the range for the next listener is due."""
STARTING = 30.0
GOES_ON = ("limits.duration_s=1e6", "sim.truth.rate_hz=0")
QUARTER = 0.25
PERIOD_US = 10_000
"""Share of one core (QUARTER), and period in which the share is granted, us (PERIOD_US). This is
nearly equal to a whole core at a quarter of the speed."""
HALF_TICK = 0.025
FAST = ("ranging.rate_hz=20.0", "sim.ranging.rate_hz=20.0")
FAST_ATTITUDE = {dialect.MAVLINK_MSG_ID_ATTITUDE: 25.0}
CGROUPS = Path("/sys/fs/cgroup")


def recorded(law: str, seconds: float, *overrides: str) -> list[tuple[float, bytes]]:
    """Return the frames of the vehicle in a flight under a law, with their times, s."""
    received: list[tuple[float, bytes]] = []

    def hears(frame: bytes, now: float) -> bool:
        if message_id(frame) not in ANSWERED:
            received.append((now, frame))
        return True

    flown = flight("quickstart", "sim.truth.rate_hz=10", *GOES_ON, *overrides, law=law)
    flown.hears = hears
    flown.fly(seconds)
    return received


@dataclass
class Listener:
    """A process that receives the flight and answers. Contains the socket to it, and the times of
    its answers, s."""

    name: str
    flight: list[tuple[float, bytes]]
    link: socket.socket
    process: "subprocess.Popen[bytes] | mp.Process | None" = None
    address: tuple[str, int] | None = None
    steers: bool = False
    patience: float = PATIENCE
    latencies: list[float] = field(default_factory=list)
    missed: int = 0

    def __post_init__(self) -> None:
        self.link.bind(("127.0.0.1", 0))
        self.writer = dialect.MAVLink(None, 1, 1)

    @property
    def port(self) -> int:
        return int(self.link.getsockname()[1])

    def take(self) -> bool:
        """Receive one datagram and answer its requests. Return True if it contained a setpoint."""
        data, self.address = self.link.recvfrom(65536)
        setpoint = False
        for frame in frames(data):
            ident = message_id(frame)
            setpoint |= ident in SETPOINT_IDS
            if ident in (dialect.MAVLINK_MSG_ID_TIMESYNC, dialect.MAVLINK_MSG_ID_COMMAND_LONG):
                self._answer(read(frame))
        self.steers |= setpoint
        return setpoint

    def _answer(self, asked: dialect.MAVLink_message) -> None:
        if asked.get_type() == "COMMAND_LONG":
            answer = dialect.MAVLink_command_ack_message(asked.command, dialect.MAV_RESULT_ACCEPTED)
        elif asked.tc1:
            return
        else:
            answer = dialect.MAVLink_timesync_message(time.monotonic_ns(), asked.ts1)
        self.link.sendto(answer.pack(self.writer), self.address)

    def range_to_setpoint(self, frame: bytes) -> float | None:
        """Send a range and return the time until its setpoint arrives, s, or None. Do not wait for
        a listener that does not steer."""
        began = time.perf_counter()
        self.link.sendto(frame, self.address)
        steers = self.steers
        self.steers = False
        while steers and select.select([self.link], [], [], self.patience)[0]:
            if self.take():
                return time.perf_counter() - began
        return None

    def close(self) -> None:
        if self.process is not None:
            self.process.kill()
        self.link.close()


def bare_loop(port: int) -> None:
    """Minimal loop: parse with pymavlink, pack a setpoint, send."""
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    reader = dialect.MAVLink(None)
    writer = dialect.MAVLink(None, 1, 191)
    reader.robust_parsing = True
    setpoint = dialect.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 8, 0x407, 0, 0, 0, 5.0, 0, 0, 0, 0.5, 0, 0, 0.1
    )
    link.sendto(b"here", ("127.0.0.1", port))
    while True:
        data, source = link.recvfrom(65536)
        for message in reader.parse_buffer(data) or ():
            if message.get_type() == "DISTANCE_SENSOR":
                link.sendto(setpoint.pack(writer), source)


def start(name: str, seconds: float, folder: Path, *overrides: str) -> Listener:
    """Start a listener in a separate process."""
    law = "smooth" if name == BARE else name
    here = Listener(
        name, recorded(law, seconds, *overrides), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    )
    if name == BARE:
        here.process = mp.Process(target=bare_loop, args=(here.port,), daemon=True)
        here.process.start()
        return here
    command = [
        sys.executable,
        "-m",
        "circnav_mav",
        "fly",
        str(MISSION),
        "--out",
        str(folder / name),
    ]
    command += [
        "--endpoint",
        f"udpout:127.0.0.1:{here.port}",
        "--duration",
        "1e6",
        "--set",
        f'guidance.law="{law}"',
    ]
    command += [part for override in overrides for part in ("--set", override)]
    here.process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)
    return here


@contextmanager
def limited(share: float) -> Iterator[Callable[[int], None]]:
    """Yield a function that limits a process, by its id, to a share of one core. Raises OSError."""
    second = (CGROUPS / "cgroup.controllers").exists()
    group = (CGROUPS if second else CGROUPS / "cpu") / f"circnav-bench-{time.monotonic_ns()}"
    group.mkdir()
    try:
        quota = round(share * PERIOD_US)
        if second:
            (group / "cpu.max").write_text(f"{quota} {PERIOD_US}")
        else:
            (group / "cpu.cfs_period_us").write_text(str(PERIOD_US))
            (group / "cpu.cfs_quota_us").write_text(str(quota))
        yield lambda process: (group / "cgroup.procs").write_text(str(process)) and None
    finally:
        for _ in range(50):
            try:
                group.rmdir()
                break
            except OSError:  # the group cannot be removed until its processes have ended
                time.sleep(0.1)


def play(listeners: list[Listener]) -> None:
    """Send each listener its flight in real time, with ranges a third of a period apart."""
    for one in listeners:
        if not select.select([one.link], [], [], STARTING)[0]:
            raise SystemExit(f"{one.name}: does not speak")
        one.take()
    step = 0.1 / len(listeners)

    def delayed(index: int) -> Iterator[tuple[float, int, bytes]]:
        return ((at + index * step, index, frame) for at, frame in listeners[index].flight)

    links = [one.link for one in listeners]
    began = time.monotonic()
    for at, index, frame in heapq.merge(*map(delayed, range(len(listeners)))):
        while (wait := began + at - time.monotonic()) > 0 or select.select(links, [], [], 0)[0]:
            for link in select.select(links, [], [], max(wait, 0.0))[0]:
                listeners[links.index(link)].take()
        one = listeners[index]
        if message_id(frame) != RANGE:
            one.link.sendto(frame, one.address)
            continue
        one.steers |= one.name == BARE
        took = one.range_to_setpoint(frame)
        if at > SETTLING:
            one.missed += took is None
            one.latencies += [took] if took is not None else []


def latency_table(seconds: float) -> None:
    """Fly all three listeners in parallel, send them ranges in turn, and print the times."""
    with tempfile.TemporaryDirectory() as folder:
        listeners = [start(name, SETTLING + seconds, Path(folder)) for name in (BARE, *LAWS)]
        try:
            play(listeners)
        finally:
            for one in listeners:
                one.close()
            time.sleep(0.2)
    print(
        f"range in -> setpoint out over UDP, {seconds:.0f} s of the quickstart's messages,"
        " microseconds"
    )
    print(
        f"{'':<16}{'median':>8}{'90 %':>8}{'99 %':>8}{'worst':>8}   ratio of medians   of 99 %  "
        " ranges (no answer)"
    )
    bare = np.percentile(listeners[0].latencies or [np.nan], [50, 99])
    for one in listeners:
        if not one.latencies:
            print(
                f"{one.name:<16}does not steer: the computer is too busy for a flight in real time"
            )
            continue
        p50, p90, p99, worst = (
            1e6 * value for value in np.percentile(one.latencies, [50, 90, 99, 100])
        )
        print(
            f"{one.name:<16}{p50:8.0f}{p90:8.0f}{p99:8.0f}{worst:8.0f}{p50 / bare[0] / 1e6:19.2f}"
            f"{p99 / bare[1] / 1e6:10.2f}{len(one.latencies):9} ({one.missed})"
        )


def quarter_table(seconds: float) -> None:
    """Fly each law alone on a quarter of a core, and print the times."""
    print(f"the same on {QUARTER:g} of one core, ranges at 20 Hz, ATTITUDE at 25 Hz, milliseconds")
    for law in LAWS:
        try:
            with tempfile.TemporaryDirectory() as folder, limited(QUARTER) as limit:
                with patch.dict(AUTOPILOTS["ardupilot", "copter"].firmware.streams, FAST_ATTITUDE):
                    one = start(law, SETTLING + seconds, Path(folder), *FAST)
                try:
                    assert one.process is not None and one.process.pid is not None
                    one.patience = 10 * HALF_TICK
                    limit(one.process.pid)
                    play([one])
                finally:
                    one.close()
                    time.sleep(0.2)
        except OSError as error:
            print(f"{law:<16}not measured: no control group ({error})")
            continue
        times = one.latencies + one.missed * [np.inf]
        p50, p99, worst = (
            1e3 * value for value in np.percentile(times or [np.nan], [50, 99, 100], method="lower")
        )
        grade = "within" if p99 < 1e3 * HALF_TICK else "NOT WITHIN"
        print(
            f"{law:<16}median {p50:.1f}, 99 % {p99:.1f} ({grade} {1e3 * HALF_TICK:.0f}), worst"
            f" {worst:.1f}; {len(one.latencies)} ranges ({one.missed} without answer)"
        )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=120.0, help="of real time")
    options = parser.parse_args()
    latency_table(options.seconds)
    quarter_table(options.seconds)


if __name__ == "__main__":
    main()
