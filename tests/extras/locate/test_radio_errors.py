"""A radio with errors: estimated and undetermined errors, and the output of `ranging calibrate`."""

import re
from dataclasses import replace
from math import hypot

import numpy as np
import pytest

from circnav_mav import cli
from circnav_mav.cli.exits import Refused
from circnav_mav.extras.locate.calibrate import measure, write_into
from circnav_mav.extras.locate.estimator import (
    UNCALIBRATED,
    NotLocated,
    Ranges,
    Track,
    locate,
)
from circnav_mav.extras.locate.units import likely_unit
from circnav_mav.mav.ranging.calibration import Calibration
from circnav_mav.mission.load import load_mission
from tests import small_mission
from tests.extras.locate.flown import locating_flight, taped
from tests.extras.locate.worlds import KNOWN, PLANE, V, gps_error
from tests.flight.lockstep import CONFIG, true_radius

HEIGHT = 40.0
ON_CIRCLE = ("sim.start.north_m=100", "sim.start.east_m=0", "sim.start.heading_deg=90")
ABOVE = replace(KNOWN, up_sigma=0.5)
SX1280 = Calibration(
    points=((0, 4.4), (50, 57.6), (100, 103), (150, 148), (200, 201), (250, 253), (600, 603))
)


def approach_and_laps(radio, *, seed=1, gps=1.5, laps=4.0, far=500.0):
    """Return an approach from `far` onto a circle of 100 m around the origin at 15 m/s, and laps
    there."""
    rng = np.random.default_rng(seed)
    straight = np.arange(-far, 0.0, V * 0.1)
    angle = np.arange(0, laps * 2 * np.pi, V * 0.1 / 100)
    true = np.concatenate([
        np.column_stack([straight, np.full(len(straight), -100.0)]),
        100 * np.column_stack([np.sin(angle), -np.cos(angle)]),
    ])  # fmt: skip
    t = 0.1 * np.arange(len(true))
    measured = true + (gps_error(t, rng, gps) if gps else 0.0)
    slant = np.sqrt((true**2).sum(axis=1) + HEIGHT**2)
    r = np.array([radio.reported(one) for one in slant]) + rng.normal(0, 0.5, len(t))
    return Track(t, *measured.T, np.full(len(t), 400.0 + HEIGHT)), Ranges(
        t, r, np.full(len(t), 0.5)
    )


def test_straight_approach_determines_range_scale():
    known = replace(ABOVE, gps_sigma=0.05)
    errors = []
    for radio in (Calibration(), Calibration(1.07, 1.0)):
        place = locate(PLANE, *approach_and_laps(radio, gps=0.05), known)
        errors.append(hypot(place.east, place.north))
        assert errors[-1] < 3 * place.sigma < 0.6
    assert place.scale == pytest.approx(0.07, abs=3 * place.scale_sigma) and place.scale_found
    assert place.bias == pytest.approx(1.0, abs=3 * place.bias_sigma)


def test_one_circle_determines_only_sum_of_range_errors():
    track, ranges = approach_and_laps(Calibration(1.07), far=0.0)
    place = locate(PLANE, track, ranges, replace(ABOVE, scale_sigma=UNCALIBRATED, bias_sigma=10.0))
    error, sigma = place.range_error(hypot(100.0, HEIGHT))
    assert error == pytest.approx(0.07 * hypot(100.0, HEIGHT), abs=3 * sigma) and sigma < 0.6
    assert not place.scale_found and place.bias_sigma > 5


def test_unknown_target_height_leaves_range_scale_undetermined():
    """The radio has no error. The circle is level and not around the target, which is 40 m below at
    a height that is unknown to the estimator."""
    t = 0.5 * np.arange(240)
    angle = t * V / 80
    east, north = 80 * np.sin(angle), 80 * np.cos(angle) + 160.0
    rng = np.random.default_rng(3)
    r = np.sqrt(east**2 + north**2 + HEIGHT**2) + rng.normal(0, 0.3, len(t))
    track = Track(t, east, north, np.full(len(t), 440.0))
    ranges = Ranges(t, r, np.full(len(t), 0.3))
    known = replace(KNOWN, up_sigma=50.0, scale_sigma=UNCALIBRATED)
    free = locate(PLANE, track, ranges, known)
    assert abs(free.scale) < 3 * free.scale_sigma and free.scale_sigma > 0.01
    assert measure(PLANE, track, ranges, known).calibration.scale == 1.0


