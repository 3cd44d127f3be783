"""The emulated PX4 plane, with figures from flights of PX4. By stick it holds height and speed; by
attitude and thrust at which the plane keeps its airspeed it holds neither."""

import math

import pytest
from circnav_sim.autopilots.modes import PX4

from tests.sim.station import aboard

G = 9.80665
TRIM = 0.63  # thrust
LOITER = (4, 3)
LAND = (4, 6)
ALTCTL = (2, 0)
OFFBOARD = (6, 0)


def plane(**tables):
    return aboard("px4_plane", vehicle={"airspeed_scale": 1.0}, **tables)


def offboard():
    companion = plane()
    companion.attitude(7, thrust=TRIM)
    assert companion.set_mode(*OFFBOARD) == [0, 0]
    return companion


@pytest.mark.parametrize(
    ("held_in", "stick", "bank", "rate"),
    [
        ("ALTCTL", 0.3, 15.0, 0.261),
        ("ALTCTL", -0.6, -30.0, -0.550),
        ("ALT_CRUISE", 0.6, 30.0, 0.550),
    ],
)
def test_px4_plane_banks_by_roll_stick_at_constant_height(held_in, stick, bank, rate):
    companion = plane()
    companion.sticks(0.0)
    assert companion.set_mode(PX4[held_in] >> 16) == [0, 0]
    companion.repeat(20.0, lambda: companion.sticks(stick))
    truth = companion.truth
    assert math.degrees(truth.roll) == pytest.approx(bank, abs=0.1)
    assert truth.turn_rate == pytest.approx(rate, rel=0.035)
    assert truth.down == pytest.approx(-100.0, abs=0.6) and truth.airspeed == pytest.approx(
        10.0, abs=0.2
    )


def test_px4_plane_without_sticks_loiters_then_flies_home():
    companion = plane()
    companion.sticks(0.0)
    companion.set_mode(*ALTCTL)
    companion.repeat(2.0, lambda: companion.sticks(0.3))
    companion.wait(0.6)
    for after in ("LOITER", "LOITER", "RTL"):
        assert companion.px4_mode == after
        companion.repeat(3.0, lambda: companion.sticks(0.3))


# bits of COM_RCL_EXCEPT: modes that are excepted from the failsafe for stick loss
HOLD = 2
OFFBOARD_TOO = 4


def after_the_sticks_end(left_in, **parameters):
    """Return a plane that received sticks for 2 s and none afterwards, in the mode `left_in`, and
    its later modes: after 0.3 s, during the hold time, and after it."""
    companion = plane()
    companion.heartbeat(6)
    companion.vehicle._flight.autopilot.params.update(parameters)
    companion.sticks(0.0)
    assert companion.set_mode(*ALTCTL) == [0, 0]
    companion.repeat(2.0, lambda: (companion.sticks(0.3), companion.attitude(7, thrust=TRIM)))
    assert companion.set_mode(*left_in) == [0, 0]
    seen = []
    for seconds in (0.3, 1.0, 5.0):
        companion.repeat(seconds, lambda: companion.attitude(7, thrust=TRIM))
        seen.append(companion.px4_mode)
    return companion, seen


@pytest.mark.parametrize(
    ("left_in", "parameters", "seen"),
    [
        (LOITER, {}, ["LOITER", "LOITER", "RTL"]),
        (LOITER, {"COM_RCL_EXCEPT": HOLD}, ["LOITER", "LOITER", "LOITER"]),
        (LOITER, {"NAV_RCL_ACT": 1}, ["LOITER", "LOITER", "LOITER"]),
        (LOITER, {"NAV_RCL_ACT": 3}, ["LOITER", "LOITER", "LAND"]),
        (LOITER, {"COM_FAIL_ACT_T": 0.0}, ["LOITER", "RTL", "RTL"]),
        (ALTCTL, {"COM_RCL_EXCEPT": HOLD}, ["ALTCTL", "LOITER", "RTL"]),
        (LAND, {}, ["LAND", "LAND", "LAND"]),
        (OFFBOARD, {}, ["OFFBOARD", "LOITER", "RTL"]),
        (OFFBOARD, {"COM_RCL_EXCEPT": OFFBOARD_TOO}, ["OFFBOARD", "OFFBOARD", "OFFBOARD"]),
    ],
)
def test_stick_loss_failsafe_follows_mode_and_parameters(left_in, parameters, seen):
    assert after_the_sticks_end(left_in, **parameters)[1] == seen


def test_mode_selected_after_stick_loss_is_kept():
    companion, seen = after_the_sticks_end(LOITER)
    assert companion.texts() == [
        "Failsafe activated: entering Hold for 5 seconds",
        "Failsafe activated",
    ]
    assert companion.set_mode(*LOITER) == [0, 0]
    companion.wait(30.0)
    assert (seen[-1], companion.px4_mode) == ("RTL", "LOITER")


def test_stick_loss_failsafe_needs_earlier_sticks_and_configured_action():
    companion = plane()
    companion.sticks(0.0)
    companion.wait(1.0)
    companion.vehicle._flight.autopilot.params["NAV_RCL_ACT"] = 0  # set while the plane is in Hold
    companion.wait(10.0)
    assert companion.px4_mode == "LOITER"
    companion = plane()
    companion.wait(10.0)
    assert companion.px4_mode == "LOITER"
    companion.command(400, 0, 21196)
    companion.sticks(0.0)
    companion.wait(1.0)
    assert companion.command(400, 1, 21196) == [0]
    companion.wait(10.0)
    assert companion.px4_mode == "LOITER"


def test_velocity_setpoint_has_no_effect_on_plane():
    companion = plane()
    companion.velocity(10.0, 0.3)
    assert companion.set_mode(*OFFBOARD) == [0, 0]
    companion.fly(5.0, 10.0, 0.3)
    truth = companion.truth
    assert companion.px4_mode == "OFFBOARD" and abs(truth.turn_rate) < 0.01
    assert truth.down == pytest.approx(-100, abs=0.2)
