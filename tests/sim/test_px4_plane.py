"""PX4's fixed wing as flown: sticks with height and speed held, or attitude and thrust with nothing held."""

import math
from typing import Any

import pytest

from sim.autopilots.modes import PX4
from tests.sim.station import Station, build

G = 9.80665


def plane(**tables: Any) -> Any:
    vehicle = {"profile": "px4_plane", "default_streams": False}
    exact = {"attitude_error_deg": 0.0, "gyro_noise_deg_s": 0.0}
    return Station(build(vehicle=vehicle, sensors=exact, truth={"rate_hz": 0}, ranging={"rate_hz": 0.0}, **tables))


@pytest.mark.parametrize("mode", ["ALTCTL", "ALT_CRUISE"])
@pytest.mark.parametrize(("stick", "bank", "rate"), [(0.3, 15.0, 0.261), (0.6, 30.0, 0.550), (-0.6, -30.0, -0.550)])
def test_the_roll_stick_banks_and_height_and_speed_are_held(mode: str, stick: float, bank: float, rate: float) -> None:
    companion = plane()
    companion.sticks(0.0)
    assert companion.command(176, 1, PX4[mode] >> 16) == [0, 0]
    companion.repeat(20.0, lambda: companion.sticks(stick))
    truth = companion.vehicle.truth
    assert math.degrees(truth.roll) == pytest.approx(bank, abs=0.1)
    assert truth.turn_rate == pytest.approx(rate, rel=0.035)
    assert truth.down == pytest.approx(-100.0, abs=0.6) and truth.airspeed == pytest.approx(10.0, abs=0.2)


def test_sticks_lost_hold_then_return_and_do_not_come_back() -> None:
    companion = plane()
    companion.sticks(0.0)
    companion.command(176, 1, 2)
    companion.repeat(2.0, lambda: companion.sticks(0.3))
    companion.wait(0.6)
    assert companion.vehicle.truth.mode == PX4["LOITER"]
    companion.repeat(3.0, lambda: companion.sticks(0.3))
    assert companion.vehicle.truth.mode == PX4["LOITER"]
    companion.repeat(3.0, lambda: companion.sticks(0.3))
    assert companion.vehicle.truth.mode == PX4["RTL"]


HOLD, OFFBOARD_TOO = 2, 4  # bits of COM_RCL_EXCEPT
LOITER, LAND, ALTCTL, OFFBOARD = (4, 3), (4, 6), (2, 0), (6, 0)


def after_the_sticks_end(left_in: tuple[int, int], **parameters: float) -> tuple[Any, list[str]]:
    """A plane that had sticks for two seconds and is left in a mode without them, and where it is then: at once, while
    it may hold, and in the end."""
    companion = plane()
    companion.heartbeat(6)
    for name, value in parameters.items():
        companion.vehicle._flight.autopilot.params[name] = value
    names = {number: name for name, number in PX4.items()}
    companion.sticks(0.0)
    assert companion.command(176, 1, *ALTCTL) == [0, 0]
    companion.repeat(2.0, lambda: (companion.sticks(0.3), companion.attitude(7, thrust=0.63)))
    assert companion.command(176, 1, *left_in) == [0, 0]
    seen = []
    for seconds in (0.3, 1.0, 5.0):
        companion.repeat(seconds, lambda: companion.attitude(7, thrust=0.63))
        seen.append(names[companion.vehicle.truth.mode])
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
def test_sticks_that_were_heard_once_are_missed_in_every_mode_that_is_not_excepted(
    left_in: tuple[int, int], parameters: dict[str, float], seen: list[str]
) -> None:
    assert after_the_sticks_end(left_in, **parameters)[1] == seen


def test_the_loss_of_sticks_is_told_and_a_mode_chosen_afterwards_lasts() -> None:
    companion, seen = after_the_sticks_end(LOITER)
    assert companion.texts() == ["Failsafe activated: entering Hold for 5 seconds", "Failsafe activated"]
    assert companion.command(176, 1, *LOITER) == [0, 0]
    companion.wait(30.0)
    assert (seen[-1], companion.vehicle.truth.mode) == ("RTL", PX4["LOITER"])


def test_sticks_never_heard_and_sticks_silent_at_arming_are_not_missed() -> None:
    companion = plane()
    companion.wait(10.0)
    assert companion.vehicle.truth.mode == PX4["LOITER"]
    companion.command(400, 0, 21196)
    companion.sticks(0.0)
    companion.wait(1.0)
    assert companion.command(400, 1, 21196) == [0]
    companion.wait(10.0)
    assert companion.vehicle.truth.mode == PX4["LOITER"]


