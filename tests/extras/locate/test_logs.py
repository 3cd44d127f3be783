"""Log formats: cases reduced from public bug reports, and logs written from the specifications."""

import json
import os
import pty
import re
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise
from math import nan
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav import cli
from circnav_mav.cli.exits import Exit, Refused
from circnav_mav.extras.locate.estimator import (
    Knowledge,
    NotLocated,
    Ranges,
    Track,
    locate,
)
from circnav_mav.extras.locate.logs.interface import METERS, ReadOptions
from circnav_mav.extras.locate.logs.table import read_logs
from circnav_mav.extras.locate.parameters import ardupilot
from circnav_mav.extras.locate.place import Place, Plane
from circnav_mav.extras.locate.range_log import EmptyLogError, RangeLog
from circnav_mav.extras.locate.units import likely_unit
from circnav_mav.runlog.run_folder import RunError
from tests.command_line import ended
from tests.extras.locate import log_writers as write
from tests.extras.locate.worlds import PLANE, circles

CASES = Path(__file__).parent / "cases"
BEACON = (-35.363, 149.165)
NOON = datetime(2026, 7, 1, 12, tzinfo=UTC)


def placed(log: RangeLog, tag: str, gps_sigma: float = 1.5) -> Place:
    """Return the estimated place of a tag."""
    track = log.track(log.plane())
    (ranges, known) = log.of(tag, None)
    found = locate(
        log.plane(),
        track,
        ranges,
        Knowledge(float(track.up.min()), gps_sigma=gps_sigma, sigma_known=known),
    )
    assert isinstance(found, Place), found
    return found


def off(place: Place, truth: tuple[float, float]) -> float:
    return float(np.hypot(*(np.array(place.plane.to_metres(*truth)) - [place.east, place.north])))


def rows(track: Track) -> list[tuple[float, float, float, float]]:
    """Return a track on PLANE as rows of time, latitude, longitude and altitude."""
    return list(zip(track.time, *PLANE.to_degrees(track.east, track.north), track.up, strict=True))


def a_log(track: Track, ranges: Ranges) -> RangeLog:
    return RangeLog(
        rows(track), {"t": [(time, r, nan) for time, r in zip(ranges.time, ranges.r, strict=True)]}
    )


@pytest.mark.parametrize(
    ("case", "name", "vehicles"),
    [
        ("01-two-vehicles.tlog", "RANGE", ["sensor 0 of 1/192", "sensor 0 of 2/192"]),
        ("03-tracker-first.tlog", "RANGE", ["sensor 0 of 1/192"]),
        ("04-position-near-zero-first.tlog", "RANGE", ["sensor 0 of 1/192"]),
        ("09-range-under-another-name.tlog", "UWB_DIST", ["UWB_DIST of 1/192"]),
    ],
)
def test_tlog_ranges_are_paired_with_positions_of_their_vehicle(case, name, vehicles):
    logs = read_logs(CASES / case, ReadOptions(range_name=name))
    assert [tag for log in logs for tag in log.ranges] == vehicles
    for log in logs:
        assert off(placed(log, *log.ranges), BEACON) < 1.0


def test_vehicle_option_selects_positions_of_one_vehicle(tmp_path):
    (log,) = read_logs(CASES / "01-two-vehicles.tlog", ReadOptions(vehicle=2))
    assert list(log.ranges) == ["sensor 0 of 2/192"]
    records = [
        (
            t,
            s,
            1,
            mavlink.MAVLink_global_position_int_message(0, -353630000, 10 * s, 0, 0, 0, 0, 0, 0),
        )
        for t in range(3)
        for s in (1, 2)
    ]
    records += [
        (t, 7, 1, mavlink.MAVLink_named_value_int_message(t + 1, b"RANGE", 90 + t))
        for t in range(3)
    ]
    file = write.write_tlog(tmp_path / "log.tlog", records)
    with pytest.raises(EmptyLogError, match=r"ranges of 7/1 are left out: .* \(1, 2\).* --vehicle"):
        read_logs(file)
    (log,) = read_logs(file, ReadOptions(vehicle=2))
    assert [row[:2] for row in log.ranges["RANGE of 7/1"]] == [
        (0.0, 90.0),
        (1.0, 91.0),
        (2.0, 92.0),
    ]
    with pytest.raises(
        RunError, match=r"--vehicle 9: it has no positions; vehicles with positions: 1, 2"
    ):
        read_logs(file, ReadOptions(vehicle=9))


