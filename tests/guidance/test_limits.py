"""Bank limit of a plane and lean limit of a copter, each found from the reports of a simulated
turn."""

from collections.abc import Callable
from math import inf, pi, radians, sin, tan
from random import Random

import pytest

from circnav_mav.guidance.limits import BankLimit, LeanLimit
from circnav_mav.guidance.types import GRAVITY, OwnMotion
from circnav_mav.timers import LowPass

STEP = 0.05
LIMITED = 0.15
"""Coordinated turn rate of a bank at its limit, rad/s."""
Signal = Callable[[float], float]


def bank_limit(
    seconds: float,
    *,
    bank: Signal = lambda time: LIMITED,
    commanded: float = 0.2,
    nose: Signal = lambda time: LIMITED,
) -> BankLimit:
    """Return the limit found after a turn.

    bank: coordinated turn rate of the bank at a time (s), rad/s.
    nose: turn rate of the nose at a time, rad/s.
    """
    limit = BankLimit()
    smooth = LowPass(1.0)
    heading = 0.0
    for tick in range(round(seconds / STEP) + 1):
        time = tick * STEP
        own = OwnMotion(time, heading, nose(time), 20.0, bank_turn=bank(time))
        limit.follow(own, commanded, smooth.update(bank(time), STEP))
        heading += nose(time) * STEP
    return limit


@pytest.mark.parametrize(("seconds", "found"), [(1.3, inf), (1.8, LIMITED)])
def test_bank_limit_is_found_after_bank_was_steady(seconds: float, found: float) -> None:
    assert bank_limit(seconds).bank == pytest.approx(found)


@pytest.mark.parametrize(("commanded", "found"), [(0.155, inf), (0.162, LIMITED)])
def test_bank_limit_needs_missing_turn_of_5_percent(commanded: float, found: float) -> None:
    assert bank_limit(10.0, commanded=commanded).bank == pytest.approx(found)


def test_bank_limit_is_found_although_bank_varies_by_2_percent() -> None:
    limit = bank_limit(10.0, bank=lambda time: LIMITED * (1 + 0.02 * sin(pi * time)))
    assert limit.bank == pytest.approx(LIMITED, rel=0.01)


def test_bank_that_rises_by_5_percent_per_second_is_no_limit() -> None:
    assert bank_limit(4.0, bank=lambda time: LIMITED * (1 + 0.05 * time)).bank == inf


def noisy(seed: int) -> Signal:
    """Return a turn rate of the nose with gusts, rad/s."""
    random = Random(seed)
    return lambda time: random.gauss(LIMITED, 0.05)


def test_turn_at_bank_limit_is_averaged_over_gusts() -> None:
    errors = [bank_limit(60.0, nose=noisy(seed)).turn / LIMITED - 1 for seed in range(10)]
    assert sum(error**2 for error in errors) / 10 < 0.015**2


def test_turn_at_bank_limit_follows_change_within_40_seconds() -> None:
    limit = bank_limit(100.0, nose=lambda time: LIMITED if time < 60 else 0.8 * LIMITED)
    assert limit.turn < 0.84 * LIMITED


def lean_limit(
    seconds: float,
    *,
    lean: Signal = lambda time: 15.0,
    required: Signal = lambda time: 20.0,
) -> LeanLimit:
    """Return the limit found after a flight. lean, required: flown lean, and lean that the velocity
    requires, at a time (s), deg."""
    limit = LeanLimit()
    for tick in range(round(seconds / STEP) + 1):
        time = tick * STEP
        flown, needed = (GRAVITY * tan(radians(one(time))) for one in (lean, required))
        limit.update(time, STEP, flown, needed)
    return limit


@pytest.mark.parametrize(("seconds", "share"), [(3.7, 1.0), (4.3, 0.95)])
def test_lean_limit_lowers_speed_after_confirmation(seconds: float, share: float) -> None:
    assert lean_limit(seconds).share == pytest.approx(share)


def test_lean_limit_lowers_speed_every_2_seconds_down_to_half() -> None:
    assert lean_limit(9.0).share == pytest.approx(0.95**3)
    assert lean_limit(60.0).share == 0.5


@pytest.mark.parametrize(("swing", "found"), [(1.2, True), (2.4, False)])
def test_lean_limit_tolerates_swings_of_estimated_lean(swing: float, found: bool) -> None:
    limit = lean_limit(10.0, lean=lambda time: 15.0 + swing * sin(pi * time))
    assert (limit.share < 1.0) is found


@pytest.mark.parametrize(("seconds", "share"), [(4.9, 1.0), (5.7, 0.95)])
def test_lean_limit_waits_for_steady_lean(seconds: float, share: float) -> None:
    limit = lean_limit(seconds, lean=lambda time: 15.0 if time > 0 else 10.0)
    assert limit.share == pytest.approx(share)


def test_copter_in_short_gust_is_not_short_of_lean() -> None:
    """Gusts of 0.2 s: the copter leans less, or its velocity requires a larger lean."""
    assert not lean_limit(5.2, lean=lambda time: 15.0 if time < 5 else 12.5, required=level).short
    assert not lean_limit(5.2, required=lambda time: 15.0 if time < 5 else 18.0).short


def level(time: float) -> float:
    """Return a lean of 15 deg."""
    return 15.0


def test_copter_is_short_of_lean_until_required_lean_falls() -> None:
    for seconds, short in ((5.0, True), (7.5, False)):
        limit = lean_limit(seconds, required=lambda time: 20.0 if time < 5 else 15.0)
        assert limit.short is short


def test_lean_7_percent_below_largest_lean_is_no_limit() -> None:
    """The copter leaned 15 deg for 5 s before."""
    for lean, short in ((13.8, False), (14.2, True)):
        limit = lean_limit(15.0, lean=lambda time, lean=lean: 15.0 if time < 5 else lean)
        assert limit.short is short
