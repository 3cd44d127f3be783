"""Flights that begin or end on the ground: landed states, take-off, landing and crash."""

import math

import pytest

from tests.sim.station import aboard

EXTENDED_SYS_STATE = 245
ON_GROUND, IN_AIR, TAKING_OFF, LANDING = 1, 2, 3, 4
GROUND = {"armed": False, "altitude_m": 0.0, "north_m": 0.0}
BANK = math.radians(45)


def at(time, action, value=None, mode=None):
    given = {"value": value, "mode": mode}
    return {"at_s": time, "action": action} | {k: v for k, v in given.items() if v is not None}


def on_ground(profile, mode, *events, **tables):
    """Return the companion of a vehicle on the ground, with its landed state at 20 Hz."""
    start = GROUND | {"mode": mode}
    companion = aboard(profile, start=start, events=list(events), **tables)
    assert companion.stream(EXTENDED_SYS_STATE, 50_000) == [0]
    return companion


def landed_states(companion):
    """Return the reported landed states in order, without repetitions."""
    states = [message.landed_state for message in companion.listen("EXTENDED_SYS_STATE")]
    return [one for i, one in enumerate(states) if i == 0 or one != states[i - 1]]


@pytest.mark.parametrize("mode", ["ALT_HOLD", "LOITER"])
def test_copter_reports_lift_off_by_stick(mode):
    """ArduCopter/takeoff.cpp with PILOT_TKOFF_ALT 0: no TAKEOFF state, IN_AIR at lift-off. On 4.6.3
    the copter lifted off 1.4 s after the stick, and climbed at 1.87 m/s with a stick of 0.9."""
    companion = on_ground("arducopter", mode, at(1, "arm"), at(2, "throttle", 0.9))
    companion.wait(3.3)
    assert landed_states(companion) == [ON_GROUND] and companion.truth.down == 0.0
    companion.wait(0.25)
    assert landed_states(companion) == [ON_GROUND, IN_AIR] and -0.3 < companion.truth.down < 0
    companion.wait(4.0)
    before = companion.truth.down
    companion.wait(1.0)
    assert before - companion.truth.down == pytest.approx(1.87, abs=0.05)


def test_armed_copter_stays_on_ground_without_stick():
    events = at(1, "arm"), at(2, "mode", mode="GUIDED")
    companion = on_ground("arducopter", "LOITER", *events)
    companion.wait(2.5)
    companion.fly(5.0, 5.0, 0.2)
    assert companion.truth.down == companion.truth.ground_speed == 0.0
    assert landed_states(companion) == [ON_GROUND] and not companion.truth.crashed


@pytest.mark.parametrize(("mode", "wind"), [("LAND", 0.0), ("RTL", 0.0), ("LAND", 3.0)])
def test_copter_lands_settles_and_disarms(mode, wind):
    """Measured on 4.6.3: "landed" 1.5 s after the touchdown, disarmed 0.5 s later
    (ArduCopter/land_detector.cpp, mode_land.cpp)."""
    events = at(0, "arm"), at(0, "throttle", 1.0), at(4, "mode", mode=mode)
    companion = on_ground("arducopter", "LOITER", *events, wind={"speed_mps": wind})
    while not (companion.truth.down == 0.0 and companion.truth.time > 4.0):
        companion.wait(0.05)
    touched = companion.truth.time
    companion.wait(1.4)
    assert landed_states(companion) == [ON_GROUND, IN_AIR, LANDING]
    companion.wait(0.3)
    assert landed_states(companion)[-1] == ON_GROUND and companion.truth.armed
    companion.wait(0.5)
    assert not companion.truth.armed and not companion.truth.crashed and touched < 80.0


def test_copter_landed_by_stick_disarms_after_delay():
    """ArduCopter/motors.cpp, auto_disarm_check: DISARM_DELAY 10 s with the stick down."""
    events = at(0, "arm"), at(0, "throttle", 1.0), at(3, "throttle", 0.2)
    companion = on_ground("arducopter", "ALT_HOLD", *events)
    companion.wait(9.0)
    assert landed_states(companion) == [ON_GROUND, IN_AIR, ON_GROUND] and companion.truth.armed
    companion.wait(9.0)
    assert not companion.truth.armed


