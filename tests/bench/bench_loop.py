"""What the loop costs, as ratios to a baseline in the same run. Prints; asserts nothing.

    python -m tests.bench.bench_loop

1. Range datagram in to setpoint datagram out over UDP loopback: the product's own runner (recorder included) against a
   bare pymavlink loop that parses the datagram and answers with a packed setpoint.
2. CPU of a 600 s mission in lockstep with real bytes, ranges and ticks at 10 Hz.
3. One estimator step against one filterpy predict and update.
"""

import multiprocessing as mp
import socket
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from filterpy.kalman import KalmanFilter
from pymavlink.dialects.v20 import all as dialect

from circnav_mav.guidance.estimators.interface import EstimatorSettings
from circnav_mav.guidance.estimators.range_rate import KalmanRangeRate
from circnav_mav.guidance.types import RangeSample
from circnav_mav.mission.load import load_mission
from circnav_mav.pilot import VEHICLE, Pilot
from circnav_mav.runtime.clock import Clock
from circnav_mav.runtime.links import UdpLink, open_link
from circnav_mav.runtime.recorder import Recorder
from circnav_mav.runtime.runner import StopRequest, run
from tests.flight.lockstep import CONFIG, flight

ROUNDS = 1500
RATE = 100.0
SPTLN = 84


def bare_loop(port: "mp.SimpleQueue[int]") -> None:
    """The least that can answer: parse with pymavlink, pack a setpoint, send."""
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("127.0.0.1", 0))
    port.put(link.getsockname()[1])
    reader, writer = dialect.MAVLink(None), dialect.MAVLink(None, 1, 191)
    reader.robust_parsing = True
    while True:
        data, source = link.recvfrom(65536)
        for message in reader.parse_buffer(data) or ():
            if message.get_type() == "DISTANCE_SENSOR":
                link.sendto(_setpoint().pack(writer), source)


def product_loop(port: "mp.SimpleQueue[int]") -> None:
    """The product's runner as `fly` starts it."""
    mission = load_mission(CONFIG / "vehicle_udp.toml", ["link.endpoint=udpin:127.0.0.1:0"])
    link = open_link(mission.file.link.endpoint)
    assert isinstance(link, UdpLink)
    port.put(link.port)
    with tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(Path(folder), mission.text)
        clock = Clock()
        recorder.start(clock.epoch_us)
        run(Pilot(mission.pilot_settings()), {VEHICLE: link}, clock, recorder, lambda newest, now: None, StopRequest())


def round_trips(server: Callable[["mp.SimpleQueue[int]"], None]) -> list[float]:
    """Times from sending a range to receiving a setpoint, s."""
    port: mp.SimpleQueue[int] = mp.SimpleQueue()
    process = mp.Process(target=server, args=(port,), daemon=True)
    process.start()
    address = ("127.0.0.1", port.get())
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.settimeout(0.2)
    mav = dialect.MAVLink(None, 1, 1)
    times = []
    for index in range(ROUNDS):
        if index % 20 == 0:
            link.sendto(dialect.MAVLink_heartbeat_message(2, 3, 129, 4, 4, 3).pack(mav), address)
        time.sleep(1 / RATE)
        _drain(link, mav, address)
        stamp = int(time.monotonic() * 1000) & 0xFFFFFFFF
        sample = dialect.MAVLink_distance_sensor_message(stamp, 10, 60000, 6000 + index % 3, 4, 0, 24, 0)
        started = time.perf_counter()
        link.sendto(sample.pack(mav), address)
        if _await_setpoint(link):
            times.append(time.perf_counter() - started)
    process.terminate()
    return times[len(times) // 5 :]


def _drain(link: socket.socket, mav: dialect.MAVLink, address: tuple[str, int]) -> None:
    """Read what waits; a question for the time is answered, as a vehicle does."""
    link.setblocking(False)
    try:
        while True:
            for message in dialect.MAVLink(None).parse_buffer(bytearray(link.recv(65536))) or []:
                if message.get_type() == "TIMESYNC" and not message.tc1:
                    link.sendto(dialect.MAVLink_timesync_message(time.monotonic_ns(), message.ts1).pack(mav), address)
    except BlockingIOError:
        link.settimeout(0.2)


def _await_setpoint(link: socket.socket) -> bool:
    try:
        while True:
            data = link.recv(65536)
            if int.from_bytes(data[7:10], "little") == SPTLN:
                return True
    except TimeoutError:
        return False


def _setpoint() -> dialect.MAVLink_message:
    return dialect.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 8, 0x407, 0, 0, 0, 5.0, 0, 0, 0, 0.5, 0, 0, 0.1
    )


def mission_cpu() -> float:
    """CPU seconds of both sides for 600 s of flight."""
    quiet = ("sim.truth.rate_hz=0", "limits.tick_hz=10.0", "limits.duration_s=600.0")
    flown = flight("quickstart", *quiet)
    started = time.process_time()
    flown.fly(610)
    return time.process_time() - started


def estimator_steps(count: int = 5000) -> tuple[float, float]:
    """Microseconds of one `kalman` step (gate and prediction to the command included), and of bare filterpy."""
    estimator = KalmanRangeRate(EstimatorSettings(15.0, 0.35))
    started = time.perf_counter()
    for index in range(count):
        estimator.observe(RangeSample(index * 0.1, index * 0.1, 100.0 + 0.1 * (index % 5), 0.5))
        estimator.at(index * 0.1 + 0.01)
    ours = (time.perf_counter() - started) / count
    bare = KalmanFilter(dim_x=2, dim_z=1)
    bare.H = np.array([[1.0, 0.0]])
    started = time.perf_counter()
    for index in range(count):
        bare.predict()
        bare.update(100.0 + 0.1 * (index % 5))
    return ours * 1e6, (time.perf_counter() - started) / count * 1e6


def main() -> None:
    """Run all three and print."""
    bare, ours = round_trips(bare_loop), round_trips(product_loop)
    medians = [1e6 * statistics.median(times) for times in (bare, ours)]
    tails = [1e6 * statistics.quantiles(times, n=100)[98] for times in (bare, ours)]
    print(
        f"range in -> setpoint out, bare pymavlink loop: median {medians[0]:.0f} us, 99th percentile {tails[0]:.0f} us"
    )
    print(
        f"range in -> setpoint out, circnav:             median {medians[1]:.0f} us, 99th percentile {tails[1]:.0f} us"
    )
    print(f"ratio of the medians: {medians[1] / medians[0]:.2f}   ({len(ours)} of {ROUNDS * 4 // 5} answered)")
    print(f"600 s mission in lockstep, ranges and ticks at 10 Hz, vehicle included: {mission_cpu():.2f} s of CPU")
    step, reference = estimator_steps()
    print(
        f"estimator step {step:.0f} us, bare filterpy predict + update {reference:.0f} us, ratio {step / reference:.2f}"
    )


if __name__ == "__main__":
    main()
