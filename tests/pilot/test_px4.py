"""Requirements of PX4: setpoints must be sent before OFFBOARD can be entered, and circnav must hold
the height."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot import Phase
from circnav_mav.pilot.status_text import waits_for
from tests.rig import Rig, attitude, heartbeat, vfr_hud

OFFBOARD = 6 << 16
POSCTL = 3 << 16
LOITER = 4 << 16 | 3 << 24
MANUAL = 1 << 16
ALTCTL = 2 << 16
ON_GROUND = 1
IN_AIR = 2
KINDS = [
    ("copter", "SET_POSITION_TARGET_LOCAL_NED"),
    ("plane", "MANUAL_CONTROL"),
]


class PX4(Rig):
    """A rig with a PX4 vehicle at 104 m above sea level."""

    def __init__(self, mode: int = OFFBOARD, kind: str = "copter", then: str = "end") -> None:
        keys = ("vehicle.autopilot=px4", f"vehicle.kind={kind}", f"engage.on_takeover={then}")
        super().__init__(*keys)
        self.mode = mode
        self.altitude = 104.0
        self.kind, self.airspeed = (2, float("nan")) if kind == "copter" else (1, 15.0)

    def heartbeat(self):
        self.receive(heartbeat(self.mode, armed=self.armed, autopilot=12, kind=self.kind))
        self.receive(mavlink.MAVLink_extended_sys_state_message(0, self.landed_state))
        if self.altitude is not None:
            self.receive(vfr_hud(self.altitude, self.airspeed))


@pytest.mark.parametrize(("kind", "message"), KINDS)
def test_px4_setpoint_stream_needs_airborne_vehicle_with_altitude(kind, message):
    """At first the vehicle reports no altitude, and a plane no airspeed: no setpoints are sent."""
    rig = PX4(LOITER, kind)
    assert rig.run(5.0, landed_state=ON_GROUND).of(message) == []
    assert rig.run(5.0, landed_state=IN_AIR).of(message) != []
    since = rig.run(3.0, altitude=None).now
    rig.run(3.0, mode=ALTCTL if kind == "plane" else OFFBOARD)
    assert rig.of(message, since) == []
    assert rig.pilot.mission.phase is Phase.READY
    assert "in VFR_HUD: a px4" in waits_for(rig.pilot, rig.now)
    assert rig.run(2.0, altitude=104.0).pilot.mission.phase is Phase.ENGAGED


def test_px4_setpoints_before_offboard_have_zero_velocity():
    rig = PX4(POSCTL).run(3.0)
    assert rig.pilot.mission.phase is Phase.READY
    assert len(rig.setpoints()) > 20
    assert {(message.vx, message.vz, message.yaw_rate) for message in rig.setpoints()} == {
        (0.0, 0.0, 0.0)
    }


def test_no_setpoints_to_vehicle_rearmed_in_offboard():
    """The mission is ready, but the operator has not left and entered OFFBOARD again, so the
    vehicle is not handed over."""
    rig = PX4(then="wait").engage()
    since = rig.run(0.3, armed=False).now
    rig.run(1.0).run(4.0, speaks=False).run(3.0, speaks=True, armed=True)
    assert (rig.pilot.mission.phase, rig.pilot.session.vehicle.in_our_mode) == (Phase.READY, True)
    assert rig.setpoints(since) == []


@pytest.mark.parametrize(("mode", "setpoints"), [(POSCTL, False), (OFFBOARD, True)])
def test_slow_link_prevents_setpoints_except_in_offboard(mode, setpoints):
    """A vehicle that is already in OFFBOARD needs setpoints to prevent its failsafe. For a vehicle
    in another mode the link is too slow."""
    rig = PX4(mode).run(8.0, round_trip=1.5)
    assert rig.pilot.mission.phase is Phase.READY
    assert {message.vx for message in rig.setpoints()} == ({0.0} if setpoints else set())
    assert bool(len(rig.setpoints()) > 20) is setpoints
    assert rig.run(6.0, round_trip=0.0).setpoints()


def test_each_engagement_holds_its_own_initial_height():
    rig = PX4(POSCTL, then="wait").run(3.0)
    since = rig.run(1.0, altitude=120.0).now
    assert rig.run(2.0, mode=OFFBOARD).pilot.mission.phase is Phase.ENGAGED
    assert {message.vz for message in rig.setpoints(since)} == {0.0}
    assert rig.run(0.5, altitude=121.0).setpoints()[-1].vz == pytest.approx(0.5), (
        "the vehicle is 1 m too high and must descend"
    )
    since = rig.run(1.0, mode=LOITER).now
    assert rig.run(3.0, mode=OFFBOARD, altitude=150.0).pilot.mission.phase is Phase.ENGAGED
    assert {message.vz for message in rig.setpoints(since)} == {0.0}


@pytest.mark.parametrize("mode", [MANUAL, POSCTL, 7 << 16, 11 << 16])
def test_no_manual_control_is_sent_when_operator_uses_sticks(mode):
    rig = PX4(mode, "plane").run(5.0)
    assert rig.pilot.mission.phase is Phase.READY
    assert rig.of("MANUAL_CONTROL") == []


def test_implausible_airspeed_is_reported_once_while_engaged():
    rig = PX4(LOITER, "plane")

    def report_attitude():
        rig.receive(attitude(round(rig.now * 1000), 0.1 * rig.now, yawspeed=0.1))

    rig.run(5.0, report_attitude, airspeed=2.0)
    assert [text for text in rig.texts() if "implausible" in text] == []
    assert rig.run(10.0, report_attitude, mode=ALTCTL).pilot.mission.phase is Phase.READY
    rig.run(1.0, report_attitude, airspeed=15.0)
    assert rig.run(5.0, report_attitude, airspeed=2.0).pilot.mission.phase is Phase.ENGAGED
    assert [text for text in rig.texts() if "implausible" in text] == [
        "circnav: airspeed 2.0 m/s implausible, ignored"
    ]