def test_plane_takes_off_from_runway():
    """ArduPlane/mode_takeoff.cpp, and is_flying.cpp: IN_AIR already in the ground roll, at 2 to 5
    m/s. The climb to TKOFF_ALT takes some 12 s, then the plane loiters."""
    companion = on_ground("arduplane", "TAKEOFF", at(1, "arm"))
    companion.wait(1.5)
    assert landed_states(companion) == [ON_GROUND] and companion.truth.ground_speed == 0.0
    companion.wait(0.8)
    assert landed_states(companion) == [ON_GROUND, IN_AIR]
    assert companion.truth.down == 0.0 and 1.5 < companion.truth.ground_speed < 7.0
    steepest = 0.0
    while companion.truth.down > -45.0:
        companion.wait(0.1)
        steepest = max(steepest, abs(companion.truth.roll))
    assert companion.truth.time < 14.0 and steepest < math.radians(6)
    companion.wait(20.0)
    assert companion.truth.down == pytest.approx(-50.0, abs=1.0) and companion.truth.roll > 0.5
    assert not companion.truth.crashed


def test_plane_crashes_when_guided_interrupts_its_takeoff_run():
    """On 4.6.3 a plane that left TAKEOFF at 5 m/s rolled for 15 s at 0.2 m, then touched the ground
    with banks of 40 to 97 deg. On its wheels it stays level (GROUND_BEHAVIOR_FWD_ONLY)."""
    companion = on_ground("arduplane", "TAKEOFF", at(1, "arm"), at(2.3, "mode", mode="GUIDED"))
    companion.wait(2.4)
    companion.repeat(2.0, lambda: companion.attitude(0xC6, BANK))
    assert companion.truth.ground_speed > 10.0 and companion.truth.roll == 0.0
    companion.repeat(15.0, lambda: companion.attitude(0xC6, BANK))
    assert companion.truth.crashed and companion.truth.ground_speed == 0.0
    companion.wait(4.0)
    assert landed_states(companion) == [ON_GROUND, IN_AIR, ON_GROUND]


def test_plane_crashes_when_wing_tip_touches_ground():
    start = {"mode": "GUIDED", "altitude_m": 0.6}
    companion = aboard("arduplane", start=start)
    companion.repeat(3.0, lambda: companion.attitude(0xC6, BANK))
    assert companion.truth.crashed and companion.truth.down == 0.0
    level = aboard("arduplane", start=start)
    level.repeat(3.0, lambda: level.attitude(0xC6, 0.1))
    assert not level.truth.crashed


def test_fast_touchdown_and_fall_crash_copter():
    companion = aboard("arducopter_nogps", "GUIDED_NOGPS", start={"altitude_m": 1.0})
    companion.repeat(4.0, lambda: companion.attitude(7, 0.0, -0.3, thrust=0.3))
    assert companion.truth.crashed and companion.truth.ground_speed == 0.0
    assert companion.truth.armed  # no landing is detected while the copter is told to lean
    fallen = aboard(events=[at(1, "disarm")])
    fallen.wait(10.0)
    assert fallen.truth.crashed and fallen.truth.down == 0.0


def test_px4_copter_takes_off_holds_and_lands():
    """EXTENDED_SYS_STATE.hpp: TAKEOFF until AUTO.LOITER follows, LANDING in AUTO.LAND.
    Commander.cpp disarms COM_DISARM_LAND after the landing."""
    companion = on_ground("px4_copter", "TAKEOFF", at(1, "arm"), at(12, "mode", mode="LAND"))
    companion.wait(11.0)
    assert companion.px4_mode == "LOITER" and companion.truth.down == pytest.approx(-2.5, abs=0.2)
    companion.wait(6.0)
    assert companion.truth.down == 0.0 and companion.truth.armed
    companion.wait(3.0)
    assert landed_states(companion) == [ON_GROUND, TAKING_OFF, IN_AIR, LANDING, ON_GROUND]
    assert not companion.truth.armed and not companion.truth.crashed


def test_px4_copter_disarms_without_takeoff():
    """COM_DISARM_PRFLT: 10 s after arming without a take-off."""
    companion = on_ground("px4_copter", "LOITER", at(1, "arm"))
    companion.wait(10.0)
    assert companion.truth.armed
    companion.wait(2.0)
    assert not companion.truth.armed


def test_px4_copter_takes_off_by_stick_without_gps():
    """ALTCTL needs no position. The copter climbs with up to MPC_Z_VEL_MAX_UP."""
    events = at(0, "throttle", 0.0), at(1, "arm"), at(2, "throttle", 0.7), at(8, "throttle", 0.5)
    companion = on_ground("px4_copter", "ALTCTL", *events, vehicle={"gps": False})
    companion.wait(10.0)
    assert landed_states(companion) == [ON_GROUND, IN_AIR]
    height = -companion.truth.down
    companion.wait(5.0)
    assert 2.0 < height < 5.0 and -companion.truth.down == pytest.approx(height, abs=0.1)
