"""Responses of the emulated vehicles to steps of the commanded bank and turn rate.

They are compared with real firmware: ArduPilot 4.6.3 and PX4 main of 2026-03 in their own
simulators, at 20 setpoints per second. "Flown" means on this firmware. Times are from the first
setpoint of the step. `path` is the turn rate of the ground track.
"""

import itertools
import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import pytest
from circnav_sim.vehicle import Truth

from tests.sim.station import Station, aboard

TICK = 0.01


class Step(NamedTuple):
    """Times to 50 %, 63 % and 90 % of a step, s; peak, as a multiple of the step (1.1 is an
    overshoot of 10 %), and time of the peak, s."""

    half: float
    most: float
    nearly: float
    peak: float
    peak_at: float


def measured(values: list[float]) -> Step:
    """Return the figures of the step from the first to the last value."""
    share = [(value - values[0]) / (values[-1] - values[0]) for value in values]
    half, most, nearly = (
        next(i for i, s in enumerate(share) if s >= part) * TICK for part in (0.5, 0.632, 0.9)
    )
    return Step(half, most, nearly, max(share), share.index(max(share)) * TICK)


def flown(companion: Station, send: Callable[[], None], seconds: float = 4.0) -> list[Truth]:
    """Return the truth every 10 ms while `send` sends at 20 Hz."""
    start = companion.vehicle.time
    truths = [companion.truth]
    for tick in range(round(seconds / TICK)):
        if tick % 5 == 0:
            send()
        companion.vehicle.advance(start + (tick + 1) * TICK)
        truths.append(companion.truth)
    return truths


def rates(angles: list[float]) -> list[float]:
    return [math.remainder(b - a, math.tau) / TICK for a, b in itertools.pairwise(angles)]


def lead(truth: Truth) -> float:
    """Return the angle of the nose to the right of the ground track, deg."""
    return math.degrees(math.remainder(truth.heading - truth.course, math.tau))


@cache
def banked(before: float, after: float) -> list[Truth]:
    """Return the truth of ArduPlane after a step of the commanded bank, deg. The first bank is held
    for 6 s."""
    companion = aboard("arduplane", "GUIDED")
    companion.repeat(6.0, lambda: companion.attitude(0xC6, math.radians(before)))
    return flown(companion, lambda: companion.attitude(0xC6, math.radians(after)))


@cache
def turned(before: float, after: float) -> list[Truth]:
    """Return the truth of ArduCopter at 5 m/s after a step of the commanded turn rate, rad/s. The
    acceleration of the turn is fed forward."""
    real = {"dynamics": "realistic", "max_turn_rate_deg_s": 200.0}
    companion = aboard(mode="GUIDED", vehicle=real, start={"speed_mps": 5.0})
    companion.repeat(8.0, lambda: companion.turn(5.0, before))
    return flown(companion, lambda: companion.turn(5.0, after))


@pytest.mark.parametrize(("before", "after"), [(0.0, 20.0), (17.0, -28.6)])
def test_plane_bank_has_dead_time_and_overshoot(before, after):
    """Flown: 50 % after 0.36 to 0.5 s, 90 % after 0.5 to 0.75 s, overshoot 15 %. In the step from
    +17 to -28.6 deg the bank reached -33 deg."""
    truths = banked(before, after)
    roll = measured([truth.roll for truth in truths])
    assert all(truth.roll == pytest.approx(truths[0].roll, abs=1e-6) for truth in truths[:16])
    assert 0.36 <= roll.half <= 0.5 and 0.5 <= roll.nearly <= 0.75
    assert roll.peak == pytest.approx(1.12, abs=0.04)


def test_plane_ground_track_turns_before_its_nose():
    """Flown: the ground track turns with the bank. Because of side-slip, the heading follows 0.15
    to 0.25 s later."""
    truths = banked(17.0, -28.6)
    roll = measured([truth.roll for truth in truths])
    path = measured(rates([truth.course for truth in truths]))
    nose = measured([truth.turn_rate for truth in truths])
    assert path.half == pytest.approx(roll.half, abs=0.03)
    assert 0.15 <= nose.half - path.half <= 0.28 and 0.15 <= nose.nearly - path.nearly <= 0.28
    # during the change of bank the slip angle differs from its steady value by more than 2 deg
    assert max(abs(lead(truth) - lead(truths[-1])) for truth in truths) > 2.0


