"""Positions given back to an autopilot that has lost its own: whole flights of the emulated plane."""

from math import hypot, pi

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.guidance.types import OwnMotion
from circnav_mav.locate.handback import DeadReckoning, HandBack, HandBackSettings, Where
from circnav_mav.locate.place import Plane
from sim.world import to_degrees
from tests.locate.flown import surveyed

POSITION = mavlink.MAV_CMD_EXTERNAL_POSITION_ESTIMATE
LOST_AT, END = 60.0, 105.5  # not a whole second: each position is answered
PLANE = (
    'sim.events=[{at_s=60.0, action="gps_off"}]', "sim.sensors.dead_reckoning_mps=1", "sim.sensors.gps_error_m=1",
    "sim.sensors.gps_error_time_s=600", "sim.wind.speed_mps=5", "sim.start.north_m=150", "sim.start.east_m=-100",
    "limits.duration_s=85",
)  # fmt: skip
HERE = Where(0.0, 15.0, 0.0, 3.0, 0j, 1.0, True)
ON_PLANE = Plane(-35.0, 149.0)


def commands(flown):
    return [(time, one) for time, one in flown.messages if one.get_type() == "COMMAND_INT" and one.command == POSITION]


def own_error(flown):
    """Of the position that the autopilot reports, m."""
    return hypot(*flown.vehicle._flight.position_error)


def test_an_autopilot_without_gps_is_kept_where_it_is_also_after_guidance_has_ended():
    """Of an autopilot that drifts away by 1 m/s in each axis, which nobody helps: 45 s later it is some 45 m off."""
    errors: list[tuple[float, float]] = []
    flown = surveyed("arduplane", *PLANE, law="auto", handback=HandBackSettings())
    flown.solve_from, flown.solve_every = 50.0, 10.0
    flown.fly(END, lambda one: errors.append((one.now, own_error(one))))
    given = commands(flown)
    assert [time for time, _ in given if time < LOST_AT + 2.0] == []
    assert len(given) >= 8 and flown.pilot.done
    late = sorted(error for time, error in errors if time > LOST_AT + 10)
    assert late[len(late) // 2] < 10.0 and late[-1] < 25.0
    (_, first), back = given[0], flown.locator.handback
    assert first.frame == mavlink.MAV_FRAME_GLOBAL and first.z != first.z and first.param3 >= 1.0
    assert all(0 <= one.param2 < 0.15 for _, one in given), "the estimate is not as old as it is told"
    assert flown.locator.job(END + 100.0) is None, "the place is estimated again without a new position"
    assert back.plain() == {"sent": len(given), "accepted": len(given), "ended": "going on"}
    assert given[-1][0] > flown.sent[-1][0] + 5.0, "it ended with guidance"


def lost_early(law, until, **settings):
    """A flight whose GPS is lost before anybody could have found the target."""
    lost = 'sim.events=[{at_s=10.0, action="gps_off"}]'
    flown = surveyed("arduplane", lost, *PLANE[1:], "sim.target.north_m=0", "sim.target.east_m=0", law=law, **settings)
    flown.solve_from = 1e9
    return flown.fly(until)


def test_off_by_default_nothing_is_given_and_the_same_autopilot_drifts_away():
    flown = lost_early("smooth", 45.0)
    assert commands(flown) == []
    assert own_error(flown) > 30.0


def test_a_place_that_the_mission_gives_needs_no_survey():
    flown = lost_early("auto", 70.0, handback=HandBackSettings(place=to_degrees(0.0, 0.0)))
    assert commands(flown)[0][0] < 45.0
    assert own_error(flown) < 10.0


def give(fixes, result, every=1.0, off=0.0):
    """When, s, positions were given to an autopilot that answers each with a result, and reports to be so far off, m.
    fixes: what its GPS says, every .1 s."""
    back, times = HandBack(HandBackSettings(every=every)), []
    for tick, fix in enumerate(fixes):
        if back.step(tick / 10, fix=fix, where=HERE, plane=ON_PLANE, target=(1, 1)) is not None:
            times.append(tick / 10)
            back.answered(mavlink.MAVLink_command_ack_message(POSITION, result, 0, 0, 1, 194), (1, 194), tick / 10)
        back.reported(HERE.east + off, HERE.north, HERE, tick / 10)
    return back, times


def test_nothing_is_given_while_the_gps_has_a_fix_or_nobody_says_so_and_no_more_once_it_is_back():
    back, times = give([True] * 50 + [False] * 200 + [None] * 100 + [True] * 100, mavlink.MAV_RESULT_ACCEPTED, 5.0)
    assert times == [7.0, 12.0, 17.0, 22.0]  # the fix is gone at 5 s, and has been for 2
    assert back.ended == "GPS is back"


def test_dead_reckoning_goes_on_through_the_air_with_the_wind_learnt_before():
    """Due north at 20 m/s through the air, 5 m/s of wind to the east, for 60 s from 100 m east of the target."""
    reckoning = DeadReckoning()
    reckoning.where = Where(0.0, 100.0, 0.0, 3.0, 5 + 0j, 1.0, True)
    for tick in range(1, 601):
        reckoning.flown(tick / 10, OwnMotion(tick / 10, pi / 2, 0.0, 20.0), 0.0)
    here = reckoning.where
    assert (here.east, here.north) == pytest.approx((400.0, 1200.0), abs=1e-6)
    assert here.sigma == pytest.approx(3.0 + 0.3 * 60) and not here.by_ranges


@pytest.mark.parametrize(
    ("result", "off", "times", "ended"),
    [
        (mavlink.MAV_RESULT_UNSUPPORTED, 0.0, 1, "the autopilot answered: "),
        (mavlink.MAV_RESULT_DENIED, 0.0, 1, "the autopilot answered: "),
        (77, 0.0, 1, "the autopilot answered: result 77"),
        (mavlink.MAV_RESULT_ACCEPTED, 400.0, 3, "positions are accepted, and have no effect"),
    ],
    ids=["unknown", "denied", "not understood", "accepted without effect, as where DCM flies"],
)
def test_an_autopilot_that_helps_itself_no_further_is_left_alone(result, off, times, ended):
    back, given = give([False] * 600, result, off=off)
    assert len(given) == times and back.over and back.ended.startswith(ended)
