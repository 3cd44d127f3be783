"""Height and range bias, which only a second circle of another radius separates. The operator
requests it."""

import pytest

from circnav_mav.guidance.circle_change import CircleRequest
from tests.extras.locate.flown import locating_flight

ON_CIRCLE = ("sim.start.north_m=100", "sim.start.east_m=0", "sim.start.heading_deg=90")
LOCATED = (*ON_CIRCLE, "sim.sensors.gps_error_m=0.02", "sim.ranging.bias_m=1.5")
LONG = "limits.duration_s=180"


def test_second_circle_separates_target_height_and_range_bias():
    """The target is 584 m above the sea and 30 m below the vehicle. All ranges are 1.5 m too
    long."""
    flown = locating_flight(*("quickstart", *LOCATED, LONG), law="feedforward")
    flown.solve_from = 1e9
    flown.fly(56.0)
    one = flown.solve()
    assert not one.up_known
    flown.pilot.request_circle(CircleRequest(radius=60.0, by="operator"), flown.now)
    flown.fly(120.0)
    known = flown.solve()
    assert known.up_known and abs(known.up - 584.0) < 0.5
    assert known.bias == pytest.approx(1.5, abs=0.3) and known.bias_sigma < 0.3
    flown.locator.found(known)
    flown.fly(125.0)
    texts = [message.text for _, message in flown.messages if message.get_type() == "STATUSTEXT"]
    assert texts == [
        "circnav: ranges 2 % too long, true radius 60.7 m",
        f"circnav: target {known.latitude:.6f} {known.longitude:.6f} {known.sigma:.1f} m",
        f"circnav: target at {known.up:.1f} m AMSL, sigma {known.up_sigma:.1f} m",
    ]