def test_a_velocity_alone_is_taken_and_has_no_effect() -> None:
    companion = plane()
    companion.velocity(10.0, 0.3)
    assert companion.command(176, 1, 6) == [0, 0]
    companion.wait(0.5)
    companion.fly(5.0, 10.0, 0.3)
    truth = companion.vehicle.truth
    assert truth.mode == PX4["OFFBOARD"] and abs(truth.turn_rate) < 0.01 and truth.down == pytest.approx(-100, abs=0.2)


def test_a_position_is_flown_to_at_0835_sin_eta() -> None:
    from pymavlink.dialects.v20 import all as mavlink

    companion = plane()
    angle = math.asin(0.2 / 0.835)

    def carrot() -> None:
        truth = companion.vehicle.truth
        north, east = (
            truth.north + 80 * math.cos(truth.course + angle),
            truth.east + 80 * math.sin(truth.course + angle),
        )
        companion.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, 3576, north, east, -100, 0, 0, 0, 0, 0, 0, 0, 0
            )
        )

    carrot()
    assert companion.command(176, 1, 6) == [0, 0]
    companion.repeat(15.0, carrot)
    assert companion.vehicle.truth.turn_rate == pytest.approx(0.2, rel=0.05)


def loops(companion: Any, bank: float) -> None:
    """The height and airspeed loops that held +-1 m and 10.0 m/s in flight."""
    truth = companion.vehicle.truth
    climb = (companion.last_down - truth.down) * 20 if hasattr(companion, "last_down") else 0.0
    companion.last_down = truth.down
    below = truth.down + 100.0
    pitch = 0.02 * below - 0.04 * climb
    thrust = 0.63 + 0.08 * (10.0 - truth.airspeed) + 0.25 * (1 / math.cos(bank) - 1)
    companion.attitude(7, bank, pitch, 0.0, thrust=max(0.0, min(1.0, thrust)))


@pytest.mark.parametrize("bank", [0.0, 10.0, 20.0, 30.0, -40.0])
def test_attitude_setpoints_turn_exactly_and_a_clients_own_loops_hold_height_and_speed(bank: float) -> None:
    companion = plane()
    companion.attitude(7, thrust=0.63)
    assert companion.command(176, 1, 6) == [0, 0]
    companion.repeat(40.0, lambda: loops(companion, math.radians(bank)))
    truth = companion.vehicle.truth
    assert math.degrees(truth.roll) == pytest.approx(bank, abs=0.05)
    assert truth.turn_rate == pytest.approx(G * math.tan(math.radians(bank)) / 10, rel=0.02, abs=1e-3)
    assert truth.airspeed == pytest.approx(10.0, abs=0.3) and truth.down == pytest.approx(-100.0, abs=2.5)


def test_without_loops_nothing_holds_the_height() -> None:
    companion = plane()
    companion.attitude(7, thrust=0.63)
    companion.command(176, 1, 6)
    companion.repeat(30.0, lambda: companion.attitude(7, math.radians(40.0), thrust=0.63))
    assert companion.vehicle.truth.down > -95.0


def test_no_throttle_is_no_thrust() -> None:
    companion = plane()
    companion.attitude(7, thrust=0.63)
    companion.command(176, 1, 6)
    companion.repeat(15.0, lambda: companion.attitude(7 | 64, thrust=0.63))
    companion.command(511, 33, 100_000)
    companion.repeat(1.0, lambda: companion.attitude(7 | 64))
    last = companion.listen("GLOBAL_POSITION_INT")[-1]
    path = math.degrees(math.atan2(last.vz, math.hypot(last.vx, last.vy)))
    assert path == pytest.approx(27.0, abs=3.0)  # flown: -27 deg


def test_a_reposition_is_circled_at_its_height_and_the_speed_asked_for() -> None:
    """200 m east of home and 120 m above it; the radius is NAV_LOITER_RAD."""
    companion = plane()
    east = 149.1652374 + math.degrees(200 / (6_378_137 * math.cos(math.radians(35.3632621))))
    assert companion.command(178, 0, 12.0, -1) == [0]
    assert companion.command(192, -1, 1, 0, math.nan, -35.3632621, east, 584.0 + 120.0) == [0]
    companion.wait(150.0)
    truth = companion.vehicle.truth
    assert math.hypot(truth.north, truth.east - 200.0) == pytest.approx(80.0, abs=8.0)
    assert (truth.down, truth.airspeed) == (pytest.approx(-120.0, abs=0.5), pytest.approx(12.0, abs=0.2))
