"""`circnav locate` on logs of other programs, against an independent filter and synthetic
worlds."""

import csv
import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from math import hypot, nan

import click
import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav import cli
from circnav_mav.cli.exits import Exit, Refused
from circnav_mav.extras.locate import map_picture
from circnav_mav.extras.locate.estimator import Ranges, Track
from circnav_mav.extras.locate.logs.table import read_logs
from circnav_mav.extras.locate.place import Plane
from circnav_mav.extras.locate.range_log import RangeLog
from tests.extras.locate.worlds import PLANE, circles
from tests.small_mission import TEXT

PLOT_MAP = map_picture.plot_map
"""The real function, which other tests replace."""

Row = Sequence[object]
HEADER = ("time", "latitude", "longitude", "altitude", "range", "tag")
PRECISE = ("--gps-sigma", "0.05", "--altitude", "400")


def run(*arguments):
    return int(cli.circnav.main(["locate", *map(str, arguments)], standalone_mode=False) or 0)


def places(path):
    features = json.loads(path.read_text())["features"]
    return {
        one["properties"]["name"]: one["properties"]
        for one in features
        if one["geometry"]["type"] == "Point"
    }


def located(folder, track, *tags, names=("",), options=()):
    """Return the places that the command finds in a CSV of positions and ranges."""
    assert run(as_csv(folder, track, *tags, names=names), *options) == Exit.DONE
    return places(folder / "log.locate.geojson")


def as_csv(folder, track, *tags, names=("",)):
    """Write a CSV of positions and ranges."""
    latitude, longitude = PLANE.to_degrees(track.east, track.north)
    positions = zip(track.time, latitude, longitude, track.up, strict=True)
    rows: list[Row] = [(time, *place, "", "") for time, *place in positions]
    for name, tag in zip(names, tags, strict=True):
        rows += [(time, "", "", "", r, name) for time, r in zip(tag.time, tag.r, strict=True)]
    with (folder / "log.csv").open("w", newline="") as file:
        csv.writer(file).writerows([HEADER, *rows])
    return folder / "log.csv"


def as_tlog(file, track, ranges, say=lambda ms, r: distances(ms, r)):
    """Write a tlog of system 3. say: function of stamp (ms) and range (m) that returns (component,
    message) pairs, from the radio or from other components."""
    latitude, longitude = PLANE.to_degrees(track.east, track.north)
    records = []
    for time, lat, lon, up in zip(track.time, latitude, longitude, track.up, strict=True):
        ms = round(time * 1000)
        place = (round(lat * 1e7), round(lon * 1e7))
        records.append(
            (time, 1, mavlink.MAVLink_gps_raw_int_message(ms * 1000, 3, *place, 0, 1, 1, 0, 0, 9))
        )
        here = mavlink.MAVLink_global_position_int_message(
            ms, *place, round(up * 1000), 40_000, 0, 0, 0, 0
        )
        records.append((time, 1, here))
    for time, r in zip(ranges.time, ranges.r, strict=True):
        records += [(time, component, message) for component, message in say(round(time * 1000), r)]
    with file.open("wb") as log:
        for time, component, message in sorted(records, key=lambda record: record[0]):
            speaker = mavlink.MAVLink(None, srcSystem=3, srcComponent=component)
            log.write(round(1.75e15 + time * 1e6).to_bytes(8, "big") + message.pack(speaker))
    return file


def distances(ms, r):
    """Return DISTANCE_SENSOR messages of a radio and of a height sensor."""
    for cm, sensor, orientation in ((round(r * 100), 5, 24), (4000, 6, 25)):
        yield (
            1,
            mavlink.MAVLink_distance_sensor_message(ms, 20, 60000, cm, 4, sensor, orientation, 0),
        )


def as_run(folder, track, ranges, sigma=0.5, altitude=400.0, height=None):
    """Write a run folder with a radio that sends ranges under a name, and with messages of
    circnav's locator."""

    def say(ms, r):
        yield 1, mavlink.MAVLink_named_value_float_message(ms, b"UWB", r)
        yield 194, mavlink.MAVLink_named_value_float_message(ms, b"CN_TEAST", 30.0)

    known = f"target_altitude_m = {altitude}"
    if height is not None:
        known = f"height_above_target_m = {height}"
    text = TEXT.replace("[orbit]", f"[orbit]\n{known}").replace("_m = 0.5", f"_m = {sigma}")
    (folder / "mission.toml").write_text(
        text.replace('"distance_sensor"', '"named_value_float"\nname = "UWB"')
    )
    as_tlog(folder / "flight.tlog", track, ranges, say)
    return folder


