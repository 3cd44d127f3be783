"""`circnav locate` on logs of anybody's, against an independent filter and hand-made worlds."""

import csv
import json
from collections.abc import Sequence

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav import cli
from circnav_mav.cli.exits import Exit, Refused
from circnav_mav.locate.estimator import Ranges, Track
from tests.locate.worlds import PLANE, circles

Row = Sequence[object]
PRECISE = ("--gps-sigma", "0.05", "--altitude", "400")


def run(*arguments):
    return int(cli.circnav.main(["locate", *map(str, arguments)], standalone_mode=False) or 0)


def places(path):
    features = json.loads(path.read_text())["features"]
    return {one["properties"]["name"]: one["properties"] for one in features if one["geometry"]["type"] == "Point"}


def located(folder, track, *tags, names=("",), options=()):
    """What the command finds in a CSV of positions and ranges."""
    latitude, longitude = PLANE.to_degrees(track.east, track.north)
    rows: list[Row] = [(*place, "", "", "") for place in zip(track.time, latitude, longitude, track.up, strict=True)]
    for name, tag in zip(names, tags, strict=True):
        rows += [(time, "", "", "", r, name) for time, r in zip(tag.time, tag.r, strict=True)]
    with (folder / "log.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("time", "lat", "lon", "alt", "range", "tag"), *rows])
    assert run(folder / "log.csv", *options) == Exit.DONE
    return places(folder / "log.locate.geojson")


def off(found, target):
    return float(np.hypot(*(PLANE.to_metres(found["latitude_deg"], found["longitude_deg"]) - target)))


def filtered(track, ranges, target):
    """filterpy's unscented filter: place of the target and range bias at the end, positions taken as they are."""
    here = {}

    def measured(x):
        return np.array([np.sqrt((x[0] - here["e"]) ** 2 + (x[1] - here["n"]) ** 2 + 40.0**2) + x[2]])

    points = MerweScaledSigmaPoints(3, 0.1, 2.0, 0.0)
    ukf = UnscentedKalmanFilter(3, 1, 0.1, measured, lambda x, dt: x, points)
    ukf.x, ukf.P = np.array([target[0] + 20.0, target[1] - 15.0, 0.0]), np.diag([900.0, 900.0, 4.0])
    ukf.Q, ukf.R = np.eye(3) * 1e-9, np.array([[0.25]])
    for time, r in zip(ranges.time[::4], ranges.r[::4], strict=True):
        here["e"], here["n"] = np.interp(time, track.time, track.east), np.interp(time, track.time, track.north)
        ukf.predict()
        ukf.update(np.array([r]))
    return ukf.x, ukf.P


def test_it_agrees_with_an_independent_filter_on_the_same_log(tmp_path):
    track, ranges, target = circles(gps=0.0, laps=2)
    found = located(tmp_path, track, ranges, options=PRECISE)["target"]
    x, P = filtered(track, ranges, target)
    assert off(found, x[:2]) < 3 * np.sqrt(P[0, 0] + P[1, 1] + 2 * found["sigma_m"] ** 2)
    assert off(found, target) < 0.3
    assert found["sigma_m"] < 0.2


def test_several_tags_are_told_apart_by_their_ids_and_mixed_ones_get_a_warning(tmp_path, capsys):
    track, one, first = circles()
    rng, second = np.random.default_rng(5), np.array([20.0, -140.0])
    east, north = (np.interp(one.time, track.time, way) for way in (track.east, track.north))
    far = np.sqrt((east - second[0]) ** 2 + (north - second[1]) ** 2 + 40.0**2) + rng.normal(0, 0.5, len(east))
    other = Ranges(one.time, far, one.sigma)
    found = located(tmp_path, track, one, other, names=("7", "tag 9"))
    assert off(found["7"], first) < 6 and off(found["tag 9"], second) < 6
    capsys.readouterr()
    located(tmp_path, track, one, other, names=("", ""))
    assert "two tags mixed" in capsys.readouterr().out


def test_a_clock_offset_between_positions_and_ranges_is_found(tmp_path):
    """On the way to the circle and off its centre: 15 m/s and 16 s are 240 m."""
    t = np.arange(0, 80, 0.1)
    east, north = 15.0 * np.minimum(t, 40) - 300, np.where(t > 40, 15.0 * (t - 40), 0.0)
    rng, target = np.random.default_rng(2), np.array([100.0, 150.0])
    r = np.sqrt((east - 100.0) ** 2 + (north - 150.0) ** 2 + 30.0**2) + rng.normal(0, 0.5, len(t))
    late, ranges = Track(t + 16.0, east, north, 0 * t + 30.0), Ranges(t, r, 0 * t + 0.5)
    found = located(tmp_path, late, ranges, options=("--gps-sigma", "0.5"))["target"]
    assert found["position_delay_s"] == pytest.approx(16.0, abs=0.2)
    assert off(found, target) < 3.0


def test_a_ranging_antenna_off_the_gps_antenna_reads_as_delay_and_bias_and_leaves_the_place(tmp_path):
    """3 m ahead, and 1.5 m to the outside of the circle, of which a slant of 108 m shows 100/108."""
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


def test_a_tlog_of_anybodys_is_read_by_its_messages(tmp_path, capsys):
    track, ranges, target = circles(gps=0.3)
    speaker = mavlink.MAVLink(None, srcSystem=3, srcComponent=1)
    latitude, longitude = PLANE.to_degrees(track.east, track.north)
    records = []
    for time, lat, lon, up in zip(track.time, latitude, longitude, track.up, strict=True):
        ms = round(time * 1000)
        fix = mavlink.MAVLink_gps_raw_int_message(ms * 1000, 3, round(lat * 1e7), round(lon * 1e7), 0, 1, 1, 0, 0, 9)
        here = mavlink.MAVLink_global_position_int_message(
            ms, round(lat * 1e7), round(lon * 1e7), round(up * 1000), 40_000, 0, 0, 0, 0
        )
        records += [(time, fix), (time, here)]
    for time, r in zip(ranges.time, ranges.r, strict=True):
        for cm, sensor, orientation in ((round(r * 100), 5, 24), (4000, 6, 25)):
            fields = round(time * 1000), 20, 60000, cm, 4, sensor, orientation, 0
            records.append((time, mavlink.MAVLink_distance_sensor_message(*fields)))
    log = tmp_path / "flight.tlog"
    with log.open("wb") as file:
        for time, message in sorted(records, key=lambda record: record[0]):
            file.write(round(1.75e15 + time * 1e6).to_bytes(8, "big") + message.pack(speaker))
    assert run(log) == Exit.DONE
    found = places(tmp_path / "flight.locate.geojson")
    assert list(found) == ["sensor 5 of 3/1"] and "sensor 6" not in capsys.readouterr().out, "a height sensor is no tag"
    assert off(found["sensor 5 of 3/1"], target) < 2.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("time,lat,lon\n1,2,3\n", "no column range"),
        ("time,lat,lon,range\n1,2,3,\n2,2,3,\n", "no ranges in it"),
        ("time,lat,lon,range\n1,,,5\n2,,,6\n", "no positions in it"),
        ("time,lat,lon,range\n1,95,3,5\n", "line 2: 95 3 is no place"),
        ("time,lat,lon,range\n1,2,3,far\n", "line 2: range: 'far' is not a number"),
        ("time,lat,lon,range\n1,2,3,5\n2,2,3,5\n", "no target was located"),
    ],
)
def test_bad_input_is_one_line_that_names_file_and_remedy(tmp_path, text, says):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(Refused, match=says) as refusal:
        run(tmp_path / "bad.csv")
    assert "\n" not in str(refusal.value) and "bad.csv" in str(refusal.value)
