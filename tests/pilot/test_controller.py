"""When a vehicle counts as having the speed that it is told (a copter is believed to fly at V only then), and what its
radius error adds up to."""

import pytest

from circnav_mav.guidance.types import OwnMotion, RangeEstimate, TurnCommand, TurnRate
from circnav_mav.mav.autopilots.table import adapters
from circnav_mav.mav.identity import Sender
from circnav_mav.mav.session import Session
from circnav_mav.mission.load import parse_mission
from circnav_mav.pilot.controller import DEAF_AFTER, LONGEST_GAP, SPEED_UP, Controller
from circnav_mav.pilot.mission_state import Phase
from tests.small_mission import TEXT

TOLD = TurnRate(-0.2)
STEP = 0.05


class Vehicle:
    """A controller that has told a vehicle to turn, and the heading that the vehicle reports."""

    def __init__(self, *overrides: str) -> None:
        settings = parse_mission(TEXT, "small.toml", overrides).pilot_settings()
        session = Session(settings.link, adapters(settings.autopilot, settings.kind, settings.facts))
        session.identity.peer = Sender(1, 1, "here")
        self.controller, self.now, self.heading = Controller(settings), 0.0, 0.0
        command = TurnCommand(TOLD, TOLD, saturated=False)
        self.controller.setpoint(command, session, 0.0)
        self.controller.commanded(command, 0.0)

    def turns(self, seconds: float, rate: float) -> list[bool]:
        """Report the heading while it turns at a rate (rad/s); whether it was at speed at each report."""
        return [self._report(rate) for _ in range(round(seconds / STEP))]

    def demanded(self, time: float, r: float) -> float:
        """What the law asks for on a path round the target at a range (m), rad/s."""
        command = self.controller.command(Phase.ENGAGED, RangeEstimate(time, r, 0.0, 0.1, 0.1), None, time)
        assert command is not None
        return command.demanded

    def _report(self, rate: float) -> bool:
        self.now, self.heading = self.now + STEP, self.heading + rate * STEP
        self.controller.on_motion(OwnMotion(self.now, self.heading, rate, 15.0))
        return self.controller.at_speed


def test_a_vehicle_is_at_speed_once_it_has_turned_as_told_for_long_enough() -> None:
    before = Vehicle().turns(10.0, TOLD)
    assert before.index(True) * STEP >= SPEED_UP - STEP
    assert before.index(True) * STEP <= SPEED_UP + 2 * STEP
    assert all(before[before.index(True) :])


def test_one_that_does_not_hear_us_is_not_at_speed_and_needs_the_time_anew() -> None:
    vehicle = Vehicle()
    vehicle.turns(10.0, TOLD)
    assert not vehicle.turns(DEAF_AFTER + 3.0, 0.0)[-1]
    again = vehicle.turns(10.0, TOLD)
    assert again.index(True) * STEP >= SPEED_UP
    assert all(again[again.index(True) :])


def test_a_moment_of_not_following_costs_no_more_than_the_moment() -> None:
    """A reversed turn takes less than DEAF_AFTER; the vehicle does not stop for it. A shorter one costs nothing."""
    vehicle = Vehicle()
    vehicle.turns(30.0, TOLD)
    assert all([*vehicle.turns(1.3, 0.0), *vehicle.turns(10.0, TOLD)])
    seen = [*vehicle.turns(1.8, 0.0), *vehicle.turns(3.0, TOLD)]
    assert 0.1 < seen.count(False) * STEP < DEAF_AFTER
    assert seen[-1]


def test_after_a_gap_in_its_reports_it_may_have_stopped() -> None:
    vehicle = Vehicle()
    vehicle.turns(10.0, TOLD)
    vehicle.now += LONGEST_GAP + 0.1
    again = vehicle.turns(10.0, TOLD)
    assert not again[0]
    assert SPEED_UP - 2 * STEP <= again.index(True) * STEP <= SPEED_UP + 2 * STEP


@pytest.mark.parametrize(("rate", "pulls"), [(TOLD, True), (0.0, False)], ids=["following", "deaf"])
def test_the_radius_integral_pulls_towards_the_circle_while_the_vehicle_follows(rate: float, pulls: bool) -> None:
    vehicle = Vehicle("guidance.radius_trim_per_s=0.02")
    vehicle.turns(5.0, rate)
    assert vehicle.controller.followed is pulls
    demanded = [vehicle.demanded(5.0 + n * STEP, 103.0) for n in range(200)]
    tighter = demanded[0] - demanded[-1]  # clockwise is negative
    assert (tighter > 0.001) is pulls
    assert tighter >= 0
