"""Figures computed from synthetic tracks and frames. If a firmware binary is available: a flight on
real firmware."""

import json
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, replace
from functools import partial
from math import cos, hypot, nan, pi, radians, sin, tan
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.tools import cells
from tests.tools.firmware import fleet, table
from tests.tools.firmware.bench import Reported, Truth
from tests.tools.firmware.flight import VEHICLES, Flight
from tests.tools.firmware.fly import fly, homing, missing, own_position
from tests.tools.firmware.radio import reported
from tests.tools.firmware.score import score
from tests.tools.firmware.wire import Setpoint, frames, mode_shown, setpoint

TARGET = (1000.0, -500.0)
"""Position of the target, m north and east."""


PLANE = Flight("plane", 150.0, 22.0, 80.0, 240.0)


def approach_and_circle(
    flight: Flight, radius: float, *, clockwise: bool, seconds: float
) -> list[Truth]:
    """Return a track that leads straight from 375 m north of the target to the circle, then along
    the circle."""
    track = []
    sense = 1 if clockwise else -1
    for tick in range(round(seconds * 25)):
        time = tick / 25
        away = max(radius, 375.0 - flight.speed * time)
        angle = sense * max(0.0, flight.speed * time - (375.0 - radius)) / radius
        north, east = TARGET[0] + away * cos(angle), TARGET[1] + away * sin(angle)
        course = angle + sense * pi / 2
        speeds = flight.speed * cos(course), flight.speed * sin(course)
        track.append(
            Truth(time, north, east, 660.0, *speeds, 0.0, sense * radians(20), course, 22.0)
        )
    return track


@pytest.mark.parametrize("clockwise", [True, False])
def test_scored_figures_match_synthetic_circle_with_2_m_error(
    clockwise: bool,
) -> None:
    track = approach_and_circle(PLANE, 152.0, clockwise=clockwise, seconds=200.0)
    turns = [Setpoint(tick / 20, "SET_ATTITUDE_TARGET", radians(6.0 + 2 * (-1) ** tick), None, True)
             for tick in range(4000)]  # fmt: skip
    scored = score(
        PLANE,
        track,
        turns,
        lambda _: TARGET,
        engaged=0.0,
        ended=200.0,
        turn_limit=radians(8.0),
        home=584.0,
    )
    assert (scored["kept"], scored["direction"]) == (
        True,
        "clockwise" if clockwise else "counterclockwise",
    )
    assert (scored["rms"], scored["mean"], scored["sd"]) == pytest.approx((2.0, 2.0, 0.0), abs=0.01)
    assert scored["settled"] == pytest.approx((375.0 - 157.5) / 22.0, abs=0.1)
    assert (scored["closest"], scored["led_away"]) == pytest.approx((152.0, 0.0), abs=0.1)
    assert (scored["turn_sd"], scored["turn_at_limit"]) == pytest.approx((2.0, 0.5), abs=0.01)
    assert scored["total_variation"] == pytest.approx(4.0 * 20, rel=0.01)
    elsewhere = (TARGET[0] + 40.0, TARGET[1])
    scored = score(
        PLANE, track, [], lambda _: elsewhere, engaged=0.0, ended=200.0, turn_limit=1.0, home=584.0
    )
    assert (scored["kept"], scored["settled"], scored["turn_sd"]) == (False, None, None), (
        "a circle around another position is not kept"
    )


@pytest.mark.parametrize("wind", [0.0, 5.0])
def test_fleet_gap_is_time_to_bearing_of_vehicle_ahead(wind: float) -> None:
    grid = np.arange(0.0, 120.0, 0.2)
    rate = 22.0 / 150.0

    def member(number: int, lag: float, height: float) -> fleet.Member:
        phase = rate * (grid - lag)
        # the vehicle is slower on the side where it flies against the wind
        angle = phase + wind / 22.0 * np.sin(phase)
        ring = np.ones(len(grid), bool)
        return fleet.Member(
            number, 150 * np.cos(angle), 150 * np.sin(angle), grid * 0 + height, angle, ring
        )

    lap = 2 * pi / rate
    members = [member(i, i * lap / 3, 100.0 + 20 * i) for i in range(3)]
    found = fleet.judge(grid, members, 150.0)
    assert found["rings"][0]["worst_gap_deg"] < 0.2
    assert (found["rings"][0]["even_after_s"], found["too_near"], found["smallest_above_m"]) == (
        0.0,
        0,
        20.0,
    )
    late = [*members[:2], member(2, 2 * lap / 3 + lap / 36, 140.0)]
    assert np.nanmedian(fleet.gap_errors(grid, late)) == pytest.approx(10.0, abs=0.2)