def drawn(folder, monkeypatch):
    """Yield (limits, coordinate) of the detailed map of a log: the axis limits must contain this
    east or north coordinate, m from the first place."""
    figures = []
    monkeypatch.setattr(map_picture, "save", lambda figure, path: figures.append(figure))
    table = (folder / "log.locate.geojson").read_text()
    PLOT_MAP(folder / "map.png", table, "map")
    near = figures[0].axes[1]
    points = [
        (one["latitude_deg"], one["longitude_deg"])
        for one in places(folder / "log.locate.geojson").values()
    ]
    for east, north in (Plane(*points[0]).to_metres(*point) for point in points):
        yield from ((near.get_xlim(), east), (near.get_ylim(), north))


def off(found, target):
    return float(
        np.hypot(*(PLANE.to_metres(found["latitude_deg"], found["longitude_deg"]) - target))
    )


@cache
def smoothed():
    """Return a world with exact vehicle positions (track, ranges, target), and its target position
    and range bias from filterpy's unscented filter and smoother with their covariance."""
    track, ranges, target = circles(gps=0.0, laps=2)
    here = {}

    def measured(x):
        return np.array(
            [np.sqrt((x[0] - here["e"]) ** 2 + (x[1] - here["n"]) ** 2 + 40.0**2) + x[2]]
        )

    points = MerweScaledSigmaPoints(3, 0.1, 2.0, 0.0)
    ukf = UnscentedKalmanFilter(3, 1, 0.1, measured, lambda x, dt: x, points)
    ukf.x = np.array([target[0] + 20.0, target[1] - 15.0, 0.0])
    ukf.P = np.diag([900.0, 900.0, 4.0])
    ukf.Q = np.eye(3) * 1e-9
    ukf.R = np.array([[0.25]])
    means = []
    covariances = []
    for time, r in zip(ranges.time[::4], ranges.r[::4], strict=True):
        here["e"], here["n"] = (
            np.interp(time, track.time, track.east),
            np.interp(time, track.time, track.north),
        )
        ukf.predict()
        ukf.update(np.array([r]))
        means.append(ukf.x.copy())
        covariances.append(ukf.P.copy())
    x, P, _ = ukf.rts_smoother(np.array(means), np.array(covariances))
    return track, ranges, target, x[0], P[0]


@pytest.fixture(autouse=True)
def no_map(monkeypatch):
    """Draw no map, which takes half of the time. test_logs.py tests a command that draws it."""
    monkeypatch.setattr("circnav_mav.extras.locate.map_picture.plot_map", lambda *what: None)


AS_TOLD = ("--altitude", "400")


@pytest.mark.parametrize(
    ("write", "named", "tag", "options"),
    [
        (as_csv, "log.locate", "target", AS_TOLD),
        (
            lambda folder, *world: as_tlog(folder / "log.tlog", *world),
            "log.locate",
            "sensor 5 of 3/1",
            AS_TOLD,
        ),
        (as_run, "locate", "UWB of 3/1", ()),
    ],
    ids=["CSV", "tlog", "run folder"],
)
def test_located_place_agrees_with_independent_smoother(
    tmp_path, write, named, tag, options, capsys
):
    track, ranges, target, x, P = smoothed()
    assert run(write(tmp_path, track, ranges), "--gps-sigma", 0.05, *options) == Exit.DONE
    found = places(tmp_path / f"{named}.geojson")
    assert list(found) == [tag] and "sensor 6" not in capsys.readouterr().out
    one = found[tag]
    assert off(one, x[:2]) < 3 * np.sqrt(P[0, 0] + P[1, 1] + 2 * one["sigma_m"] ** 2)
    assert off(one, target) < 0.3
    assert one["sigma_m"] < 0.2 and abs(one["range_bias_m"]) < 1.0


def test_locate_of_run_uses_noise_and_altitude_of_mission(tmp_path):
    """The ranges of the log have no sigma, and the target is far below the vehicle: without the
    mission's values the place would be wrong."""
    track, ranges, _ = circles(gps=0.0, laps=2)

    def found(*options, **mission):
        assert (
            run(as_run(tmp_path, track, ranges, **mission), "--gps-sigma", 0.05, *options)
            == Exit.DONE
        )
        return places(tmp_path / "locate.geojson")["UWB of 3/1"]

    right = found()
    noisy = found(sigma=5.0)
    high = found(altitude=420.0)
    assert (right["altitude_m"], right["altitude_sigma_m"]) == pytest.approx((400.0, 1.0), abs=0.5)
    assert noisy["sigma_m"] > 4 * right["sigma_m"]
    assert high["altitude_m"] == pytest.approx(420.0, abs=1.5)
    assert high["range_bias_m"] - right["range_bias_m"] == pytest.approx(
        hypot(100, 40) - hypot(100, 20), rel=0.3
    )
    assert found("--altitude", 400, altitude=420.0) == right
    assert found(height=40.0)["altitude_m"] == pytest.approx(right["altitude_m"], abs=0.5)
    assert found("--sigma", 0.5, sigma=5.0) == right


