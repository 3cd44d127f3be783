"""ArduPlane 4.6.3 as flown: banks for three seconds, height and airspeed its own affair."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.sim.station import Station, build

ROLL_ONLY = 0xC6


def plane(**tables: Any) -> Any:
    tables["vehicle"] = {"profile": "arduplane", **tables.get("vehicle", {})}
    tables["start"] = {"mode": "GUIDED", **tables.get("start", {})}
    exact = {"attitude_error_deg": 0.0}
    return Station(build(**{"truth": {"rate_hz": 0}, "ranging": {"rate_hz": 0.0}, "sensors": exact, **tables}))


@pytest.mark.parametrize(("rate", "flown"), [(0.1, 0.0692), (0.2, 0.1385), (-0.3, -0.208)])
def test_a_coordinated_bank_turns_at_three_quarters_of_the_rate(rate: float, flown: float) -> None:
    companion = plane()
    companion.repeat(15.0, lambda: companion.attitude(ROLL_ONLY, math.atan(rate * 22 / 9.80665)), 10.0)
    assert companion.vehicle.truth.turn_rate == pytest.approx(flown, rel=0.03)
    assert companion.vehicle.truth.down == pytest.approx(-100.0, abs=0.25)


def test_turn_effectiveness_is_the_share_of_the_coordinated_rate() -> None:
    companion = plane(vehicle={"turn_effectiveness": 1.0, "airspeed_scale": 1.0})
    companion.repeat(10.0, lambda: companion.attitude(ROLL_ONLY, 0.4))
    assert companion.vehicle.truth.turn_rate == pytest.approx(9.80665 * math.tan(0.4) / 22, rel=0.01)


def test_the_shown_airspeed_is_indicated_not_true() -> None:
    companion = plane()
    companion.command(511, 74, 100_000)
    companion.wait(1.0)
    assert companion.listen("VFR_HUD")[-1].airspeed == pytest.approx(22.0, abs=0.1)
    assert companion.vehicle.truth.airspeed == pytest.approx(23.43, abs=0.1)


def test_silence_of_three_seconds_sends_it_back_to_its_loiter_banking_hard() -> None:
    companion = plane()
    companion.repeat(20.0, lambda: companion.attitude(ROLL_ONLY, 0.0))
    companion.wait(2.9)
    assert abs(companion.vehicle.truth.roll) < 0.01
    companion.wait(3.0)
    assert math.degrees(abs(companion.vehicle.truth.roll)) > 35.0
    assert companion.texts() == [] and companion.vehicle.truth.mode == 15
    companion.wait(120.0)
    truth = companion.vehicle.truth
    assert math.hypot(truth.north + 200.0, truth.east) == pytest.approx(60.0, abs=15.0)  # where GUIDED was entered


@pytest.mark.parametrize(
    ("mask", "held"), [(0xC6, True), (0xFE, True), (0xC7, None), (0x47, False), (0x46, False), (0xC0, False)]
)
def test_the_mask_says_what_is_forced(mask: int, held: bool | None) -> None:
    companion = plane(start={"mode": "GUIDED"})
    companion.repeat(8.0, lambda: companion.attitude(mask, 0.2, math.radians(2.0)))
    if held is None:
        assert companion.vehicle.setpoint_log == []
        return
    climbed = -companion.vehicle.truth.down - 100.0
    assert companion.vehicle.truth.roll == pytest.approx(0.2, abs=0.01)
    assert (abs(climbed) < 0.3) if held else (4.0 < climbed < 8.0)  # 2 deg of pitch: 7 m in 8 s


def test_the_bank_is_limited_by_the_parameter_and_echoed() -> None:
    companion = plane(vehicle={"max_bank_deg": 45.0})
    companion.command(511, 62, 200_000)
    companion.repeat(5.0, lambda: companion.attitude(ROLL_ONLY, 1.2))
    assert math.degrees(companion.vehicle.truth.roll) == pytest.approx(45.0, abs=0.1)
    assert companion.listen("NAV_CONTROLLER_OUTPUT")[-1].nav_roll == pytest.approx(45.0, abs=0.1)


def test_local_position_targets_are_ignored() -> None:
    companion = plane(start={"mode": "LOITER"})
    companion.velocity(22.0, 0.2)
    companion.attitude(ROLL_ONLY, 0.2)
    assert companion.vehicle.setpoint_log == []
    companion.command(512, 148)
    assert not companion.listen("AUTOPILOT_VERSION")[0].capabilities & 128


def test_wind_drifts_the_plane_but_not_its_airspeed() -> None:
    companion = plane(wind={"speed_mps": 8.0, "from_deg": 270.0})
    speeds = []
    for _ in range(120):
        companion.repeat(0.5, lambda: companion.attitude(ROLL_ONLY, 0.3), 10.0)
        speeds.append(companion.vehicle.truth.ground_speed)
        assert companion.vehicle.truth.airspeed == pytest.approx(23.43, abs=0.1)
    assert (min(speeds), max(speeds)) == pytest.approx((15.4, 31.4), abs=0.5)  # flown: 15.7 .. 31.1


def test_a_commanded_heading_is_held_without_a_timeout() -> None:
    companion = plane()
    assert companion.command(43002, 1, 360.0) == [2] and companion.command(43002, 2, 90.0) == [2]
    assert companion.command(43002, 1, 90.0, 3.0) == [0]
    companion.wait(60.0)
    assert companion.vehicle.truth.heading == pytest.approx(math.pi / 2, abs=0.02)
    assert companion.command(43000, 0, 26.0) == [0] and companion.command(43000, 1, 26.0) == [2]
    companion.wait(20.0)
    assert companion.vehicle.truth.airspeed == pytest.approx(26.0 * 1.065, rel=0.01)


def test_only_its_own_ground_station_moves_the_sticks() -> None:
    vehicle = plane(start={"mode": "FBWB"}).vehicle
    companion, pilot = Station(vehicle), Station(vehicle, 255, 190, link="gcs")
    companion.repeat(3.0, lambda: companion.sticks(0.37))
    assert vehicle.truth.roll == 0.0
    pilot.repeat(3.0, lambda: pilot.sticks(0.37))
    assert math.degrees(vehicle.truth.roll) == pytest.approx(24.05, abs=0.3)
    pilot.wait(6.0)
    assert abs(vehicle.truth.roll) < 0.01  # RC_OVERRIDE_TIME
    override = mavlink.MAVLink_rc_channels_override_message(1, 1, 1685, *[65535] * 7)
    pilot.repeat(3.0, lambda: pilot.send(override))
    assert math.degrees(vehicle.truth.roll) == pytest.approx(24.05, abs=0.3)


def test_it_streams_without_being_asked() -> None:
    companion = plane()
    companion.wait(3.0)
    assert {"ATTITUDE", "VFR_HUD", "GLOBAL_POSITION_INT"} <= {m.get_type() for m in companion.listen()}
    assert companion.command(511, 30, 10_000) == [2]  # not above its 50 Hz loop's 40


def test_without_gps_it_flies_on() -> None:
    companion = plane(events=[{"at_s": 5.0, "action": "gps_off"}])
    companion.repeat(60.0, lambda: companion.attitude(ROLL_ONLY, 0.3), 5.0)
    assert companion.vehicle.truth.mode == 15 and companion.vehicle.truth.roll == pytest.approx(0.3, abs=0.01)
    assert companion.command(176, 1, 12) == [0]


def test_a_change_of_speed_is_flown_within_the_airspeed_limits() -> None:
    companion = Station(build(vehicle={"profile": "arduplane"}, start={"mode": "LOITER"}))
    assert companion.command(178, 0, 25.0, -1) == [0]
    companion.wait(20.0)
    assert companion.vehicle.truth.airspeed == pytest.approx(25.0 * 1.065, abs=0.1)
    assert companion.command(178, 0, 60.0, -1) == [4] and companion.command(43000, 0, 20.0) == [4]