def test_heading_error_is_simulated_by_rotating_magnetic_field() -> None:
    values = [float(one.split("=")[1]) for one in fleet.field(5.0)]
    north, east = np.add(fleet.HOME_FIELD, values[:2])
    turned = np.degrees(np.arctan2(east, north) - np.arctan2(*fleet.HOME_FIELD[::-1]))
    assert turned == pytest.approx(-5.0, abs=0.01)
    assert np.hypot(north, east) == pytest.approx(np.hypot(*fleet.HOME_FIELD), abs=0.02)


def test_own_position_error_is_separate_for_circle_and_return(
    tmp_path: Path,
) -> None:
    """The reports have an error of 5 m on the circle, 50 m and 3 deg on the way home, and one
    velocity step of 0.4 m/s. The report times are between samples of the truth, so the truth must
    be interpolated. With the nearest sample, a turn of 3.2 m/s^2 would look like a velocity
    step."""
    flight = replace(PLANE, gps_off=20.0, home_s=60.0)
    track = approach_and_circle(PLANE, 150.0, clockwise=True, seconds=130.0)
    times = np.arange(20.0, 129.0, 0.21)
    true = np.array([astuple(one) for one in track])
    ways = (true[:, 1], true[:, 2], true[:, 4], true[:, 5], np.unwrap(true[:, 8]))
    north, east, v_north, v_east, yaw = (np.interp(times, true[:, 0], way) for way in ways)
    home = times >= 80.0
    north, east = north + np.where(home, 30.0, 3.0), east + np.where(home, 40.0, 4.0)
    v_east = v_east + np.where(times > 50, 0.4, 0.0)
    yaw = yaw + np.where(home, radians(3.0), 0.0)
    rows = zip(times, north, east, v_north, v_east, yaw % (2 * pi), strict=True)
    reported = [Reported(*map(float, one)) for one in rows]
    bench = SimpleNamespace(track=track, reported=reported, folder=tmp_path, now=130.0)
    found = own_position(flight, bench, 0.0, 80.0)
    assert found is not None
    circle = found["circle"]
    way = found["way_home"]
    assert (circle["median"], circle["largest"], circle["heading"]) == pytest.approx(
        (5.0, 5.0, 0.0), abs=0.05
    )
    assert circle["velocity_step"] == pytest.approx(0.4, abs=0.05) and way["velocity_step"] < 0.05
    assert (way["median"], way["p95"], way["heading"]) == pytest.approx((50.0, 50.0, 3.0), abs=0.05)
    assert found["circles_off_home"] == pytest.approx(hypot(*TARGET), abs=0.5)


def test_sx1280_reported_range_is_interpolated_and_extrapolated() -> None:
    assert [reported(true) for true in (0.0, 50.0, 75.0, 250.0)] == pytest.approx(
        [4.4, 57.6, 80.3, 253.0]
    )
    assert reported(2000.0) == pytest.approx(253.0 + 1750.0 * 52.0 / 50.0)


def test_homing_time_is_compared_with_straight_path() -> None:
    flight = replace(PLANE, vehicle="home")
    track = approach_and_circle(flight, 140.0, clockwise=True, seconds=60.0)
    found = homing(flight, track, lambda _: TARGET, 0.0, 60.0)
    assert found is not None
    assert (found["home"], found["straight"]) == pytest.approx(
        (225.0 / 22.0, 225.0 / 22.0), abs=0.1
    )
    assert found["farthest"] <= 150.0


def test_turn_of_setpoint_is_positive_clockwise() -> None:
    half = radians(30.0) / 2
    roll = mavlink.MAVLink_set_attitude_target_message(
        0, 1, 1, 0xC6, [cos(half), sin(half), 0, 0], 0, 0, nan, 0
    )
    yaw = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 8, 0x5C7, *[0.0] * 9, 0.0, -0.2
    )
    stick = mavlink.MAVLink_manual_control_message(1, 0, 500, 500, 0, 0)
    commands = [setpoint(one, 3.0, 20.0) for one in (roll, yaw, stick)]
    turns = [one.turn for one in commands if one is not None]
    assert turns == pytest.approx(
        [9.80665 * tan(radians(30)) / 20, -0.2, 9.80665 * tan(radians(25)) / 20]
    )
    assert [one.finite for one in commands if one is not None] == [False, True, True]
    assert setpoint(mavlink.MAVLink_heartbeat_message(0, 0, 0, 0, 0, 3), 3.0, 20.0) is None