@pytest.mark.parametrize(("bank", "slip"), [(14.0, 1.1), (26.0, 2.2), (42.0, 3.8)])
def test_plane_slips_to_inside_of_its_turn(bank, slip):
    """Flown: a slip of 4.70 tan(bank) - 0.54 tan(bank)^2 deg, in steady turns and in a wind of 8
    m/s, in which the bank varies."""
    assert lead(banked(bank, bank)[-1]) == pytest.approx(-slip, abs=0.3)


def test_copter_yaw_rate_has_dead_time_and_overshoot():
    """Flown, step from 0.2 to -0.4 rad/s: yaw rate 0 after 0.25 s and -0.53 rad/s after 0.64 s. The
    closed loop has a dead time of 0.22 s and a lag of 0.18 s."""
    truths = turned(0.2, -0.4)
    yaw = measured([truth.turn_rate for truth in truths])
    assert all(
        truth.turn_rate == pytest.approx(truths[0].turn_rate, abs=1e-3) for truth in truths[:15]
    )
    assert next(i for i, truth in enumerate(truths) if truth.turn_rate < 0) * TICK == pytest.approx(
        0.25, abs=0.07
    )
    assert yaw.half == pytest.approx(0.22 + 0.18 * math.log(2), abs=0.03)
    assert (yaw.peak, yaw.peak_at) == (pytest.approx(1.2, abs=0.03), pytest.approx(0.64, abs=0.04))
    assert truths[-1].turn_rate == pytest.approx(-0.42, abs=0.03)


def test_copter_ground_track_lags_its_nose():
    """Flown: the turn rate of the ground track has half of the step after 0.7 to 0.78 s and 90 %
    after 1.1 s, later than the nose."""
    truths = turned(0.2, -0.4)
    path = measured(rates([truth.course for truth in truths]))
    assert path.half == pytest.approx(0.74, abs=0.05) and path.nearly == pytest.approx(
        1.1, abs=0.06
    )
    assert min(lead(truth) for truth in truths) < -8.0


def test_px4_copter_yaw_rate_step_matches_firmware():
    companion = aboard("px4_copter")
    companion.fly(0.5, 0.0, 0.0)
    companion.set_mode(6)
    companion.fly(10.0, 5.0, 0.0)
    truths = flown(companion, lambda: companion.velocity(5.0, 0.1), 60.0)
    assert measured([truth.turn_rate for truth in truths]).most == pytest.approx(0.475, abs=0.03)
    assert all(truth.turn_rate == 0.0 for truth in truths[:10])
    # flown at a radius of 50 m: 4.56 m/s, course 7 to 9 deg behind the nose
    assert truths[-1].ground_speed == pytest.approx(4.56, abs=0.05)
    assert lead(truths[-1]) == pytest.approx(9.0, abs=3.0)


def test_px4_plane_bank_step_matches_firmware():
    """Flown: 63 % of the step after 0.6 to 0.7 s, without overshoot or steady error."""
    companion = aboard("px4_plane")
    companion.sticks(0.0)
    assert companion.set_mode(2) == [0, 0]
    companion.repeat(3.0, lambda: companion.sticks(0.0))
    truths = flown(companion, lambda: companion.sticks(30.0 / 50.0))
    roll = measured([truth.roll for truth in truths])
    assert 0.58 <= roll.most <= 0.70 and roll.peak < 1.02
    assert math.degrees(truths[-1].roll) == pytest.approx(30.0, abs=0.1)


def test_attitude_reports_heading_in_slipping_turn():
    """Yaw and body rates in ATTITUDE are consistent with each other. Yaw differs from the course by
    the slip angle."""
    companion = aboard("arduplane", "GUIDED")
    companion.stream(30, 40_000)
    companion.repeat(4.0, lambda: companion.attitude(0xC6, math.radians(-20.0)))
    companion.forget()
    companion.repeat(3.0, lambda: companion.attitude(0xC6, math.radians(35.0)))
    reports = companion.listen("ATTITUDE")
    for a, b in itertools.pairwise(reports):
        rates_reported = [
            (m.pitchspeed * math.sin(m.roll) + m.yawspeed * math.cos(m.roll)) / math.cos(m.pitch)
            for m in (a, b)
        ]
        seen = math.remainder(b.yaw - a.yaw, math.tau) / ((b.time_boot_ms - a.time_boot_ms) / 1000)
        assert seen == pytest.approx(sum(rates_reported) / 2, abs=0.02)
    truth = companion.truth
    assert reports[-1].yaw == pytest.approx(truth.heading, abs=0.02) and abs(lead(truth)) > 1.5
