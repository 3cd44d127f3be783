"""The fault link: its effect on bytes and times in both directions, repeatable with the same
seed."""

import socket
import time
from random import Random

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.frames import read, rewritten
from tests.process import PATIENCE, python, running
from tests.tools.fault_link import DOWN, UP, FaultLink, Impairment
from tests.tools.fault_link.frames import message_id, write
from tests.tools.fault_link.pipe import Pipe, corrupted
from tests.tools.faults.tampering import dropping, on, outliers


def carried(impairment, count=2000, seed=1, step=0.01):
    """Send numbered datagrams through a pipe. Return (time of arrival, bytes)."""
    pipe = Pipe(impairment, seed)
    out = []
    for n in range(count):
        now = n * step
        pipe.push(n.to_bytes(4, "big"), now)
        out += [(now, data) for data in pipe.take(now)]
    out += [(1e6, data) for data in pipe.take(1e6)]
    return out


def numbers(out: list[tuple[float, bytes]]):
    return [int.from_bytes(data, "big") for _, data in out]


def test_clean_link_passes_everything_except_in_outages():
    assert carried(Impairment()) == [(n * 0.01, n.to_bytes(4, "big")) for n in range(2000)]
    passed = numbers(carried(Impairment(outages=((5.0, 10.0),))))
    assert passed == [*range(500), *range(1000, 2000)]


def test_link_faults_repeat_with_seed():
    broken = Impairment(loss=0.1, jitter=0.2, duplicate=0.1, corrupt=0.01, reorder=0.1)
    assert carried(broken, seed=3) == carried(broken, seed=3)
    assert carried(broken, seed=3) != carried(broken, seed=4)


def test_loss_duplicates_and_corruption_have_configured_rates():
    assert len(carried(Impairment(loss=0.2))) == pytest.approx(1600, abs=60)
    assert len(carried(Impairment(duplicate=0.5))) == pytest.approx(3000, abs=70)
    lost = 1 - len(carried(Impairment(burst_every=0.9, burst=0.1), 20000)) / 20000
    assert 0.05 < lost < 0.2
    assert sum(byte != 0 for byte in corrupted(bytes(100_000), 0.01, Random(1))) == pytest.approx(
        1000, rel=0.1
    )


def test_link_delay_and_jitter_stay_within_bounds():
    pipe = Pipe(Impairment(delay=0.1, jitter=0.2), 1)
    for _ in range(300):
        pipe.push(b"x", 0.0)
    assert pipe.take(0.0999) == []
    assert 0 < len(pipe.take(0.2)) < 300
    pipe.take(0.3001)
    assert pipe.next_due == float("inf")


def test_reordering_stays_within_configured_depth():
    assert numbers(carried(Impairment(jitter=0.2))) != list(range(2000))
    assert numbers(carried(Impairment(jitter=0.2, in_order=True))) == list(range(2000))
    passed = numbers(carried(Impairment(reorder=0.25, depth=3)))
    assert sorted(passed) == list(range(2000))
    assert passed != sorted(passed)
    assert max(abs(place - n) for place, n in enumerate(passed)) <= 6


def test_split_and_joined_datagrams_lose_no_byte():
    whole = b"".join(n.to_bytes(4, "big") for n in range(2000))
    assert b"".join(data for _, data in carried(Impairment(split=0.5))) == whole
    assert b"".join(data for _, data in carried(Impairment(join=0.5))) == whole


def distance(cm):
    return write(mavlink.MAVLink_distance_sensor_message(5, 1, 60000, cm, 3, 0, 24, 255), 1, 192, 9)


def test_tampered_frame_differs_in_one_value():
    before = distance(1234)
    after = rewritten(distance(1234), current_distance=77)
    assert message_id(after) == 132
    assert {**read(before).to_dict(), "current_distance": 77} == read(after).to_dict()
    assert after[4:7] == before[4:7]


def test_tampering_affects_only_its_direction_and_message_type():
    link = FaultLink()
    link.tampers += [dropping(132), on(132, outliers(1.0, (5.0, 5.0), 1), direction=UP)]
    link.push(DOWN, distance(1000), 0.0)
    link.push(UP, distance(1000), 0.0)
    assert link.take(DOWN, 0.0) == []
    (up,) = link.take(UP, 0.0)
    assert read(up).current_distance in (500, 1500)


def test_proxy_delays_datagrams_in_both_directions(port):
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as application,
    ):
        for end in (vehicle, application):
            end.bind(("127.0.0.1", 0))
            end.settimeout(PATIENCE)
        ends = (
            "--listen",
            f"udpin:127.0.0.1:{port}",
            "--forward",
            f"udpout:127.0.0.1:{vehicle.getsockname()[1]}",
        )
        with running(python("-m", "tests.tools.fault_link", *ends, "--delay", "0.05")) as process:
            assert "delay=0.05" in process.stdout.readline()
            sent = time.monotonic()
            application.sendto(b"up", ("127.0.0.1", port))
            data, proxy = vehicle.recvfrom(100)
            assert data == b"up" and time.monotonic() - sent >= 0.05
            vehicle.sendto(b"down", proxy)
            assert application.recv(100) == b"down"
            process.terminate()
            assert process.wait(PATIENCE) == 0
            assert process.stdout.read() == "faults: lost {'up': 0, 'down': 0}\n"