def test_datagram_is_split_into_frames_with_their_mode() -> None:
    vehicle = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    beat = mavlink.MAVLink_heartbeat_message(2, 3, 81, 0x04030000, 4, 3)
    position = mavlink.MAVLink_global_position_int_message(1, 2, 3, 4, 5, 6, 7, 8, 9)
    for old in (False, True):
        datagram = b"".join(one.pack(vehicle, force_mavlink1=old) for one in (beat, position, beat))
        cut = list(frames(datagram))
        assert [number for number, _ in cut] == [0, 33, 0]
        assert b"".join(frame for _, frame in cut) == datagram
        assert [mode_shown(*one) for one in cut] == [0x04030000, None, 0x04030000]


def test_table_command_flies_only_missing_flights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown = []

    def fly_one(command: list[str], **_: object) -> None:
        flown.append(command)
        seed = int(command[command.index("--seed") + 1])
        settled = {"settled_s": None} if seed == 3 else {"settled_s": 10.0}
        result = {
            "title": "plane",
            "flight": {"vehicle": "plane", "radius": 150.0, "direction": "clockwise"},
            "rms": seed / 10,
            "mean": 0.0,
            "sd": 0.0,
            "kept": seed != 2,
            "direction": "clockwise",
            "turn_sd": 3.0,
            "settled": 9.0,
            "turn_at_limit": 0.01,
            "total_variation": 1.0,
            "roll": [0, 1],
            "closest": 120.0 + seed,
            "led_away": 0.0,
            "own": {"outcome": "completed", "version": "0.1.0", "firmware": "4.6.3", **settled},
            "takeover": None,
            "real_speedup": 1.0,
            "longest_pause": 0.1,
        }
        folder = tmp_path / command[-1]
        folder.mkdir()
        (folder / "result.json").write_text(json.dumps(result))

    monkeypatch.setattr(subprocess, "run", fly_one)
    monkeypatch.setattr(table, "commit", lambda: "abc1234")
    monkeypatch.setattr(table, "APART", 0.0)
    row = table.ROWS[1].name
    keep = tmp_path / "results.jsonl"
    program = partial(table.fly, out=tmp_path, extra=["--altitude", "60"])
    for last, flights in ((1, 1), (3, 3), (3, 3)):
        words = ["--rows", row, "--seeds", "1", str(last), "--keep", str(keep)]
        options = cells.parser(None, table.BY_NAME, (1, 1)).parse_args(words)
        cells.flown(program, options, ThreadPoolExecutor)
        assert len(flown) == flights
    assert all(command[3:8] == ["plane", "--wind", "5", "--turbulence", "1"] for command in flown)
    text = " ".join(table.table(cells.read(keep).values()).split())
    assert "| 0.20 (0.5) | 3.0 (4) | 10 | 0.10 to 0.30 |" in text
    assert "3 flights. 2 kept the circle" in text and "agreed with the true track in 2." in text
    assert f"not kept: {row} (seed " in text
    assert "with circnav 0.1.0 (commit abc1234), ArduPilot 4.6.3." in text
    alone = table.table([one for one in cells.read(keep).values() if one["seed"] == 1])
    assert "of the seeds" not in alone and "| 0.10 (0.5) | 3.0 (4) | 10 |\n" in alone
    assert "Closest approach: 0.81 R." in text


def test_table_of_page_matches_stored_flights() -> None:
    flown = cells.read(table.FLIGHTS).values()
    assert " ".join(table.table(flown).split()) in " ".join(table.PAGE.read_text().split())
    assert table.kept(flown) == table.FLIGHTS.read_text()


@pytest.mark.parametrize("vehicle", ["rover", "px4_copter"])
def test_installed_circnav_circles_on_real_firmware_until_takeover(
    tmp_path: Path, vehicle: str
) -> None:
    what = VEHICLES[vehicle]
    lap = 2 * pi * what.radius / what.speed
    flight = Flight(
        vehicle,
        what.radius,
        what.speed,
        what.altitude,
        3.3 * lap,
        "counterclockwise",
        takeover=3 * lap,
    )
    if reason := missing(flight):
        pytest.skip(reason)
    result = fly(flight, tmp_path)
    assert "failed" not in result, result
    assert (result["kept"], result["direction"]) == (True, "counterclockwise"), result
    assert result["takeover"]["after_shown"] == 0
    assert result["not_finite"] == 0
