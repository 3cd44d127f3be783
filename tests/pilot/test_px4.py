"""What PX4 asks of a pilot: setpoints before its OFFBOARD mode can be entered, and a height that we hold."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot import Phase

OFFBOARD, POSCTL, LOITER, MANUAL, ALTCTL = 6 << 16, 3 << 16, 4 << 16 | 3 << 24, 1 << 16, 2 << 16
ON_GROUND, IN_AIR = 1, 2
SLOW, QUICK = 1.5, 0.0
"""Times that a question and its answer take, s; the mission's bound is 0.6 s."""
KINDS = [
    ("copter", "SET_POSITION_TARGET_LOCAL_NED"),
    ("plane", "MANUAL_CONTROL"),
    ("plane attitude", "SET_ATTITUDE_TARGET"),
]


@pytest.fixture
def px4(make_rig, say):
    """A rig whose vehicle is a PX4, in OFFBOARD, at 104 m above the sea."""

    class Rig(make_rig):
        altitude: float | None = 104.0
        kind, airspeed = 2, float("nan")

        def heartbeat(self):
            self.hear(say.heartbeat(self.mode, armed=self.armed, autopilot=12, kind=self.kind))
            self.hear(mavlink.MAVLink_extended_sys_state_message(0, self.landed_state))
            if self.altitude is not None:
                self.hear(mavlink.MAVLink_vfr_hud_message(self.airspeed, 15.0, 0, 50, self.altitude, 0.0))

    def make(mode=OFFBOARD, kind="copter", **settings):
        rig = Rig(autopilot="px4", kind=kind, **settings)
        rig.mode = mode
        if kind != "copter":
            rig.kind, rig.airspeed = 1, 15.0
        return rig

    return make


@pytest.mark.parametrize(("kind", "message"), KINDS)
def test_nothing_is_streamed_on_the_ground_nor_blind(px4, kind, message):
    """Blind: it stopped telling its height (and a plane its airspeed)."""
    rig = px4(LOITER, kind)
    rig.landed_state = ON_GROUND
    rig.run(5.0)
    assert rig.of(message) == []
    rig.landed_state = IN_AIR
    rig.run(5.0)
    assert rig.of(message) != []
    rig.altitude = None
    rig.run(3.0)
    since = rig.now
    rig.mode = ALTCTL if kind == "plane" else OFFBOARD
    rig.run(3.0)
    assert rig.of(message, since) == []
    assert rig.pilot.phase is Phase.READY
    assert "in VFR_HUD: a px4" in rig.pilot.waits_for(rig.now)
    rig.altitude = 104.0
    rig.run(2.0)
    assert rig.pilot.phase is Phase.ENGAGED


def test_setpoints_flow_before_the_mode_and_ask_for_nothing(px4):
    rig = px4(POSCTL).run(3.0)
    assert rig.pilot.phase is Phase.READY
    assert len(rig.setpoints()) > 20
    assert {(message.vx, message.vz, message.yaw_rate) for message in rig.setpoints()} == {(0.0, 0.0, 0.0)}


def test_a_vehicle_disarmed_by_its_operator_is_sent_nothing_when_it_comes_back_armed_in_offboard(px4):
    """The mission is ready, but nobody has left the mode and entered it since: there is no consent."""
    rig = px4(end_on_takeover=False).engage()
    rig.armed = False
    rig.run(0.3)
    since = rig.now
    rig.run(1.0)
    rig.speaks = False
    rig.run(4.0)
    rig.speaks = rig.armed = True
    rig.run(3.0)
    assert (rig.pilot.phase, rig.pilot.session.vehicle.in_our_mode) == (Phase.READY, True)
    assert rig.setpoints(since) == []


def test_over_a_slow_link_offboard_is_not_made_possible(px4):
    rig = px4(POSCTL)
    rig.round_trip = SLOW
    rig.run(8.0)
    assert rig.pilot.phase is Phase.READY
    assert rig.setpoints() == []
    rig.round_trip = QUICK
    since = rig.now
    rig.run(6.0)
    assert rig.setpoints(since)


def test_a_vehicle_in_offboard_over_a_slow_link_keeps_its_setpoints_and_is_not_steered(px4):
    """They were another's until now; without ours its failsafe would act."""
    rig = px4(OFFBOARD)
    rig.round_trip = SLOW
    rig.run(8.0)
    assert rig.pilot.phase is Phase.READY
    assert len(rig.setpoints()) > 20
    assert {message.vx for message in rig.setpoints()} == {0.0}


def test_each_engagement_holds_the_height_at_which_it_began(px4):
    rig = px4(end_on_takeover=False).engage()
    assert rig.setpoints()[-1].vz == 0.0
    rig.altitude = 105.0
    rig.run(0.5)
    assert rig.setpoints()[-1].vz == pytest.approx(0.5), "1 m too high: down"
    rig.mode = LOITER
    rig.run(1.0)
    rig.mode, rig.altitude = OFFBOARD, 130.0
    since = rig.now
    rig.run(3.0)
    assert rig.pilot.phase is Phase.ENGAGED
    assert {message.vz for message in rig.setpoints(since)} == {0.0}


def test_the_height_to_hold_is_not_that_at_which_the_setpoints_began(px4):
    rig = px4(POSCTL).run(3.0)
    rig.altitude = 120.0
    rig.run(1.0)
    since = rig.now
    rig.mode = OFFBOARD
    rig.run(2.0)
    assert rig.pilot.phase is Phase.ENGAGED
    assert {message.vz for message in rig.setpoints(since)} == {0.0}


@pytest.mark.parametrize("mode", [MANUAL, POSCTL, 7 << 16, 11 << 16])
def test_no_stick_is_streamed_to_a_plane_that_its_pilot_flies_by_stick(px4, mode):
    rig = px4(mode, "plane")
    rig.run(5.0)
    assert rig.pilot.phase is Phase.READY
    assert rig.of("MANUAL_CONTROL") == []


def test_an_airspeed_that_cannot_be_is_told_once_and_only_of_a_vehicle_that_we_steer(px4):
    rig = px4(LOITER, "plane")
    rig.airspeed = 2.0
    tell = rig.heartbeat

    def tells_its_attitude():
        tell()
        rig.hear(mavlink.MAVLink_attitude_message(round(rig.now * 1000), 0.0, 0.0, 0.1 * rig.now, 0.0, 0.0, 0.1))

    rig.heartbeat = tells_its_attitude
    rig.run(10.0)
    assert [text for text in rig.texts() if "airspeed" in text] == []
    rig.mode = ALTCTL
    rig.run(10.0)
    assert rig.pilot.phase is Phase.ENGAGED
    assert [text for text in rig.texts() if "airspeed" in text] == ["circnav: airspeed 2.0 m/s implausible, ignored"]