def test_locate_lists_candidate_names_of_ranges(tmp_path):
    with pytest.raises(EmptyLogError, match=r"UWB_DIST\. Give one: --range-name UWB_DIST"):
        read_logs(CASES / "09-range-under-another-name.tlog")
    at = [("POS", (t * 1_000_000, 473000000, 85000000 + t, 400.0, 0.0, 0.0)) for t in range(9)]
    script = [("UWB", (t * 1_000_000, 50.0 + t)) for t in range(9)]
    named = [("NVF", (t * 1_000_000, b"TAG7", 60.0 + t)) for t in range(9)]
    parameters = [("PARM", (1, f"PARAMETER_{number}".encode(), 50.0, 0.0)) for number in range(9)]
    file = write.write_dataflash(tmp_path / "log.bin", at + parameters + script + named)
    with pytest.raises(EmptyLogError, match=r"ranges: TAG7, UWB\.Dist\. Give one"):
        read_logs(file)
    for name, first in (("UWB.Dist", 50.0), ("TAG7", 60.0)):
        (log,) = read_logs(file, ReadOptions(range_name=name))
        assert [r for _, r, _ in log.ranges[name]] == list(np.arange(first, first + 9))
    px4 = [
        (
            "vehicle_global_position",
            0,
            (t * 1_000_000, 0, 47.3, 8.5 + t / 1e6, 400.0, 1.0, True, True),
        )
        for t in range(9)
    ]
    px4 += [("debug_key_value", 0, (t * 1_000_000, 70.0 + t, b"uwb")) for t in range(9)]
    file = write.write_ulog(tmp_path / "log.ulg", px4)
    with pytest.raises(EmptyLogError, match=r"uwb\. Give one: --range-name uwb"):
        read_logs(file)
    assert len(read_logs(file, ReadOptions(range_name="uwb"))[0].ranges["uwb"]) == 9


def test_dataflash_gps_without_week_is_read():
    (log,) = read_logs(CASES / "08-dataflash.BIN")
    assert len(log.positions) == 91 and log.positions[1][:3] == (0.1, -35.3629999, 149.165)
    assert [row[1] for row in log.ranges["rangefinder 0"][:2]] == pytest.approx([50.0, 50.01])


