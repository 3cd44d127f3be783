"""Side-slip: the angle between a plane's nose and its motion through the air."""

from math import degrees, radians, remainder, tan, tau

import pytest

from circnav_mav.guidance.side_slip import SideSlip
from circnav_mav.guidance.types import OwnMotion
from tests.flight.lockstep import flight


def flown(
    turn_rate: float,
    *,
    bank: float | None,
    pitch: float = 0.0,
    bank_turn: float = 0.0,
    seconds: float = 120.0,
) -> float:
    """Return the angle (deg) from the nose to the motion through the air after some seconds of a
    turn, counter-clockwise."""
    own = OwnMotion(0.0, 1.0, 0.0, 23.4, pitch=pitch, bank_turn=None if bank is None else 0.0)
    slip, moved = SideSlip().follow(own)
    for step in range(1, round(20 * seconds) + 1):
        own = own._replace(time=step / 20, turn_rate=turn_rate)
        own = own if bank is None else own._replace(bank=bank, bank_turn=bank_turn)
        slip, moved = slip.follow(own)
    return degrees(moved.heading - 1.0)


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize(
    ("turn", "bank", "pitch", "angle"),
    [(3.0, 9.5, -3.8, 0.95), (8.96, 26.7, -2.8, 2.32), (16.0, 41.9, -1.6, 3.1)],
)
def test_it_is_known_how_far_inside_of_its_nose_arduplane_flies(turn, bank, pitch, angle, sense):
    """True tracks of ArduPlane 4.6.3 at 23.4 m/s, calm and around the lap in wind of 8 m/s. Units:
    deg/s and deg."""
    bank_turn = 9.80665 * tan(radians(bank)) / 23.4
    known = flown(
        sense * radians(turn),
        bank=sense * radians(bank),
        pitch=radians(pitch),
        bank_turn=sense * bank_turn,
    )
    assert known == pytest.approx(sense * angle, abs=0.1)


def test_who_turns_as_it_banks_or_is_a_copter_does_not_slip():
    assert flown(0.2, bank=0.4, bank_turn=0.2) == pytest.approx(0.0, abs=0.05)
    assert flown(0.2, bank=None) == 0


def test_a_nose_that_a_gust_lifts_for_a_second_tells_nothing():
    own = OwnMotion(0.0, 0.0, 0.15, 22.0, bank_turn=0.15, bank=0.35)
    slip, calm = SideSlip().follow(own)
    for step in range(1, 20):
        slip, moved = slip.follow(own._replace(time=step / 20, pitch=0.1))
    assert abs(degrees(moved.heading - calm.heading)) < 0.3


def test_a_slip_comes_within_a_second_and_goes_in_straight_flight():
    slip = SideSlip()
    angles = []
    for step in range(80):
        turning = step < 40
        own = OwnMotion(step / 20, 0.0, 0.156 * turning, 22.0, bank_turn=0.21 * turning)
        slip, _ = slip.follow(own)
        angles.append(degrees(slip.angle))
    assert angles[20] > 0.8
    assert abs(angles[-1]) < 0.3


def test_the_way_through_the_air_is_known_better_than_by_the_nose():
    flying = flight("arduplane", "sim.sensors.heading_bias_deg=0", law="auto").fly(50.0)
    by_nose = []
    by_slip = []
    for _ in range(200):
        flying.fly(flying.now + 0.1)
        true = flying.truths[-1]
        own = flying.pilot.own
        assert own is not None
        by_nose.append(remainder(true.heading - true.course, tau))
        by_slip.append(remainder(radians(90.0) - own.heading - true.course, tau))
    mean_nose, mean_slip = (abs(degrees(sum(offs) / len(offs))) for offs in (by_nose, by_slip))
    assert mean_nose > 1.0
    assert mean_slip < 0.7