def test_wandering_gps_altitude_causes_no_range_error():
    """With an altitude that wandered by 0.8 m on approach and circle, ranges without error were
    once reported as 5.8 ±0.5 m too long."""
    track, ranges = approach_and_laps(Calibration(), laps=2.0, far=200.0)
    wander = gps_error(track.time, np.random.default_rng(7), 0.8, time=30.0)[:, 0]
    known = replace(KNOWN, up=439.0, up_sigma=50.0, delay_sigma=0.5)
    place = locate(PLANE, replace(track, up=track.up + wander), ranges, known)
    error, sigma = place.range_error(place.distance_scale)
    assert abs(error) < 3 * sigma and abs(place.up - 400.0) < 3 * place.up_sigma


@pytest.mark.parametrize("digits", [4, 5])
@pytest.mark.parametrize("known", [True, False])
def test_rounded_positions_cause_no_range_error(digits, known):
    """Latitudes and longitudes with four decimals have steps of 11 and 8 m. Ranges without error
    were once reported as 9.2 ±1.9 m too short."""
    t = 0.2 * np.arange(600)
    east, north = 80 * np.sin(t * 12 / 80) + 17.0, 80 * np.cos(t * 12 / 80) + 12.0
    noise = np.random.default_rng(100).normal(0, 0.3, len(t))
    r = np.sqrt(east**2 + north**2 + HEIGHT**2) + noise
    places = [np.round(degrees, digits) for degrees in PLANE.to_degrees(east, north)]
    track = Track(t, *PLANE.to_metres(*places), np.full(len(t), 400.0 + HEIGHT))
    ranges = Ranges(t, r, np.full(len(t), 0.3))
    prior = replace(KNOWN, up=440.0, up_sigma=50.0, delay_sigma=0.5, sigma_known=known)
    place = locate(PLANE, track, ranges, prior)
    error, sigma = place.range_error(place.distance_scale)
    assert hypot(place.east, place.north) < 3 * place.sigma < 6.0
    assert abs(error) < 1.5 * sigma and not place.scale_found and not place.moves


@pytest.mark.parametrize("scale", [1.0, 1.07])
def test_circle_at_unknown_height_determines_no_range_error(scale):
    track, ranges = approach_and_laps(Calibration(scale), laps=2.0, far=0.0)
    place = locate(PLANE, track, ranges, replace(KNOWN, up=440.0, up_sigma=50.0, sigma_known=False))
    error, sigma = place.range_error(100.0)
    assert not place.up_known and not place.scale_found and abs(error) < sigma


@pytest.mark.parametrize("offset", [154.6, -40.0])
def test_large_range_offset_is_named_when_location_fails(offset):
    track, ranges = approach_and_laps(Calibration(1.0, offset), laps=1.2)
    answer = locate(PLANE, track, ranges, replace(ABOVE, up_sigma=5.0))
    assert isinstance(answer, NotLocated) and "radio not calibrated" in answer.why
    assert answer.range_error == pytest.approx(offset, abs=4.0)


@pytest.mark.parametrize(("scale", "unit"), [(1.07, None), (1 / 0.9144, "yd")])
def test_too_long_ranges_are_not_reported_as_yards(scale, unit):
    track, ranges = approach_and_laps(Calibration(scale), laps=2.0)
    noise = np.random.default_rng(5).normal(0, 1.5, len(ranges.r))
    ranges = replace(ranges, r=ranges.r + noise, sigma=np.full(len(noise), 1.6))
    place = locate(PLANE, track, ranges, ABOVE)
    assert likely_unit(PLANE, track, ranges, ABOVE, place) == unit
    assert "(7 %) too long" in place.range_error_words() or unit == "yd"