def test_dataflash_beacons_and_filter_positions_are_read(tmp_path):
    messages: list[tuple[str, tuple]] = [("ORGN", (0, 0, 473000000, 85000000, 40000))]
    for t in range(1, 9):
        us = t * 1_000_000
        messages += [
            ("GPS", (us, 0, 3 if t > 2 else 1, 0, 2400, 9, 100, 1, 1, 40000, 0, 0, 0, 0, 1)),
            ("XKF1", (us, 0, 100.0 + t, 50.0, -30.0)),
            ("XKF1", (us, 1, 999.0, 999.0, 0.0)),
            ("RFND", (us, 0, 1000 + t, 4, 25, -1)),
            ("RFND", (us, 1, 2000 + t, 2, 24, -1)),
            ("BCN", (us, 1, 2, 30.0 + t, 40.0 + t, 0.0, 0.0, 0.0, 0.0, 0.0)),
        ]
    (log,) = read_logs(write.write_dataflash(tmp_path / "log.bin", messages))
    assert {tag: len(ranges) for tag, ranges in log.ranges.items()} == {
        "beacon 0": 8,
        "beacon 1": 8,
    }
    assert [row[0] for row in log.positions] == [3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    assert Plane(47.3, 8.5).to_metres(*log.positions[0][1:3]) == pytest.approx(
        (50.0, 103.0), abs=1e-3
    )
    assert log.positions[0][3] == pytest.approx(430.0)


def test_tlog_dataflash_and_ulog_give_same_place(tmp_path):
    tlog: list[tuple[float, int, int, object]] = []
    dataflash: list[tuple[str, tuple]] = []
    ulog: list[tuple[str, int, tuple]] = []
    for time, latitude, longitude, r in lap():
        ms = round(time * 1e3)
        us = 1000 * ms
        cm = round(r * 100)
        place = round(latitude * 1e7), round(longitude * 1e7)
        # the tlog and the dataflash log round to 1e-7 deg
        latitude, longitude = place[0] / 1e7, place[1] / 1e7
        position = mavlink.MAVLink_global_position_int_message(ms, *place, 584_000, 0, 0, 0, 0, 0)
        fix = mavlink.MAVLink_gps_raw_int_message(us, 3, *place, 0, 1, 1, 0, 0, 9)
        distance = mavlink.MAVLink_distance_sensor_message(ms, 1, 60000, cm, 4, 0, 24, 0)
        tlog += [(time, 1, 1, message) for message in (position, fix, distance)]
        gps = (us, 0, 3, 0, 2400, 9, 100, *place, 0, 0, 0, 0, 0, 1)
        dataflash += [
            ("GPS", gps),
            ("POS", (us, *place, 584.0, 0.0, 0.0)),
            ("RFND", (us, 0, cm, 4, 24, -1)),
        ]
        ulog += [
            ("vehicle_global_position", 0, (us, us, latitude, longitude, 584.0, 1.0, True, True)),
            ("vehicle_gps_position", 0, (us, us, latitude, longitude, 0.0, 3)),
            ("distance_sensor", 0, (us, 0.0, 655.0, cm / 100, 0.0, 0.0, -1, 24)),
        ]
    places = []
    for file in (
        write.write_tlog(tmp_path / "log.tlog", tlog),
        write.write_dataflash(tmp_path / "log.bin", dataflash),
        write.write_ulog(tmp_path / "log.ulg", ulog),
    ):
        (log,) = read_logs(file)
        (tag,) = log.ranges
        assert len(log.ranges[tag]) == 600
        places.append(placed(log, tag))
        assert off(places[-1], BEACON) < 3.0
    for one, other in pairwise(places):
        assert off(one, (other.latitude, other.longitude)) < 0.01
        assert abs(one.up - other.up) < 0.01


PLAIN = """time,latitude,longitude,altitude,range,tag
0.0,47.3,8.5,400,100.25,007
0.5,47.3001,8.5001,401.5,,
1.0,,,,98.5,007
"""


def edited(*pairs: tuple[str, str]) -> str:
    text = PLAIN
    for old, new in pairs:
        text = text.replace(old, new)
    return text


@pytest.mark.parametrize(
    "text",
    [
        PLAIN,
        "\ufeff" + PLAIN.replace("\n", "\r\n"),
        edited((",", ", "), ("time", "Time"), ("range", "RANGE_m")),
        edited(("time", "time_ms"), ("0.0,", "0,"), ("0.5,", "500,"), ("1.0,", "1000,")),
        edited(("time", "time_us"), ("0.0,", "0,"), ("0.5,", "500000,"), ("1.0,", "1000000,")),
        edited(("range", "range_cm"), ("100.25", "10025"), ("98.5", "9850")),
        edited(("range", "range_ft"), ("100.25", "328.904199475"), ("98.5", "323.16272966")),
        edited(("altitude", "altitude_cm"), (",400,", ",40000,"), (",401.5,", ",40150,")),
        edited(("latitude", "latitude_deg"), (",8.5,", ",-351.5,"), (",8.5001,", ",-351.4999,")),
        edited(("tag", "tag,battery"), (",007", ",007,good"), (",,", ",nan,")),
    ],
)
def test_csv_column_suffixes_give_units(tmp_path, text):
    (tmp_path / "log.csv").write_text(text, newline="")
    (log,) = read_logs(tmp_path / "log.csv")
    want = [(0.0, 47.3, 8.5, 400.0), (0.5, 47.3001, 8.5001, 401.5)]
    assert [pytest.approx(row, abs=1e-9) for row in want] == log.positions
    assert list(log.ranges) == ["007"] and not log.notes
    assert [row[:2] for row in log.ranges["007"]] == [
        pytest.approx((0.0, 100.25)),
        pytest.approx((1.0, 98.5)),
    ]


def test_units_option_overrides_column_suffix(tmp_path):
    (tmp_path / "log.csv").write_text(
        "time,latitude,longitude,range_m\n0,47.3,8.5,10\n1,47.31,8.5,11\n"
    )
    (log,) = read_logs(tmp_path / "log.csv", ReadOptions(unit=0.3048))
    assert [row[1] for row in log.ranges["target"]] == pytest.approx([3.048, 3.3528])


@pytest.mark.parametrize(
    "given",
    [
        "2026-07-01T12:00:00Z",
        "2026-07-01T14:00:00+02:00",
        "2026-07-01 12:00:00",
        str(NOON.timestamp()),
    ],
)
def test_csv_times_may_be_seconds_or_iso_8601(tmp_path, given):
    (tmp_path / "log.csv").write_text(
        f"time,latitude,longitude,range\n{given},47.3,8.5,10\n{given},47.4,8.5,10\n"
    )
    (log,) = read_logs(tmp_path / "log.csv")
    assert (log.positions[0][0], log.notes) == (NOON.timestamp(), [])


@pytest.mark.parametrize(
    ("name", "head", "error"),
    [
        ("a.BIN", b"\xa3\x95\x80\x00", "dataflash log"),
        ("a.ulg", b"ULog\x01\x12\x35", "ULog file"),
        ("empty.csv", b"", "no column"),
        (
            "sentinel.csv",
            b"time,latitude,longitude,altitude,range\n0,47.3,8.5,-9999,10\n",
            "line 2: altitude: -9999 m is none",
        ),
        (
            "rssi.csv",
            b"time,latitude,longitude,range\n0,47.3,8.5,-78\n1,47.3,8.5,-79\n",
            "no ranges in it.*; 2 ranges of 0 m or less are left out",
        ),
        ("a.kml", b"<?xml version='1.0'?><kml xmlns='x'>", "no column"),
        (
            "a.zip",
            b"PK\x03\x04\0\0\0",
            "is none of a PX4 log .*, a MAVLink telemetry log .*; convert it to a CSV",
        ),
    ],
)
def test_unreadable_log_is_refused_in_one_line(tmp_path, name, head, error):
    (tmp_path / name).write_bytes(head)
    with pytest.raises(RunError, match=error) as refusal:
        read_logs(tmp_path / name)
    assert str(refusal.value).startswith(str(tmp_path / name)) and "\n" not in str(refusal.value)


def test_error_without_pyulog_names_package_to_install(tmp_path, monkeypatch):
    (tmp_path / "a.ulg").write_bytes(b"ULog\x01\x12\x35\x01")
    monkeypatch.setattr("circnav_mav.extras.locate.logs.ulog.find_spec", lambda name: None)
    with pytest.raises(RunError, match=r"pip install 'circnav-mav\[ulog\]'"):
        read_logs(tmp_path / "a.ulg")


def test_ranges_in_nautical_miles_are_identified(monkeypatch):
    alike = {unit: METERS[unit] for unit in ("m", "km", "mi", "nmi")}
    monkeypatch.setattr("circnav_mav.extras.locate.units.METERS", alike)
    track, ranges, target = circles(noise=0.3, target=(30.0, -20.0))
    # shift the circle away from the target, so that the range changes
    shifted = replace(track, east=track.east + 15.0)
    east, north = (
        np.interp(ranges.time, shifted.time, way) for way in (shifted.east, shifted.north)
    )
    r = np.sqrt((east - target[0]) ** 2 + (north - target[1]) ** 2 + 40.0**2)
    wrong = Ranges(ranges.time, r / METERS["nmi"], ranges.sigma)
    assert likely_unit(PLANE, shifted, wrong, Knowledge(up=400.0, sigma_known=False), None) == "nmi"


def test_units_option_gives_place_from_ranges_in_feet(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("circnav_mav.extras.locate.map_picture.plot_map", lambda *what: None)
    command = ["locate", str(CASES / "02-feet.csv"), "--out", str(tmp_path), "--units", "ft"]
    assert not cli.circnav.main(command, standalone_mode=False)
    text = capsys.readouterr().out
    assert "place      46.00000" in text and "--units" not in text


def test_noisy_radio_is_not_reported_as_wrong_unit():
    track, ranges, _ = circles(noise=4.0, bias=5.0, outliers=0.1)
    place = placed(a_log(track, ranges), "t")
    assert likely_unit(PLANE, track, ranges, Knowledge(up=400.0, sigma_known=False), place) is None


def test_locate_ignores_repeated_and_frozen_ranges(tmp_path):
    track, ranges, target = circles(noise=0.2, gps=0.3, laps=2)
    place = PLANE.to_degrees(*target)

    def read(track: Track, ranges: Ranges) -> RangeLog:
        lines = [f"{t:.2f},{lat:.8f},{lon:.8f},{up},," for t, lat, lon, up in rows(track)]
        lines += [f"{t:.2f},,,,{r:.3f}," for t, r in zip(ranges.time, ranges.r, strict=True)]
        (tmp_path / "log.csv").write_text(
            "\n".join(["time,latitude,longitude,altitude,range,tag", *lines])
        )
        return read_logs(tmp_path / "log.csv")[0]

    resent = read(track, replace(ranges, r=ranges.r[np.arange(len(ranges.r)) // 5 * 5]))
    assert resent.notes == ["target: each range is sent 5 times; the first one is used"]
    assert len(resent.ranges["target"]) == -(-len(ranges.r) // 5)

    stuck = ranges.r.copy()
    stuck[200:400] = stuck[200]
    frozen = read(track, replace(ranges, r=stuck))
    assert (
        "200 ranges in 1 stretches of equal values" in frozen.notes[0]
        and "20.0 to 39.9 s" in frozen.notes[0]
    )
    assert len(frozen.ranges["target"]) == len(ranges.r) - 199

    coarse = read(track, replace(ranges, r=ranges.r.round()))
    assert not coarse.notes and len(coarse.ranges["target"]) == len(ranges.r)

    east, north = track.east.copy(), track.north.copy()
    east[100:200], north[100:200] = east[100], north[100]
    lost = read(replace(track, east=east, north=north), ranges)
    assert "positions do not change from 20.0 to 39.8 s" in lost.notes[0]
    for log in (resent, frozen, coarse, lost):
        assert off(placed(log, "target"), place) < 1.5


def test_target_is_located_when_track_crosses_antimeridian(tmp_path):
    track, ranges, target = circles(gps=0.0)
    fiji = Plane(-16.8, 180.0)
    lines = [
        f"{t:.2f},{lat:.8f},{lon:.8f},{up},"
        for t, lat, lon, up in zip(
            track.time, *fiji.to_degrees(track.east, track.north), track.up, strict=True
        )
    ]
    lines += [f"{t:.2f},,,,{r:.3f}" for t, r in zip(ranges.time, ranges.r, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["time,latitude,longitude,altitude,range", *lines]))
    (log,) = read_logs(tmp_path / "log.csv")
    assert off(placed(log, "target", gps_sigma=0.05), fiji.to_degrees(*target)) < 0.3


def test_parameter_output_contains_place_and_rounding_error():
    known = Place(0.0, Plane(*BEACON), 0.0, 0.0, 584.2, np.eye(2), 0.5, True)
    other = replace(known, east=30.0, north=-40.0, up_known=False)
    lines = list(ardupilot({"beacon 3 of 1/1": known, "b": other}))
    assert lines[1:] == [
        "BCN_LATITUDE,-35.36300000",
        "BCN_LONGITUDE,149.16500000",
        "BCN_ALT,584.20",
        "BCN_ORIENT_YAW,0",
        "# b: -40.00 m north, 30.00 m east of the first beacon: set this in your beacon system",
    ]
    lost = np.hypot(
        *Plane(*BEACON).to_metres(float(np.float32(BEACON[0])), float(np.float32(BEACON[1])))
    )
    assert f"32-bit numbers change the coordinates by {lost:.1f} m" in lines[0]
    unknown = list(ardupilot({"b": other}))
    assert "# BCN_ALT: the height is not observable" in unknown[3]


@pytest.mark.parametrize(
    ("option", "error"),
    [
        (
            ("--units", "furlong"),
            "--units furlong: is not a unit: m, cm, .* or the length of the unit in meters",
        ),
        (("--units", "-1"), "--units -1: is not a unit"),
        (("--vehicle", "2"), r"--vehicle selects one of the vehicles of a tlog; this is a CSV"),
    ],
)
def test_option_without_effect_is_refused(option, error):
    with pytest.raises(Refused, match=error) as refusal:
        cli.circnav.main(["locate", str(CASES / "02-feet.csv"), *option], standalone_mode=False)
    assert refusal.value.exit == Exit.USAGE


def test_locate_runs_on_terminal_despite_notebook_backend_of_matplotlib(tmp_path):
    lines = [f"{t:.1f},{lat:.8f},{lon:.8f},{r:.2f}" for t, lat, lon, r in lap(120)]
    (tmp_path / "lap.csv").write_text("\n".join(["time,latitude,longitude,range", *lines]))
    terminal, other_end = pty.openpty()
    environment = {"MPLBACKEND": "module://matplotlib_inline.backend_inline"}
    ran = ended(tmp_path, "locate lap.csv", stderr=other_end, **environment)
    os.close(other_end)
    shown = os.read(terminal, 1 << 16)
    os.close(terminal)
    assert ran.returncode == 0
    assert b"locating target" in shown
    assert "locating" not in ran.stdout
    assert ran.stdout.startswith("target: 120 ranges")
    assert (tmp_path / "lap.locate.png").exists()


def lap(number: int = 600) -> list[tuple[float, float, float, float]]:
    """Return rows of time (s), latitude and longitude (1e-7 deg), and range (m) of a lap around
    BEACON."""
    angle = 2 * np.pi * np.arange(number) / number
    latitude, longitude = Plane(*BEACON).to_degrees(100 * np.sin(angle), 100 * np.cos(angle))
    noise = np.random.default_rng(2).normal(0, 0.3, number)
    return list(zip(0.1 * np.arange(number), latitude, longitude, 100 + noise, strict=True))


def test_tlog_uses_gps_receiver_positions_without_filter_positions(tmp_path):
    records = []
    for time, latitude, longitude, r in lap():
        gps = mavlink.MAVLink_gps_raw_int_message(
            0, 3, round(latitude * 1e7), round(longitude * 1e7), 584000, 100, 100, 0, 0, 10
        )
        sensor = mavlink.MAVLink_distance_sensor_message(
            round(time * 1000), 1, 60000, round(r * 100), 1, 0, 0, 0
        )
        records += [(time, 1, 1, gps), (time + 0.01, 1, 192, sensor)]
    (log,) = read_logs(write.write_tlog(tmp_path / "raw.tlog", records))
    assert off(placed(log, "sensor 0 of 1/192"), BEACON) < 3


def test_dataflash_uses_the_fix_of_the_primary_receiver(tmp_path):
    rows = []
    for time, latitude, longitude, r in lap():
        stamp = round(time * 1e6)
        lost = time > 50.0
        for number, status in ((0, 3), (1, 1 if lost else 3)):
            place = round(latitude * 1e7), round(longitude * 1e7)
            values = (stamp, number, status, 0, 0, 10, 100, *place, 58400, 0, 0, 0, 0, number)
            rows.append(("GPS", values))
        away = round((longitude + (0.01 if lost else 0.0)) * 1e7)
        rows.append(("POS", (stamp, round(latitude * 1e7), away, 584.0, 0.0, 0.0)))
        rows.append(("RFND", (stamp, 1, round(r * 100), 4, 0, 100)))
    (log,) = read_logs(write.write_dataflash(tmp_path / "two.bin", rows))
    assert max(time for time, *_ in log.positions) <= 50.0
    assert off(placed(log, "rangefinder 1"), BEACON) < 3


def test_dataflash_separates_beacons_by_id(tmp_path, monkeypatch):
    monkeypatch.setitem(write.LOGGED, "UWBR", ("QBf", "TimeUS,Id,Dist"))
    rows = []
    for time, latitude, longitude, r in lap(60):
        place = round(latitude * 1e7), round(longitude * 1e7)
        rows.append(("POS", (round(time * 1e6), *place, 584.0, 0.0, 0.0)))
        rows += [("UWBR", (round(time * 1e6), ident, r + 50 * ident)) for ident in (1, 2)]
    file = write.write_dataflash(tmp_path / "uwb.bin", rows)
    (log,) = read_logs(file, ReadOptions("UWBR.Dist"))
    assert set(log.ranges) == {"UWBR.Dist of 1", "UWBR.Dist of 2"}


def test_ulog_reads_any_field_by_name(tmp_path):
    rows = []
    for time, latitude, longitude, r in lap(60):
        stamp = round(time * 1e6) + 1
        place = (stamp, stamp, latitude, longitude, 584.0, 1.0, True, True)
        rows.append(("vehicle_global_position", 0, place))
        rows.append(("ranging_beacon", 0, (stamp, r, 0.1, 7.0, 3)))
    file = write.write_ulog(tmp_path / "field.ulg", rows)
    (log,) = read_logs(file, ReadOptions("ranging_beacon.range_accuracy"))
    assert len(log.ranges["ranging_beacon.range_accuracy"]) == 60


def test_tlog_reads_any_field_by_name(tmp_path):
    altitude = mavlink.MAVLink_altitude_message(0, 0, 0, 0, 0, 12.5, 0)
    position = mavlink.MAVLink_global_position_int_message(0, 1, 1, 584000, 0, 0, 0, 0, 0)
    records = [(n, 1, 1, one) for n in range(3) for one in (altitude, position)]
    file = write.write_tlog(tmp_path / "field.tlog", records)
    # every position is near 0 N 0 E, as before a GPS fix
    with pytest.raises(EmptyLogError, match="no positions"):
        read_logs(file, ReadOptions("ALTITUDE.altitude_terrain"))


def test_csv_may_have_semicolons_and_decimal_commas(tmp_path):
    lines = [f"{t:.1f};{lat:.8f};{lon:.8f};{r:.2f}".encode() for t, lat, lon, r in lap(200)]
    lines[100] = lines[100][:-4] + b"\xff" * 120
    file = tmp_path / "row.csv"
    for text in (b"\n".join(lines), b"\n".join(lines).replace(b".", b",")):
        file.write_bytes(b"time;latitude;longitude;range\n" + text)
        (log,) = read_logs(file)
        assert len(log.ranges["target"]) == 199
        assert any("1 damaged rows are left out" in note for note in log.notes)


def test_csv_skips_single_damaged_rows(tmp_path):
    lines = [f"{t:.1f},{lat:.8f},{lon:.8f},{r:.2f}" for t, lat, lon, r in lap(200)]
    lines[100] = lines[100].replace(",", ",#x", 1)
    file = tmp_path / "row.csv"
    file.write_text("time,latitude,longitude,range\n" + "\n".join(lines) + "\n")
    (log,) = read_logs(file)
    assert len(log.positions) == 199
    assert any("1 damaged rows are left out" in note for note in log.notes)


def two_boots() -> tuple[list[list[float]], list[list[float]]]:
    """Return the rows of two flights of one logger: time, latitude, longitude, range. The beacon of
    the second flight is 200 m north."""
    first = [list(row) for row in lap()]
    second = [[t, lat + 200 / 111_000, lon, r] for t, lat, lon, r in first]
    return first, second


def csv_of(rows: Iterable[Sequence[float]]) -> str:
    lines = (f"{t:.1f},{lat:.8f},{lon:.8f},{r:.2f}\n" for t, lat, lon, r in rows)
    return "time,latitude,longitude,range\n" + "".join(lines)


def dataflash_of(rows: Iterable[Sequence[float]]) -> list[tuple[str, tuple]]:
    messages: list[tuple[str, tuple]] = []
    for t, lat, lon, r in rows:
        us = round(t * 1e6)
        messages += [
            ("POS", (us, round(lat * 1e7), round(lon * 1e7), 584.0, 0.0, 0.0)),
            ("RFND", (us, 0, round(r * 100), 4, 24, -1)),
        ]
    return messages


@pytest.mark.parametrize("kind", ["csv", "bin", "tlog"])
def test_log_with_two_boots_gives_one_place_per_boot(tmp_path, kind, capsys, monkeypatch):
    first, second = two_boots()
    file = tmp_path / f"log.{kind}"
    if kind == "csv":
        file.write_text(csv_of(first + second))
    elif kind == "bin":
        write.write_dataflash(file, dataflash_of(first + second))
    else:  # a computer that sets its clock back by an hour
        parts = [tmp_path / "one", tmp_path / "two"]
        for part, rows, zero in zip(parts, (first, second), (1.75e9, 1.75e9 - 3600), strict=True):
            write.write_tlog(part, tlog_of(rows), zero)
        file.write_bytes(b"".join(part.read_bytes() for part in parts))
    logs = read_logs(file)
    assert [log.vehicle for log in logs] == ["boot 1", "boot 2"]
    north = (BEACON[0] + 200 / 111_000, BEACON[1])
    for log, beacon in zip(logs, (BEACON, north), strict=True):
        assert off(placed(log, *log.ranges), beacon) < 3.0
    monkeypatch.setattr("circnav_mav.extras.locate.map_picture.plot_map", lambda *what: None)
    assert not cli.circnav.main(["locate", str(file)], standalone_mode=False)
    printed = capsys.readouterr().out
    assert "boots is located by itself" in printed and "two tags" not in printed
    places = json.loads(Path(f"{tmp_path}/log.locate.geojson").read_text())["features"]
    names = [one["properties"]["name"] for one in places if one["geometry"]["type"] == "Point"]
    assert [name.rpartition(", ")[2] for name in names] == ["boot 1", "boot 2"]


def tlog_of(rows: Iterable[Sequence[float]]) -> list[tuple[float, int, int, object]]:
    records: list[tuple[float, int, int, object]] = []
    for t, lat, lon, r in rows:
        place = round(lat * 1e7), round(lon * 1e7)
        ms = round(t * 1e3)
        position = mavlink.MAVLink_global_position_int_message(ms, *place, 584_000, 0, 0, 0, 0, 0)
        distance = mavlink.MAVLink_distance_sensor_message(
            ms, 1, 60000, round(r * 100), 4, 0, 24, 0
        )
        records += [(t, 1, 1, position), (t, 1, 1, distance)]
    return records


def test_damaged_dataflash_log_is_read_behind_damage(tmp_path, capfd):
    whole = write.write_dataflash(tmp_path / "log.bin", dataflash_of(lap())).read_bytes()
    middle = len(whole) // 2
    noise = np.random.default_rng(1).bytes(3000)
    gap = "damaged: 3031 of 32067 bytes, in 1 place, are left out"
    for damaged, count, notes in (
        (whole, 600, []),
        (whole[:-7], 599, []),  # the log ended with the power
        (whole[:middle] + noise + whole[middle:], 600, [gap]),
        (
            whole[:middle] + bytes(9000) + whole[middle + 9000 :],
            412,
            ["damaged: 9024 of 29067 bytes, in 1 place, are left out"],
        ),
        (b"log " + whole, 600, ["damaged: 4 of 29071 bytes, in 1 place, are left out"]),
    ):
        (tmp_path / "log.bin").write_bytes(damaged)
        (log,) = read_logs(tmp_path / "log.bin")
        assert (len(log.ranges["rangefinder 0"]), log.notes) == (count, notes)
        assert off(placed(log, "rangefinder 0"), BEACON) < 3.0
    assert capfd.readouterr() == ("", "")


def test_ulog_with_nested_formats_is_refused_within_memory(tmp_path):
    nested = [b"vehicle_global_position:a[1000] x;", b"a:b[1000] x;", b"b:float[1000] x;"]
    parts = [(b"B", bytes(40)), *((b"F", one) for one in nested)]
    parts.append((b"A", b"\0\0\0vehicle_global_position"))
    body = b"".join(struct.pack("<Hc", len(one), kind) + one for kind, one in parts)
    (tmp_path / "a.ulg").write_bytes(b"ULog\x01\x12\x35\x01" + bytes(8) + body)
    with pytest.raises(RunError, match="its topics have too many fields"):
        read_logs(tmp_path / "a.ulg")


def test_error_names_ulog_topic_without_orientation(tmp_path, monkeypatch):
    layout, fields = write.TOPICS["distance_sensor"]
    other = layout, fields.replace("orientation", "direction")
    monkeypatch.setitem(write.TOPICS, "distance_sensor", other)
    rows = [("distance_sensor", 0, (1000 * t, 0.0, 655.0, 9.0, 0.0, 0.0, -1, 24)) for t in range(9)]
    with pytest.raises(EmptyLogError, match="distance_sensor has no field orientation"):
        read_logs(write.write_ulog(tmp_path / "a.ulg", rows))


LINES = [f"{t:.1f},{lat:.7f},{lon:.7f},{r:.2f}" for t, lat, lon, r in zip(
    0.1 * np.arange(40), 47.2 + 1e-5 * np.arange(40), 8.4 + 0 * np.arange(40), range(60, 100),
    strict=True)]  # fmt: skip
NAMES = "time,latitude,longitude,range"


def with_cells(change: Callable[[list[str]], list[str]], separator: str = ",") -> str:
    return "".join(separator.join(change(line.split(","))) + "\n" for line in LINES)


@pytest.mark.parametrize(
    "text",
    [
        "sep=;\n" + NAMES.replace(",", ";") + "\n" + with_cells(list, ";"),
        "sep=|\r\n" + NAMES.replace(",", "|") + "\n" + with_cells(list, "|"),
        NAMES.replace(",", "\t") + "\n" + with_cells(list, "\t").replace(".", ","),
        f"# {NAMES}\n" + with_cells(list),
        f"{NAMES}\n" + with_cells(lambda row: [f'"{cell.replace(".", ",")}"' for cell in row]),
        f"{NAMES},altitude,sigma,tag\n"
        + with_cells(lambda row: [*row, "NA", "NaN", "NULL\n" + row[0], "NA", "N/A", "-"]),
        "time_h,latitude_e7,longitude_e7,range\n"
        + with_cells(
            lambda row: (
                [f"{float(row[0]) / 3600:.9f}"]
                + [f"{1e7 * float(cell):.0f}" for cell in row[1:3]]
                + row[3:]
            )
        ),
    ],
    ids=["sep", "sep |", "tab", "numpy", "quotes", "missing", "units"],
)
def test_csv_of_other_programs_is_read(tmp_path, text):
    (tmp_path / "log.csv").write_text(text, newline="")
    (log,) = read_logs(tmp_path / "log.csv")
    assert (len(log.positions), log.notes) == (40, [])
    assert log.positions[-1][:3] == pytest.approx((3.9, 47.20039, 8.4))
    assert [row[1] for row in log.ranges["target"]] == [*range(60, 100)]


@pytest.mark.parametrize(
    ("names", "change", "error"),
    [
        (NAMES, lambda row: ",".join(row).replace(".", ",").split(","), "line 2 has 8 values for 4"
         " names: decimal commas"),
        (NAMES.replace("time", "time_ms"), list, "time_ms: .* in s. Name the column time_s"),
        (NAMES, lambda row: [f"{1e3 * float(row[0])}", *row[1:]], "time: .* the column time_ms"),
        (NAMES, lambda row: [f"{float(row[0]) / 60}", *row[1:]], "time: .* the column time_min"),
        (NAMES, lambda row: [row[0], "472007239", *row[2:]], "line 2: latitude: .* times 1e7"),
        (NAMES, lambda row: [row[0], "4712.0434", *row[2:]], "degrees and minutes"),
        (NAMES, lambda row: ["NA", *row[1:]], "line 2: time: is missing"),
    ],
    ids=["commas", "s as ms", "ms as s", "min as s", "1e7", "NMEA", "no time"],
)  # fmt: skip
def test_csv_error_names_likely_cause(tmp_path, names, change, error):
    (tmp_path / "log.csv").write_text(f"{names}\n{with_cells(change)}")
    with pytest.raises(RunError, match=error):
        read_logs(tmp_path / "log.csv")


def test_csv_rows_without_time_order_are_one_log(tmp_path):
    rows = list(lap())
    shuffled = [rows[at] for at in np.random.default_rng(1).permutation(len(rows))]
    damaged = [[9999.0, *rows[0][1:]] if at == 300 else row for at, row in enumerate(rows)]
    for order in (shuffled, damaged):
        (tmp_path / "log.csv").write_text(csv_of(order))
        (log,) = read_logs(tmp_path / "log.csv")
        assert off(placed(log, "target"), BEACON) < 3.0


def test_error_names_time_difference_of_positions_and_ranges():
    """Positions are in local time and ranges in UTC. Printed with six digits both start at
    1.78291e+09 s, so only the difference is informative."""
    track, ranges, _ = circles()
    late = replace(track, time=track.time + 1.7829e9 + 7200.0)
    found = locate(
        PLANE, late, replace(ranges, time=ranges.time + 1.7829e9), Knowledge(float(track.up.min()))
    )
    assert isinstance(found, NotLocated)
    assert re.search(r"ranges at 0 to .* s, positions at 7\d\d\d(\.\d+)? to ", found.why)
