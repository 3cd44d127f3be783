"""The emulated radio: ranges, quantization, stamps, and the link on which they are received."""

import math
import statistics
from itertools import pairwise

import pytest

from tests.sim.station import Station, build

STILL = {"north_m": -300.0, "altitude_m": 40.0}
SLANT = math.hypot(300.0, 40.0)
RADIO = (1, 192)
AUTOPILOT = (1, 1)
BEACON = {"message": "ranging_beacon", "via": "direct"}


def ranging(start=STILL, **keys):
    """Return a companion of an autopilot with an exact radio. keys: changes of the table
    [ranging]."""
    companion = Station(
        build(seed=3, start=start, truth={"rate_hz": 0}, ranging={"noise_m": 0.0, **keys})
    )
    companion.heartbeat()
    return companion


def beacons(seconds, **keys):
    """Return the messages of a radio with a separate port during a time, s."""
    vehicle = ranging(**BEACON, **keys).vehicle
    vehicle.advance(seconds)
    return Station(vehicle, link="ranging").listen()


def test_distance_sensor_is_slant_range_in_centimeters():
    companion = ranging(sensor_id=7)
    companion.wait(0.95)
    received = companion.listen("DISTANCE_SENSOR", source=RADIO)
    assert [m.current_distance for m in received] == [round(SLANT * 100)] * 10
    assert [m.time_boot_ms for m in received] == [*range(0, 1000, 100)]
    assert {(m.id, m.orientation, m.covariance) for m in received} == {(7, 24, 255)}


@pytest.mark.parametrize(
    ("radio", "after", "expected"),
    [
        ({"start": {"north_m": -900.0}}, 0.1, [(65535, 0), (65535, 100)]),
        ({"latency_s": 0.25}, 0.249, []),
        ({"latency_s": 0.25}, 0.25, [(round(SLANT * 100), 0)]),
        ({"max_range_m": 200.0}, 2.0, []),
    ],
    ids=[
        "range too large for field",
        "measurement not sent yet",
        "late, stamped at measurement",
        "beyond range of radio",
    ],
)
def test_distance_sensor_report_matches_range_and_latency_of_radio(radio, after, expected):
    companion = ranging(**radio)
    companion.wait(after)
    assert [
        (m.current_distance, m.time_boot_ms) for m in companion.listen("DISTANCE_SENSOR")
    ] == expected


def test_beacon_and_named_value_follow_their_definitions():
    companion = ranging(**BEACON, beacon_id=9)
    companion.wait(0.35)
    received = Station(companion.vehicle, link="ranging").listen()
    assert [m.range for m in received] == [round(SLANT * 1000)] * 4
    assert [(m.sequence, m.time_usec) for m in received] == [
        (1, 0),
        (2, 100_000),
        (3, 200_000),
        (4, 300_000),
    ]
    first = received[0]
    assert (first.beacon_id, first.target_system, first.target_component) == (9, 0, 0)
    assert (first.lat, first.lon, first.range_accuracy) == (2**31 - 1, 2**31 - 1, 2**32 - 1)
    assert math.isnan(first.alt)
    # RANGING_BEACON is not sent on the autopilot's link
    assert companion.listen("RANGING_BEACON") == []
    companion = ranging(message="named_value_float", name="RNG")
    companion.wait(0.1)
    value = companion.listen("NAMED_VALUE_FLOAT")[0]
    assert value.name == "RNG" and value.value == pytest.approx(SLANT, rel=1e-7)


def test_reported_range_accuracy_is_limited_to_its_field():
    for noise, covariance in ((0.1, 100), (0.5, 255)):
        companion = ranging(noise_m=noise, report_accuracy=True)
        companion.wait(0.1)
        assert companion.listen("DISTANCE_SENSOR")[0].covariance == covariance
    assert beacons(0.1, noise_m=0.5, report_accuracy=True)[0].range_accuracy == 500


def errors(**keys):
    return [m.range / 1000 - SLANT for m in beacons(50.0, rate_hz=100.0, **keys)]


def test_range_errors_and_dropouts_match_configuration():
    noise = errors(noise_m=2.0, bias_m=1.5)
    assert statistics.fmean(noise) == pytest.approx(1.5, abs=4 * 2.0 / math.sqrt(5000))
    assert statistics.stdev(noise) == pytest.approx(2.0, rel=0.05)
    spread = errors(outlier_fraction=0.2, outlier_m=40.0, dropout_fraction=0.3)
    assert len(spread) == pytest.approx(3500, abs=4 * math.sqrt(5000 * 0.3 * 0.7))
    wild = [e for e in spread if abs(e) > 0.01]
    assert len(wild) / len(spread) == pytest.approx(0.2, abs=0.03) and max(map(abs, wild)) <= 40.0


