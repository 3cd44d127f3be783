"""DO_REPOSITION and DO_CHANGE_SPEED: the emulated vehicles either fly them or refuse them."""

import math

import pytest
from circnav_sim.autopilots.modes import PX4
from pymavlink.dialects.v20 import all as mavlink

from tests.sim.station import aboard

REPOSITION = 192
CHANGE_SPEED = 178
HOME = (-35.3632621, 149.1652374)
ACCEPTED = 0
DENIED = 2
FAILED = 4
# MAV_FRAME_GLOBAL_INT, MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, MAV_FRAME_GLOBAL_TERRAIN_ALT_INT
AMSL = 5
RELATIVE = 6
TERRAIN = 11
EARTH = 6_378_137.0


def reposition(at, north, east, height, *, frame=RELATIVE, flags=1):
    latitude = HOME[0] + math.degrees(north / EARTH)
    longitude = HOME[1] + math.degrees(east / EARTH / math.cos(math.radians(HOME[0])))
    x, y = round(latitude * 1e7), round(longitude * 1e7)
    before = len(at.acks(REPOSITION))
    at.send(
        mavlink.MAVLink_command_int_message(
            1, 1, frame, REPOSITION, 0, 0, -1, flags, 0, math.nan, x, y, height
        )
    )
    (result,) = at.acks(REPOSITION)[before:]
    return result


@pytest.mark.parametrize(
    ("profile", "frame", "height"),
    [("arducopter", RELATIVE, 40.0), ("arducopter", AMSL, 624.0), ("px4_copter", AMSL, 624.0)],
)
def test_copter_repositions_with_commanded_speed(profile, frame, height):
    companion = aboard(profile)
    assert companion.command(CHANGE_SPEED, 1, 4.0, -1) == [ACCEPTED]
    assert reposition(companion, 80.0, -60.0, height, frame=frame) == ACCEPTED
    companion.wait(20.0)
    assert companion.truth.ground_speed == pytest.approx(4.0, abs=0.1)
    companion.wait(100.0)
    truth = companion.truth
    assert (truth.north, truth.east, truth.down) == pytest.approx((80.0, -60.0, -40.0), abs=1.0)
    assert truth.mode == (4 if profile == "arducopter" else PX4["LOITER"])


@pytest.mark.parametrize(
    ("profile", "frame", "height", "radius", "within"),
    [("arduplane", RELATIVE, 120.0, 60.0, 25.0), ("px4_plane", AMSL, 704.0, 80.0, 8.0)],
)
def test_plane_circles_commanded_place_and_height(profile, frame, height, radius, within):
    """radius: default of WP_LOITER_RAD (ArduPlane) or NAV_LOITER_RAD (PX4), m."""
    companion = aboard(profile, vehicle={"airspeed_scale": 1.0})
    speed = 12.0 if profile == "px4_plane" else 25.0
    assert reposition(companion, 300.0, 200.0, height, frame=frame) == ACCEPTED
    assert companion.command(CHANGE_SPEED, 0, speed, -1) == [ACCEPTED]
    companion.wait(90.0)
    for _ in range(5):
        companion.wait(5.0)
        truth = companion.truth
        assert math.hypot(truth.north - 300.0, truth.east - 200.0) == pytest.approx(
            radius, abs=within
        )
        assert (truth.down, truth.airspeed) == pytest.approx((-120.0, speed), abs=0.6)


def test_rover_repositions_and_obeys_the_next_setpoint():
    companion = aboard("ardurover", "GUIDED")
    assert reposition(companion, 40.0, 30.0, 0.0) == ACCEPTED
    companion.wait(10.0)
    assert companion.command(CHANGE_SPEED, 1, 4.5, -1) == [ACCEPTED]
    companion.wait(10.0)
    assert companion.truth.ground_speed == pytest.approx(4.5, abs=0.05)
    companion.wait(60.0)
    truth = companion.truth
    assert math.hypot(truth.north - 40.0, truth.east - 30.0) < 4.0
    assert truth.ground_speed == pytest.approx(0.0, abs=0.05)
    companion.fly(5.0, 2.0, 0.0)
    assert companion.truth.ground_speed == pytest.approx(2.0, abs=0.1)
    assert companion.command(CHANGE_SPEED, 1, 4.5, -1) == [FAILED]


@pytest.mark.parametrize("profile", ["arducopter", "arduplane", "ardurover"])
def test_impossible_reposition_is_refused(profile):
    companion = aboard(profile, "LOITER")
    # refused: the vehicle is not in GUIDED, and the command does not allow a mode change
    assert reposition(companion, 80.0, 0.0, 40.0, flags=0) == DENIED
    assert reposition(companion, 80.0, 0.0, math.nan) == DENIED
    assert reposition(companion, 80.0, 0.0, 40.0, frame=TERRAIN) == DENIED
    assert companion.command(REPOSITION, -1, 1, 0, 0, 95.0, 0.0, 40.0) == [DENIED]
    disarmed = aboard(profile, start={"armed": False, "altitude_m": 0.0})
    assert reposition(disarmed, 80.0, 0.0, 40.0) == FAILED
