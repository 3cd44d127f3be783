"""The height above the target, from the mission and the vehicle's altitude."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.own_motion import Motion
from circnav_mav.pilot import OutputMode
from circnav_mav.pilot.height import Height
from circnav_mav.pilot.mission_state import Phase
from tests.rig import rig_mission, vfr_hud

FIXED = "height_above_target_m=60.0"
ABSOLUTE = "target_altitude_m=500.0"
FROM_HOME = "target_above_home_m=-4.0"


def home(altitude, latitude=473_000_000, x=0.0):
    return mavlink.MAVLink_home_position_message(
        latitude, 85_000_000, round(1000 * altitude), x, -x, x, [1, 0, 0, 0], 0, 0, 0
    )


class Climb:
    """A height that receives an altitude every 0.2 s."""

    def __init__(self, given):
        self.height = Height(rig_mission(f"orbit.{given}").file.orbit)
        self.now = 0.0

    def at(self, altitude):
        self.now += 0.2
        self.height.receive(vfr_hud(altitude), Motion(altitude=altitude), self.now)
        return self.height.at(self.now)


def test_mission_height_changes_with_altitude_after_engagement():
    """The height of the mission, 60 m, is the height at the engagement. Earlier altitudes have no
    effect."""
    climb = Climb(FIXED)
    assert [climb.at(100.0), climb.at(103.0)] == [60.0, 60.0]
    climb.height.engage()
    assert [climb.at(105.0), climb.at(107.5), climb.at(104.0)] == [60.0, 62.5, 59.0]
    climb.height.engage()  # after a takeover, the vehicle is returned at a greater height
    assert climb.at(108.0) == 63.0
    climb.now += 3.0  # a descent of 30 m in a gap of 3 s between reports is not a jump
    assert climb.at(78.0) == 33.0


def test_height_is_unknown_without_fresh_vehicle_altitude():
    climb = Climb(ABSOLUTE)
    assert climb.height.at(0.0) is None
    assert climb.height.why_unknown(0.0).startswith("no altitude (VFR_HUD.alt)")
    assert climb.at(530.0) == 30.0
    assert climb.height.why_unknown(climb.now) == ""
    assert climb.height.at(climb.now + 2.0) is None


def test_home_position_changes_height_only_before_engagement():
    climb = Climb(FROM_HOME)
    assert climb.at(560.0) is None
    for altitude in (0.0, 504.0):
        climb.height.receive(home(altitude), Motion(), climb.now)
    assert climb.at(560.0) == 60.0
    climb.height.engage()
    climb.height.receive(home(530.0), Motion(), climb.now)
    assert climb.at(561.0) == 61.0


def test_last_height_is_held_in_flight_without_altitude():
    climb = Climb(ABSOLUTE)
    climb.height.engage()
    assert climb.at(562.0) == climb.height.at(climb.now + 60.0) == 62.0
    assert climb.height.is_held(climb.now) is False
    assert climb.height.is_held(climb.now + 2.0) is True


@pytest.mark.parametrize(
    ("message", "accepted"),
    [(vfr_hud(float("nan")), None), (vfr_hud(1e9), None), (home(530.0), 562.0)],
)
def test_height_stays_held_after_message_without_valid_altitude(message, accepted):
    """`accepted` is an earlier altitude of VFR_HUD, which is passed again with a message that has
    no valid altitude."""
    climb = Climb(FIXED)
    climb.height.engage()
    assert [climb.at(560.0), climb.at(562.0)] == [60.0, 62.0]
    for step in range(10):
        climb.height.receive(message, Motion(altitude=accepted), climb.now + 0.2 * step)
    assert climb.height.at(climb.now + 2.0) == 62.0
    assert climb.height.is_held(climb.now + 2.0)
    assert climb.at(563.0) == 63.0


def test_height_ignores_altitude_jump_and_glitch():
    """A change of 4 m in 0.2 s is accepted, and a change of 5 m or more is a jump. No vehicle
    climbs so fast, but a reset of the altitude estimate jumps."""
    climb = Climb(ABSOLUTE)
    # altitude before the home position was set on the ground
    assert [climb.at(0.0), climb.at(530.0)] == [-500.0, 30.0]
    climb.height.engage()
    assert [climb.at(534.0), climb.at(560.0), climb.at(561.0)] == [34.0, 34.0, 35.0]
    assert climb.height.jump == 26.0
    assert [climb.at(535.0), climb.at(535.5)] == [35.0, 35.5]
    assert climb.height.jump == 0.0


def test_height_accepts_altitude_that_returns_after_jump():
    """In turbulence ArduPlane 4.6.3 reported an altitude that fell by 5.2 m in 0.2 s and returned
    within 2 s. When this was treated as a reset, the circle was 2 m too wide."""
    climb = Climb(ABSOLUTE)
    climb.height.engage()
    assert [climb.at(573.0), climb.at(567.8)] == [73.0, 73.0]
    for step in range(20):
        climb.at(567.8 + min(0.6 * step, 4.6))
    assert climb.at(572.4) == pytest.approx(72.4)
    assert climb.height.jump == 0.0


def test_home_position_without_altitude_has_no_effect(make_rig):
    """Only the altitude of HOME_POSITION may affect the guidance, because the guidance uses no
    positions."""
    rigs = [make_rig(f"orbit.{FROM_HOME}"), make_rig(f"orbit.{FROM_HOME}")]
    for rig, place in zip(rigs, ((473_000_000, 0.0), (-10_000_000, 1e6)), strict=True):

        def report(rig=rig, place=place):
            rig.receive(vfr_hud(560.0))
            rig.receive(home(504.0, *place))

        assert rig.run(4.0, report).pilot.mission.phase is Phase.ENGAGED
        assert rig.pilot.tracker.height.at(rig.now) == 60.0
    assert rigs[0].raw == rigs[1].raw


@pytest.mark.parametrize(
    ("output_mode", "expected"), [(OutputMode.FLY, 88.0), (OutputMode.DRY_RUN, 60.0)]
)
def test_dry_run_keeps_mission_height(make_rig, output_mode, expected):
    rig = make_rig(f"orbit.{FIXED}", output_mode=output_mode)
    for second in range(60):
        rig.run(0.5)
        rig.receive(vfr_hud(500.0 + max(0, second - 30)))
    assert rig.pilot.mission.phase is Phase.ENGAGED
    records = rig.pilot.take_records()
    assert records[-1].height == pytest.approx(expected, abs=1.01)
    assert records[-1].measured == pytest.approx(
        (150.0**2 - records[-1].height ** 2) ** 0.5, abs=0.5
    )
