"""Short runs of parts of each benchmark program, because the programs themselves are seldom run."""

import socket
import threading
from dataclasses import replace

import pytest

from circnav_mav.extras.bench.situations import SITUATIONS
from tests.rig import Voice, heartbeat
from tests.tools.bench import (
    bench_estimators,
    bench_load,
    bench_locate,
    bench_loop,
    bench_process,
    citable,
)
from tests.tools.bench.on_port import VehicleOnPort
from tests.tools.fault_link.frames import message_id


@pytest.fixture
def vehicle():
    return VehicleOnPort(bench_load.MISSION)


@pytest.fixture
def application(vehicle):
    """Socket of an application that has sent to the vehicle."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.connect(("127.0.0.1", int(vehicle.endpoint.rsplit(":", 1)[1])))
        link.send(Voice(1, 191).pack(heartbeat(kind=18, autopilot=8)))
        yield link


def test_bench_vehicle_sends_to_address_of_latest_sender(vehicle, application):
    while not vehicle.received:
        vehicle.turn()
    while not any(True for _ in vehicle.speak()):
        vehicle.receive()
    assert application.recv(65535)[0] == 0xFD


def test_bench_process_waits_for_matching_setpoint(vehicle, application):
    steers = bench_loop.dialect.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 8, 0x407, 0, 0, 0, 5.0, 0, 0, 0, 0, 0, 0, 0
    )
    assert bench_process.wait_for(vehicle, lambda setpoint: True, vehicle.now + 0.05) == float(
        "inf"
    )
    application.send(Voice(1, 191).pack(steers))
    assert (
        bench_process.wait_for(vehicle, lambda setpoint: setpoint.vx == 5.0, vehicle.now + 5.0)
        <= vehicle.now
    )


def test_bench_loop_measures_latency_of_each_range(monkeypatch):
    """The bare loop runs in a thread and receives 0.25 s of a flight."""
    monkeypatch.setattr(bench_loop, "SETTLING", 0.0)
    received = bench_loop.recorded("smooth", 0.5)
    assert {bench_loop.RANGE, 0} <= {message_id(frame) for _, frame in received}
    first = next(time for time, frame in received if message_id(frame) == bench_loop.RANGE)
    flight = [(time - first, frame) for time, frame in received if first <= time < first + 0.25]
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener = bench_loop.Listener(bench_loop.BARE, flight, link)
    threading.Thread(target=bench_loop.bare_loop, args=(listener.port,), daemon=True).start()
    bench_loop.play([listener])
    listener.close()
    assert len(listener.latencies) + listener.missed >= 2


def test_bench_load_reports_latency_and_radius_error():
    record = bench_load.Record()
    record.setpoints = [0.0, 0.1, 0.2]
    record.latencies = [0.001]
    record.errors = [(1.0, 1.0), (91.0, 3.0)]
    text = record.report()
    assert "clock: p50 1.0 ms" in text and "gaps: p50 100.0 ms" in text
    assert "RMS 3.00 m (10.0 %), worst 3.00 m" in text


def test_bench_estimators_measures_step_times():
    assert (bench_estimators.timed(bench_estimators.in_flight(), 30) > 0).all()


def test_bench_locate_row_counts_located_logs():
    place = bench_locate.Result(
        error=2.0, gps=1.5, sigma=1.0, nees=1.0, bound=(0.1, 5.0), up=None, speed=0.2
    )
    row = bench_locate.row(bench_locate.SITUATIONS[0], [place, None])
    assert row.startswith(
        "| one lap, 0.5 m | 1 of 2 | 2.00 | 2.00 | 0.50 | 0.10, up 5.00 | 1.00 | 100 % (100 % below"
        " its top) | 0 | 1, 0.20"
    )
    assert bench_process.processor_time("-c", "pass") > 0


def test_citable_folder_has_table_versions_and_references(tmp_path, monkeypatch):
    names = [one.name for one in bench_locate.SITUATIONS]
    result = bench_locate.Result(1.6, 1.0, 1.4, 1.0, (1.0, 2.0), None, None)
    monkeypatch.setattr(citable, "places", lambda flights: {name: [result] for name in names})
    cells = [(replace(SITUATIONS["calm"], duration=125.0), "smooth")]
    citable.write(tmp_path, flights=1, place_flights=1, seed=7, cells=cells)
    page = (tmp_path / "README.md").read_text()
    assert "Seed 7, 1 flights a cell" in page
    assert "| calm | " in page
    assert "| 1.6 / 1.6 |" in page
    assert "| numpy | " in page
    assert {path.suffix for path in tmp_path.iterdir()} == {".csv", ".md", ".pdf", ".png", ".bib"}
    assert "2606.00075" in (tmp_path / "CITATION.bib").read_text()


def test_public_filters_find_target_of_recording():
    pytest.importorskip("bayesian_filters")
    from tests.tools.bench import bench_peers

    steps = bench_peers.record("calm", 1)
    found = {
        name: bench_peers.run(bench_peers.PEERS[name]("calm"), steps)
        for name in ("circnav auto", "EKF")
    }
    assert all(one.position < 10.0 and one.r_dot < 0.5 for one in found.values())
    assert bench_peers.row("calm", "both", list(found.values())).count("|") == 11


def test_locating_methods_agree_on_synthetic_log():
    pytest.importorskip("multilat_solver")
    from tests.tools.bench import bench_plaza

    log = bench_plaza.synthetic("white noise", 1)
    for name in ("multilat-solver", "plain least squares", "circnav locate"):
        found = bench_plaza.METHODS[name](log)
        assert found is not None
        assert found[0] == pytest.approx(log.true, abs=1.0)
    walk = bench_plaza.synthetic("straight walk", 1)
    assert bench_plaza.ours(walk) is None
    line = bench_plaza.row("circnav locate", bench_plaza.ours, [log, walk], each=False)
    assert "1 of 1 (21 to 100 %) | 1 of 2" in line