def test_missing_altitude_is_interpolated():
    log = RangeLog(
        [
            (0.0, 47.3, 8.5, 400.0),
            (1.0, 47.3, 8.5, nan),
            (2.0, 47.3, 8.5, 410.0),
            (3.0, 47.3, 8.5, nan),
        ]
    )
    assert list(log.track(PLANE).up) == [400.0, 405.0, 410.0, 410.0]
    assert list(RangeLog([(0.0, 47.3, 8.5, nan)]).track(PLANE).up) == [0.0]


def test_two_named_tags_are_located_separately(tmp_path, capsys, monkeypatch):
    track, one, first = circles()
    rng = np.random.default_rng(5)
    second = np.array([20.0, -140.0])
    east, north = (np.interp(one.time, track.time, way) for way in (track.east, track.north))
    far = np.sqrt((east - second[0]) ** 2 + (north - second[1]) ** 2 + 40.0**2) + rng.normal(
        0, 0.5, len(east)
    )
    other = Ranges(one.time, far, one.sigma)
    found = located(tmp_path, track, one, other, names=("7", "tag 9"))
    assert off(found["7"], first) < 6 and off(found["tag 9"], second) < 6
    edges = drawn(tmp_path, monkeypatch)
    assert all(near[0] < at < near[1] for near, at in edges)
    capsys.readouterr()
    with pytest.raises(Refused, match="no target was located"):
        located(tmp_path, track, one, other, names=("", ""), options=("--units", "m"))
    assert "two tags mixed" in capsys.readouterr().out


def test_estimated_clock_offset_causes_warning(tmp_path, capsys):
    """The vehicle flies to a circle and along it, and the target is not at its center. An offset of
    16 s at 15 m/s shifts the positions by 240 m."""
    t = np.arange(0, 80, 0.1)
    east, north = 15.0 * np.minimum(t, 40) - 300, np.where(t > 40, 15.0 * (t - 40), 0.0)
    rng = np.random.default_rng(2)
    target = np.array([100.0, 150.0])
    r = np.sqrt((east - 100.0) ** 2 + (north - 150.0) ** 2 + 30.0**2) + rng.normal(0, 0.5, len(t))
    late = Track(t + 16.0, east, north, 0 * t + 30.0)
    ranges = Ranges(t, r, 0 * t + 0.5)
    found = located(tmp_path, late, ranges, options=("--gps-sigma", "0.5"))["target"]
    assert found["position_delay_s"] == pytest.approx(16.0, abs=0.2)
    assert off(found, target) < 3.0
    assert (
        "WARNING    the ranges fit only if the clocks differ by +16.0 s" in capsys.readouterr().out
    )


def test_circle_does_not_determine_clock_offset(tmp_path, capsys):
    """A clock offset of 5 s rotates the track along the same circle around the target, so the
    ranges still fit."""
    track, ranges, target = circles(laps=2)
    found = located(tmp_path, replace(track, time=track.time + 5.0), ranges)["target"]
    assert found["position_delay_sigma_s"] >= 0.5 and off(found, target) < 6
    assert "clocks     offset not observable" in capsys.readouterr().out


def test_impossible_target_height_names_height_and_unit(tmp_path, capsys):
    """Ranges in feet are read as meters, so the circle of 100 m looks like one flown 300 m above
    the target. The constant range fits every unit, each at another target height."""
    track, ranges, _ = circles()
    located(tmp_path, track, replace(ranges, r=ranges.r / 0.3048))
    printed = capsys.readouterr().out
    assert "WARNING    the ranges fit only a target at" in printed
    assert "probably in ft, give --units ft" in printed


@pytest.mark.parametrize("sigma", ["0", "-1", "nan", "", "1e-200"])
def test_invalid_sigma_is_treated_as_unknown(tmp_path, sigma):
    rows = f"1,47,8,5,{sigma}\n2,47,8,6,{sigma}\n3,,,inf,\n"
    (tmp_path / "log.csv").write_text("time,latitude,longitude,range,sigma\n" + rows)
    (log,) = read_logs(tmp_path / "log.csv")
    ranges, known = log.of("target", None)
    assert (list(ranges.r), list(ranges.sigma), known) == ([5.0, 6.0], [1.0, 1.0], False)


@pytest.mark.parametrize("option", ["--altitude", "--sigma", "--gps-sigma", "--bias"])
def test_option_without_a_number_is_refused(tmp_path, option):
    with pytest.raises(click.BadParameter, match="'nan' is not a number"):
        run(as_csv(tmp_path, *circles()[:2]), option, "nan")