@pytest.mark.parametrize(
    ("preset", "slow", "loss"), [("gaussian", 0.0, 0.0), ("uwb", 0.15, 0.0), ("lora", 2.0, 0.1)]
)
def test_radio_presets_have_documented_errors(preset, slow, loss):
    vehicle = build(
        seed=2,
        truth={"rate_hz": 0},
        start={"north_m": -200.0},
        vehicle={"profile": "ardurover", "default_streams": False},
        ranging={"preset": preset, **BEACON},
    )
    vehicle.advance(1000.0)
    received = [m.range / 1000 - 200.0 for m in Station(vehicle, link="ranging").listen()]
    assert len(received) == pytest.approx(10_000 * (1 - loss), rel=0.02)
    # means over one second of ranges
    means = [statistics.fmean(received[i : i + 10]) for i in range(0, len(received) - 10, 10)]
    assert statistics.pstdev(means) == pytest.approx(slow, abs=0.25 * slow + 0.2)


def test_autopilot_forwards_ranges_after_heartbeat_of_companion():
    companion = Station(build(start=STILL, truth={"rate_hz": 0}))
    companion.wait(1.0)
    assert companion.listen("DISTANCE_SENSOR") == []
    # the radio's heartbeats are forwarded on every link
    assert companion.listen("HEARTBEAT", source=RADIO) != []
    companion.heartbeat()
    companion.wait(0.95)
    assert len(companion.listen("DISTANCE_SENSOR", source=RADIO)) == 9


def test_rangefinder_driver_repeats_values_with_send_stamps():
    companion = ranging({"mode": "GUIDED", "speed_mps": 10.0}, via="autopilot", rate_hz=5.0)
    companion.wait(0.5)
    assert companion.listen("DISTANCE_SENSOR") == []  # the stream is not sent before a request
    assert companion.stream(132, 40_000) == [0]
    companion.wait(1.0)
    received = companion.listen("DISTANCE_SENSOR", source=AUTOPILOT)
    assert [m.time_boot_ms for m in received] == [*range(540, 1501, 40)]
    # 5 new values per second, sent at 25 Hz
    assert 5 <= len({m.current_distance for m in received}) <= 6
    assert {(m.id, m.covariance, m.type) for m in received} == {(0, 0, 0)}


def test_rangefinder_driver_stops_after_450_ms():
    away = {"mode": "GUIDED", "speed_mps": 20.0, "heading_deg": 180.0, "north_m": -100.0}
    companion = ranging(away, via="autopilot", max_range_m=130.0)
    companion.stream(132, 50_000)
    companion.wait(2.9)
    last = companion.listen("DISTANCE_SENSOR")[-1]
    # after 1.0 s, at the last sample, the slant range is 130 m
    assert last.time_boot_ms == 1450


def test_range_rate_is_derivative_of_slant_range():
    target = {"velocity_east_mps": 4.0, "turn_rate_deg_s": 5.0}
    radio = {
        "message": "named_value_float",
        "noise_m": 0.0,
        "rate_name": "RR",
        "rate_noise_mps": 0.0,
    }
    tables = {"target": target, "ranging": {**radio, "rate_bias_mps": 0.0}, "truth": {"rate_hz": 0}}
    companion = Station(build(start={**STILL, "speed_mps": 0.0}, **tables))
    companion.heartbeat()
    companion.wait(9.95)
    received = companion.listen("NAMED_VALUE_FLOAT", source=RADIO)
    ranges, rates = ([m for m in received if m.name == name] for name in ("RANGE", "RR"))
    assert [m.time_boot_ms for m in rates] == [m.time_boot_ms for m in ranges]
    for before, rate, after in zip(ranges[:-2], rates[1:-1], ranges[2:], strict=True):
        assert rate.value == pytest.approx((after.value - before.value) / 0.2, abs=2e-3)
    assert min(m.value for m in rates) < -0.5


def test_reported_range_rate_has_white_and_slow_noise():
    def rates(**keys):
        companion = ranging(message="named_value_float", rate_name="RR", **keys)
        companion.wait(40.0)
        return [
            m.value for m in companion.listen("NAMED_VALUE_FLOAT", source=RADIO) if m.name == "RR"
        ]

    white = rates(rate_noise_mps=0.3, rate_bias_mps=0.0)
    assert statistics.pstdev(white) == pytest.approx(0.3, rel=0.15)
    assert rates(rate_noise_mps=0.3, rate_bias_mps=0.0, rate_sign="closing") == pytest.approx(
        [-v for v in white]
    )
    slow = rates(rate_noise_mps=0.0, rate_bias_mps=0.3)
    assert statistics.pstdev([b - a for a, b in pairwise(slow)]) < 0.03
    assert abs(slow[0]) > 0.0
