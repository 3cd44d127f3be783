"""A radio with errors: the calibration in the mission gives true ranges in flight, applied once,
before the height."""

from math import sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.mav.ranging.calibration import Calibration
from circnav_mav.mav.ranging.interface import RangingSettings
from circnav_mav.mission.checks import check_mission
from circnav_mav.mission.load import MissionError, load_mission
from tests.flight.lockstep import CONFIG, flight, mean_radius
from tests.mav.ranging.ear import Ear

SX1280 = ((0.0, 4.4), (50.0, 57.6), (100.0, 103.0), (150.0, 148.0), (200.0, 201.0), (250.0, 253.0))
LISTED = "[[0, 4.4], [50, 57.6], [100, 103], [150, 148], [200, 201], [250, 253]]"


@pytest.mark.parametrize(
    "radio", [Calibration(1.07, 1.5), Calibration(0.93, -2.0), Calibration(points=SX1280)]
)
@given(length=st.floats(0, 1000))
def test_the_range_of_a_reading_is_the_length_that_the_radio_reported_so(radio, length):
    true, slope = radio.true(radio.reported(length))
    assert true == pytest.approx(length, abs=1e-6)
    there = radio.true(radio.reported(length) + 1e-6)[0]
    assert (
        slope == pytest.approx((there - true) / 1e-6, rel=1e-3)
        or abs(length / 50 - round(length / 50)) < 1e-6
    )


def test_the_slant_range_is_corrected_before_the_height_is_taken_off():
    settings = RangingSettings(sigma_m=0.5, calibration=Calibration(1.07, 1.5, 0.2))
    ear = Ear(settings, height=30.0)
    for at in range(3):
        sample = ear.distance(10850, now=1.0 + 0.1 * at)
    assert sample.r == pytest.approx(sqrt(100.0**2 - 30.0**2), abs=1e-6)
    assert sample.time == pytest.approx(1.0)
    assert ear.reader.slant == pytest.approx(100.0)


def test_the_reported_variance_shrinks_with_the_range():
    ear = Ear(RangingSettings(calibration=Calibration(2.0)))
    assert ear.distance(20000, covariance=100).sigma == pytest.approx(0.05)


def test_a_reading_below_that_of_length_zero_is_no_range():
    ear = Ear(RangingSettings(calibration=Calibration(bias=5.0)))
    assert ear.distance(400) is None and ear.rejected == {"no_range": 1}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("ranging.points_m=[[0, 4.4]]", "both rising"),
        ("ranging.points_m=[[0, 4.4], [50, 4.4]]", "both rising"),
        ("ranging.points_m=[[0, 4.4], [50, 57.6]]|ranging.scale=1.1", "replaces scale and bias_m"),
        ("ranging.scale=0.0", "scale"),
    ],
)
def test_a_calibration_that_no_radio_has_is_refused(given, words):
    with pytest.raises(MissionError, match=words):
        load_mission(CONFIG / "quickstart.toml", given.split("|"))


def test_check_says_what_the_radio_reports_on_the_circle():
    mission = load_mission(
        CONFIG / "quickstart.toml", [f"ranging.points_m={LISTED}", "orbit.radius_m=300"]
    )
    lines = [line.text for line in check_mission(mission) if line.subject == "calibration"]
    assert lines[0] == "6 points: 301.5 m on the circle are reported as 306.6 m"
    assert "covers 0 to 250 m" in lines[1]


@pytest.mark.parametrize(
    ("radio", "mission"),
    [(("sim.ranging.scale=1.07",), ("ranging.scale=1.07",)),
     ((f"sim.ranging.table_m={LISTED}",), (f"ranging.points_m={LISTED}",))],
)  # fmt: skip
def test_a_radio_that_errs_flies_the_true_circle_with_its_calibration(radio, mission):
    """For a radio without errors, the calibration would fly another circle."""
    start = "sim.start.north_m=100", "sim.start.east_m=0", "sim.start.heading_deg=90"
    truths = flight("quickstart", *start, *radio, *mission).fly(45.0).truths[-200:]
    assert mean_radius(truths) == pytest.approx(100.0, abs=0.5)