def test_antenna_offset_changes_range_bias_not_place(tmp_path):
    """The antenna is 3 m ahead and 1.5 m outside of the GPS antenna. At a horizontal range of 100
    m, the slant range of 108 m grows by 100/108 of 1.5 m."""
    track, _, target = circles(gps=0.0, laps=2)
    here = np.column_stack([track.east, track.north])
    ahead = np.gradient(here, axis=0)
    ahead /= np.hypot(*ahead.T)[:, None]
    antenna = here + 3.0 * ahead + 1.5 * np.column_stack([ahead[:, 1], -ahead[:, 0]])
    noise = np.random.default_rng(8).normal(0, 0.3, len(here))
    r = np.sqrt(((antenna - target) ** 2).sum(axis=1) + 40.0**2) + noise
    found = located(tmp_path, track, Ranges(track.time, r, 0 * r + 0.3), options=PRECISE)["target"]
    assert found["range_bias_m"] == pytest.approx(1.39, abs=0.1)
    assert off(found, target) < 0.1


HEAD = "time,latitude,longitude,range\n"


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("time,lat,lon\n1,2,3\n", "no column latitude, longitude, range"),
        ("time,latitude,longitude,range_furlong\n", "no column range: .* a unit is a suffix"),
        ("time,latitude,longitude,range_m,range_ft\n", "two columns range: keep one"),
        (f"{HEAD},2,3,5\n", "line 2: time: is missing"),
        (f"{HEAD}01/07/2026 12:00,2,3,5\n", "line 2: time: '01/07/2026 12:00' is not a time"),
        (f"{HEAD}1782907200000,2,3,5\n", "line 2: time: 1.78291e.12 is not a time in s"),
        (f"{HEAD}1,2,3,\n2,2,3,\n", "no ranges in it"),
        (f"{HEAD}1,,,5\n2,,,6\n", "no positions in it"),
        (f"{HEAD}1,95,3,5\n", "line 2: latitude: 95 is not in degrees"),
        (f"{HEAD}1,2,3,far\n", "line 2: range: 'far' is not a number"),
        (f"{HEAD}1,2,3,1e160\n", "line 2: range: 1e.160 is too large"),
        (f"{HEAD}1e300,2,3,5\n", "line 2: time: 1e.300 is not a time in s: name its unit, time_ms"),
        (f"{HEAD}1,2,3,5\n2,2,3,5\n", "no target was located"),
    ],
)
def test_unusable_csv_is_refused_in_one_line(tmp_path, text, error):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(Refused, match=error) as refusal:
        run(tmp_path / "bad.csv")
    assert "\n" not in str(refusal.value) and "bad.csv" in str(refusal.value)


def test_missing_and_empty_logs_have_different_exit_codes(tmp_path):
    for name, exit in (("nothing in it.csv", Exit.USAGE), ("empty.csv", Exit.NOTHING_RECEIVED)):
        (tmp_path / "empty.csv").write_text("time,latitude,longitude,range\n")
        with pytest.raises(Refused) as refusal:
            run(tmp_path / name)
        assert refusal.value.exit == exit


def test_calibration_of_mission_is_applied_only_once(tmp_path):
    track, ranges, target = circles((100.0, 60.0), gps=0.0, noise=0.05, laps=1.0)
    # each range was measured 0.2 s before its stamp and is 7 % and 1.5 m too long
    reported = Ranges(ranges.time + 0.2, ranges.r * 1.07 + 1.5, ranges.sigma)
    run_folder = as_run(tmp_path, track, reported, sigma=0.05)
    mission = run_folder / "mission.toml"
    mission.write_text(
        mission.read_text().replace(
            "[ranging]", "[ranging]\nscale = 1.07\nbias_m = 1.5\ndelay_s = 0.2"
        )
    )
    assert run(run_folder, "--gps-sigma", 0.05) == Exit.DONE
    found = places(run_folder / "locate.geojson")["UWB of 3/1"]
    assert off(found, target) < 0.1
    assert found["range_scale"] is None and abs(found["range_bias_m"]) < 0.1
    assert abs(found["position_delay_s"]) < 0.02


def test_altitude_beyond_measured_range_causes_warning(tmp_path, capsys):
    """The operator enters a height above ground as the altitude above sea level."""
    rows = "1,47,8,540,60\n2,47,8,540,60\n"
    (tmp_path / "log.csv").write_text("time,latitude,longitude,altitude,range\n" + rows)
    with pytest.raises(Refused, match="no target was located"):
        run(tmp_path / "log.csv", "--altitude", "0")
    assert "farther than all ranges: is it above sea level?" in capsys.readouterr().out
