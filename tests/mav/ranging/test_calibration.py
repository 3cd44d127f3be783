"""The calibration in the mission, which converts reported ranges of a radio to true ranges, before
the slant correction."""

from math import sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from circnav_mav.mav.ranging.calibration import Calibration
from circnav_mav.mav.ranging.interface import RangingSettings
from circnav_mav.mission.load import MissionError, load_mission
from tests.flight.lockstep import CONFIG, flight, mean_radius
from tests.mav.ranging.receiver import Receiver

SX1280 = ((0.0, 4.4), (50.0, 57.6), (100.0, 103.0), (150.0, 148.0), (200.0, 201.0), (250.0, 253.0))
LISTED = "[[0, 4.4], [50, 57.6], [100, 103], [150, 148], [200, 201], [250, 253]]"


@pytest.mark.parametrize(
    "radio", [Calibration(1.07, 1.5), Calibration(0.93, -2.0), Calibration(points=SX1280)]
)
@given(length=st.floats(0, 1000))
def test_calibration_inverts_error_of_radio(radio, length):
    true, slope = radio.true(radio.reported(length))
    assert true == pytest.approx(length, abs=1e-6)
    there = radio.true(radio.reported(length) + 1e-6)[0]
    assert (
        slope == pytest.approx((there - true) / 1e-6, rel=1e-3)
        or abs(length / 50 - round(length / 50)) < 1e-6
    )


def test_calibration_applies_to_slant_range_before_height():
    settings = RangingSettings(sigma_m=0.5, calibration=Calibration(1.07, 1.5, 0.2))
    receiver = Receiver(settings, height=30.0)
    for at in range(3):
        sample = receiver.distance(10850, now=1.0 + 0.1 * at)
    assert sample.r == pytest.approx(sqrt(100.0**2 - 30.0**2), abs=1e-6)
    assert sample.time == pytest.approx(1.0)
    assert receiver.reader.slant == pytest.approx(100.0)


def test_calibration_scales_reported_variance():
    receiver = Receiver(RangingSettings(calibration=Calibration(2.0)))
    assert receiver.distance(20000, covariance=100).sigma == pytest.approx(0.05)


def test_calibrated_range_below_zero_is_rejected():
    receiver = Receiver(RangingSettings(calibration=Calibration(bias=5.0)))
    assert receiver.distance(400) is None and receiver.rejected == {"no_range": 1}


@pytest.mark.parametrize(
    ("overrides", "error"),
    [
        ("ranging.points_m=[[0, 4.4]]", "both rising"),
        ("ranging.points_m=[[0, 4.4], [50, 4.4]]", "both rising"),
        ("ranging.points_m=[[0, 4.4], [50, 57.6]]|ranging.scale=1.1", "replaces scale and bias_m"),
        ("ranging.scale=0.0", "scale"),
    ],
)
def test_mission_rejects_impossible_calibration(overrides, error):
    with pytest.raises(MissionError, match=error):
        load_mission(CONFIG / "quickstart.toml", overrides.split("|"))


@pytest.mark.parametrize(
    ("radio", "mission"),
    [(("sim.ranging.scale=1.07",), ("ranging.scale=1.07",)),
     ((f"sim.ranging.table_m={LISTED}",), (f"ranging.points_m={LISTED}",))],
)  # fmt: skip
def test_calibrated_radio_gives_circle_of_true_radius(radio, mission):
    """The emulated radio has the error that the mission's calibration removes."""
    start = "sim.start.north_m=100", "sim.start.east_m=0", "sim.start.heading_deg=90"
    truths = flight("quickstart", *start, *radio, *mission).fly(35.0).truths[-200:]
    assert mean_radius(truths) == pytest.approx(100.0, abs=0.5)