@pytest.mark.parametrize("seed", range(2))
def test_level_track_determines_no_target_height(seed):
    """A cart with RTK passes a UWB anchor at distances of 4 to 50 m. The anchor is 1 m above the
    cart, and the ground is level within 0.1 m."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, 190.0, 1.0)
    east, north = 22 * np.cos(t / 30) + 26, 5 * np.sin(t / 15) + 1
    up = 0.08 * np.sin(t / 40) + rng.normal(0, 0.02, len(t))
    ranges = Ranges(
        t,
        np.sqrt(east**2 + north**2 + (up - 0.93) ** 2) + rng.normal(0, 0.05, len(t)),
        0 * t + 0.05,
    )
    for gps in (0.05, 1.5):
        place = locate(
            PLANE,
            Track(t, east, north, up),
            ranges,
            replace(KNOWN, up=0.0, up_sigma=50.0, gps_sigma=gps),
        )
        assert not place.up_known or abs(place.up - 0.93) < 3 * place.up_sigma
        assert hypot(place.east, place.north) < 3 * place.sigma + 0.1


@pytest.mark.parametrize(
    ("radio", "gps"),
    [(Calibration(1.07), 1.5), (Calibration(0.95, 2.0), 1.5), (SX1280, 1.5), (SX1280, 0.05)],
)
def test_calibration_result_gives_circle_of_true_radius(radio, gps):
    known = replace(
        ABOVE,
        up_sigma=0.1,
        gps_sigma=gps,
        bias_sigma=10.0,
        scale_sigma=UNCALIBRATED,
        delay_sigma=0.1,
    )
    found = measure(PLANE, *approach_and_laps(radio, gps=gps), known).calibration
    assert bool(found.points) == (radio is SX1280 and gps < 1)
    # true radius of the circle that is flown with this calibration at 100 m of horizontal range
    slant, _ = radio.true(found.reported(hypot(100.0, HEIGHT)))
    assert np.sqrt(slant**2 - HEIGHT**2) == pytest.approx(100.0, abs=0.5)


def as_csv(file, track, ranges):
    """Write a CSV of positions and ranges at the same times and return its path."""
    latitude, longitude = PLANE.to_degrees(track.east, track.north)
    rows = zip(track.time, latitude, longitude, track.up, ranges.r, strict=True)
    lines = [f"{t:.1f},{a:.9f},{b:.9f},{up:.1f},{r:.2f}" for t, a, b, up, r in rows]
    file.write_text("\n".join(["time,latitude,longitude,altitude,range", *lines]))
    return file


def test_calibrate_writes_plot_beside_mission_keys(tmp_path, capsys):
    log = as_csv(tmp_path / "flight.csv", *approach_and_laps(Calibration(1.07, 1.5), gps=0.05))
    mission = tmp_path / "mine.toml"
    mission.write_text((CONFIG / "quickstart.toml").read_text())
    options = ["--altitude", "400", "--gps-sigma", "0.05", "--mission"]
    command = ["ranging", "calibrate", str(log), *options, str(mission)]
    assert not cli.circnav.main(command, standalone_mode=False)
    printed = capsys.readouterr().out
    ranging = load_mission(mission).file.ranging
    assert ranging.scale == pytest.approx(1.07, abs=0.005) and ranging.bias_m == pytest.approx(
        1.5, abs=0.7
    )
    assert f"scale = {ranging.scale}" in printed and "reported minus true" in printed
    assert (tmp_path / "flight.calibration.png").exists()
    assert (tmp_path / "flight.calibration.toml").exists()
    assert "# MAVLink message that carries the range" in mission.read_text()


@pytest.mark.nightly
def test_calibrated_plane_flies_circle_of_true_radius(tmp_path):
    table = (
        "sim.ranging.table_m=[[0, 4.4], [50, 57.6], [100, 103], [150, 148], [200, 201], [250, 253]]"
    )
    keys = "orbit.radius_m=100", "sim.sensors.gps_error_m=1.5", table
    calibration = []
    radii = []
    for number in range(2):
        flown = taped("arduplane", *keys, *calibration, law="auto").fly(150.0)
        radii.append(np.mean([true_radius(one) for one in flown.truths if one.time > 90.0]))
        run = tmp_path / f"run{number}"
        run.mkdir()
        flown.write(run / "flight.tlog")
        (run / "mission.toml").write_text((CONFIG / "arduplane.toml").read_text())
        assert not cli.circnav.main(["ranging", "calibrate", str(run)], standalone_mode=False)
        lines = (run / "calibration.toml").read_text().splitlines()[1:]
        calibration = [f"ranging.{line.replace(' = ', '=')}" for line in lines]
    assert radii[1] == pytest.approx(100.0, abs=0.65)
    assert abs(radii[0] - 100.0) > 1.0


def test_radius_alarm_names_range_offset_and_calibration():
    """Ranges 22 m too short give a circle that is 22 m too wide."""
    short = "sim.ranging.bias_m=-22"
    flown = locating_flight("quickstart", *ON_CIRCLE, short, "sim.sensors.gps_error_m=1.0")
    flown.solve_from = 1e9
    flown.fly(75.0)
    flown.locator.found(flown.solve())
    alarm = f"{flown.locator.radius_alarm}. {flown.locator.radius_remedy}"
    assert re.search(r"ranges (are )?2[123] m too short", alarm) and "Calibrate" in alarm


def test_radius_alarm_states_true_radius_when_ranges_are_long():
    for keys, alarm in ((), True), (("ranging.scale=1.07",), False):
        flown = locating_flight("quickstart", *ON_CIRCLE, "sim.ranging.scale=1.07", *keys)
        flown.solve_from = 1e9
        flown.fly(60.0)
        flown.locator.found(flown.solve())
        assert bool(flown.locator.radius_alarm) == alarm
        flown.fly(62.0)
        texts = [
            one.text
            for _, one in flown.messages
            if one.get_type() == "STATUSTEXT" and "true radius" in one.text
        ]
        assert len(texts) == alarm
        if alarm:
            number = re.fullmatch(r"circnav: ranges 7 % too long, true radius ([\d.]+) m", texts[0])
            true = np.mean([true_radius(one) for one in flown.truths[-390:]])
            assert number and float(number[1]) == pytest.approx(true, abs=0.5)


def test_calibration_without_height_leaves_the_mission_unchanged(tmp_path):
    log = as_csv(tmp_path / "flight.csv", *approach_and_laps(Calibration(1.0, 1.5), laps=1.0))
    mission = tmp_path / "mine.toml"
    text = (CONFIG / "quickstart.toml").read_text()
    text = text.replace("height_above_target_m = ", "# height_above_target_m = ")
    mission.write_text(text)
    with pytest.raises(Refused, match="give --altitude"):
        cli.circnav.main(
            ["ranging", "calibrate", str(log), "--mission", str(mission)], standalone_mode=False
        )
    assert mission.read_text() == text


def test_calibration_refuses_a_radio_with_a_large_offset():
    track, ranges = approach_and_laps(Calibration(1.0, 154.6), laps=1.0)
    known = replace(KNOWN, up_sigma=50.0, bias_sigma=10.0, scale_sigma=UNCALIBRATED)
    assert isinstance(measure(PLANE, track, ranges, known), NotLocated)


TABLE = '[ranging]\nmessage = "distance_sensor"\nrate_hz = 10.0\nsigma_m = 0.5\n'
INLINE = 'ranging = {message = "distance_sensor", rate_hz = 10.0, sigma_m = 0.5}\n'


@pytest.mark.parametrize(
    "text",
    [
        small_mission.TEXT,
        "\ufeff" + small_mission.TEXT,
        INLINE + small_mission.TEXT.replace(TABLE, ""),
    ],
    ids=["table", "byte-order mark", "inline table"],
)
def test_calibration_is_written_into_differently_formatted_toml(tmp_path, text):
    file = tmp_path / "mission.toml"
    file.write_text(text, encoding="utf-8")
    write_into(file, Calibration(1.02, 0.5))
    written = load_mission(file).file.ranging
    assert (written.scale, written.bias_m, written.sigma_m) == (1.02, 0.5, 0.5)
