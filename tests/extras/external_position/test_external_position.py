"""Positions sent to an autopilot that has lost its own position: complete flights of the emulated
plane."""

from math import hypot, pi

import numpy as np
import pytest
from circnav_sim.world import to_degrees
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.extras.external_position.companion import COMMANDS, SENT_TYPES
from circnav_mav.extras.external_position.external_position import (
    DeadReckoning,
    ExternalPosition,
    Health,
    PositionEstimate,
)
from circnav_mav.extras.locate.place import Place, Plane
from circnav_mav.guidance.types import OwnMotion, RangeEstimate, RelativeMotion
from tests.extras.external_position.external_position_flight import (
    GPS_LOST,
    external_position_flight,
)
from tests.extras.locate.flown import locating_flight
from tests.flight.lockstep import flight

POSITION = mavlink.MAV_CMD_EXTERNAL_POSITION_ESTIMATE
LOST_AT = 40.0
# The flight ends between whole seconds, so that the last position is answered too.
END = 70.5
HERE = PositionEstimate(0.0, 15.0, 0.0, 3.0, 0j, 1.0, True)
ON_PLANE = Plane(-35.0, 149.0)


def commands(flown):
    return [
        (time, one)
        for time, one in flown.given_messages
        if getattr(one, "command", None) == POSITION
    ]


def own_error(flown):
    """Error of the position that the autopilot reports, m."""
    return hypot(*flown.vehicle._flight.position_error)


def test_external_position_keeps_autopilot_position_without_changing_guidance():
    """The autopilot's own position drifts at 1 m/s in each axis: without external position, by
    about 30 m in each axis after 30 s. The positions are sent beside the output of pilot and
    locator."""
    errors: list[tuple[float, float]] = []
    flown = external_position_flight("arduplane", *GPS_LOST, law="auto")
    flown.solve_from = 30.0
    flown.solve_every = 10.0
    flown.fly(END, lambda one: errors.append((one.now, own_error(one))))
    given = commands(flown)
    assert given[0][0] == pytest.approx(LOST_AT + 12.0, abs=1.0)
    assert len(given) >= 8 and flown.pilot.done
    late = sorted(error for time, error in errors if time > LOST_AT + 15)
    assert late[len(late) // 2] < 10.0 and late[-1] < 25.0
    (_, first), back = given[0], flown.companion.external_position
    assert first.frame == mavlink.MAV_FRAME_GLOBAL and first.z != first.z and first.param3 >= 1.0
    assert all(0 <= one.param2 < 0.15 for _, one in given)
    assert flown.locator.job(END + 100.0) is None
    assert back.plain() == {"sent": len(given), "accepted": len(given), "ended": "going on"}
    assert given[-1][0] > flown.sent[-1][0] + 5.0
    values = [message for _, message in flown.given_messages]
    assert {one.get_type() for one in values} == SENT_TYPES and {
        one.command for one in values
    } == COMMANDS
    assert flown.sent == flight("arduplane", *GPS_LOST, law="auto").fly(END).sent


def lost_early(kind, law, until, **settings):
    """Return a flight that loses its GPS before the target can be located."""
    lost = 'sim.events=[{at_s=10.0, action="gps_off"}]'
    flown = kind(
        "arduplane",
        lost,
        *GPS_LOST[1:],
        "sim.target.north_m=0",
        "sim.target.east_m=0",
        "limits.duration_s=75",
        law=law,
        **settings,
    )
    flown.solve_from = 1e9
    return flown.fly(until)


def test_autopilot_without_external_position_drifts_away():
    assert own_error(lost_early(locating_flight, "smooth", 40.0)) > 30.0


def test_target_position_of_mission_replaces_locator():
    flown = lost_early(external_position_flight, "auto", 70.0, place=to_degrees(0.0, 0.0))
    assert commands(flown)[0][0] < 45.0
    assert own_error(flown) < 10.0
    asked = [one.param1 for _, one in flown.given_messages if one.get_type() == "COMMAND_LONG"]
    assert sorted(asked) == [GPS2, EKF], (
        "no streams of the locator, and no second request for a missing receiver"
    )


def give(goods, result, off=0.0, until=1e9):
    """Return the external position and the times (s) at which it sent positions. goods: True while
    the autopilot's own position is valid, one value per 0.1 s. result: answer to each position.
    off: error of the position that the autopilot reports, m. until: time at which circnav loses its
    estimate, s."""
    back = ExternalPosition()
    times = []
    for tick, good in enumerate(goods):
        where = HERE if tick / 10 < until else None
        if back.step(tick / 10, good=good, where=where, plane=ON_PLANE, target=(1, 1)) is not None:
            times.append(tick / 10)
            back.answered(
                mavlink.MAVLink_command_ack_message(POSITION, result, 0, 0, 1, 194),
                (1, 194),
                tick / 10,
            )
        back.reported(HERE.east + off, HERE.north, HERE, tick / 10)
    return back, times


def test_positions_are_sent_only_while_autopilot_position_is_lost():
    back, times = give(
        [True] * 50 + [False] * 40 + [None] * 100 + [True] * 100, mavlink.MAV_RESULT_ACCEPTED
    )
    # the autopilot loses its position at 5 s; positions are sent from 7 s on
    assert times == [7.0, 8.0]
    assert back.ended == "the autopilot has a position again"


def test_alarm_distinguishes_sent_and_missing_positions():
    assert give([False] * 100, mavlink.MAV_RESULT_ACCEPTED)[0].words.startswith(
        "autopilot lost its position, sent"
    )
    assert give([False] * 100, mavlink.MAV_RESULT_ACCEPTED)[0].works
    lacking = give([False] * 100, mavlink.MAV_RESULT_ACCEPTED, until=5.0)[0]
    assert "no replacement" in lacking.words and not lacking.works
    assert (
        give([False] * 50 + [True] * 20 + [False] * 10, mavlink.MAV_RESULT_ACCEPTED)[0].words == ""
    )


GPS = mavlink.MAVLINK_MSG_ID_GPS_RAW_INT
GPS2 = mavlink.MAVLINK_MSG_ID_GPS2_RAW
EKF = mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT
ESTIMATOR = mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS
RECKONS = 0x12F
CONSTANT = 0xA7
"""ArduPilot's flags as set by NavEKF3_core::updateFilterStatus. RECKONS: dead reckoning by
airspeed. CONSTANT: constant position at rest."""
PX4_RECKONS = 0x13F
PX4_FUSES = 0x33F
"""PX4's flags as set by Ekf::get_ekf_soln_status. PX4_RECKONS: dead reckoning. PX4_FUSES: while
fusing airspeed and zero side-slip, PX4 reports its absolute position as valid."""


LOST = {
    "dead reckoning": ({GPS: 1, EKF: RECKONS}, False),
    "at rest": ({GPS: 1, EKF: CONSTANT}, False),
    "vision or beacons": ({GPS: 1, EKF: RECKONS | 0x10}, True),
    "second GPS": ({GPS: 1, GPS2: 3, EKF: RECKONS}, True),
    "fix": ({GPS: 3, EKF: RECKONS}, True),
    "PX4, dead reckoning": ({GPS: 1, GPS2: 0, ESTIMATOR: PX4_RECKONS}, False),
    "PX4, auxiliary position": ({GPS: 1, ESTIMATOR: PX4_FUSES}, True),
    "no estimator": ({GPS: 1}, None),
    "no GPS": ({EKF: RECKONS}, None),
}


@pytest.mark.parametrize(("values", "good"), LOST.values(), ids=LOST)
def test_position_loss_is_detected_from_gps_and_estimator_reports(values, good):
    health = Health()
    for ident, value in values.items():
        message = mavlink.mavlink_map[ident]
        fields = {
            name: value if name in ("fix_type", "flags") else 0 for name in message.fieldnames
        }
        health.on_message(message(**fields), 10.0)
    assert health.good(12.0) is good
    assert health.good(13.1) is None


def reckoned(received):
    """Return the position after 60 s of dead reckoning from 100 m east of the target. The vehicle
    flies north at 20 m/s through the air, in a wind of 5 m/s to the east. received: function of
    time (s); True if own motion is available."""
    reckoning = DeadReckoning()
    reckoning.where = PositionEstimate(0.0, 100.0, 0.0, 3.0, 5 + 0j, 1.0, True)
    for now in np.arange(1, 601) / 10:
        reckoning.step(
            now, OwnMotion(now, pi / 2, 0.0, 20.0) if received(now) else None, None, None
        )
    return reckoning.where


def test_dead_reckoning_uses_airspeed_and_learned_wind():
    """The uncertainty grows by a compass bias of 0.09 rad (not estimated) at 20 m/s, and by a wind
    error of 0.3 m/s."""
    here = reckoned(lambda now: True)
    assert (here.east, here.north) == pytest.approx((400.0, 1200.0), abs=1e-6)
    assert (
        here.sigma == pytest.approx(3.0 + hypot(0.3, 0.09 * 20) * 60, rel=1e-3)
        and not here.by_ranges
    )


def test_motion_gap_increases_uncertainty_but_positions_continue():
    """Without motion reports for 3 s, the direction of flight is unknown."""
    here = reckoned(lambda now: not 20 < now < 23)
    assert (here.east, here.north) == pytest.approx((400.0, 1200.0), abs=1e-6)
    assert here.sigma - reckoned(lambda now: True).sigma == pytest.approx(
        2.9 * (20 - 1.8), rel=0.05
    )


def test_slow_tick_increases_uncertainty_but_positions_continue():
    reckoning = DeadReckoning()
    reckoning.where = PositionEstimate(0.0, 0.0, 0.0, 3.0, 0j, 1.0, True)
    reckoning.step(2.0, OwnMotion(2.0, 0.0, 0.0, 20.0), None, None)
    assert (reckoning.where.east, reckoning.where.sigma) == pytest.approx((40.0, 43.0), abs=0.1)


def late(*results, delay):
    """Return the external position and the times of its positions. The autopilot answers each
    position with these results, one after the other, at intervals of `delay` s."""
    back = ExternalPosition()
    answers = []
    times = []
    for now in (round(0.05 * tick, 6) for tick in range(600)):
        for result in [result for at, result in answers if at == now]:
            back.answered(
                mavlink.MAVLink_command_ack_message(POSITION, result, 0, 0, 1, 194), (1, 194), now
            )
        if back.step(now, good=False, where=HERE, plane=ON_PLANE, target=(1, 1)) is not None:
            times.append(now)
            answers += [
                (round(now + delay * (which + 1), 6), result)
                for which, result in enumerate(results)
            ]
    return back, times


def test_external_position_waits_after_in_progress_answers():
    progress = mavlink.MAV_RESULT_IN_PROGRESS
    accepted = mavlink.MAV_RESULT_ACCEPTED
    back, times = late(progress, accepted, delay=0.2)
    assert len(times) > 20 and {one.answer for one in back.given[:-1]} == {"accepted"}
    assert len(late(progress, delay=0.2)[1]) == 3


def test_late_answers_are_matched_with_their_positions():
    """The second position is sent only after the time in which answers to the first position can
    arrive."""
    back, times = late(mavlink.MAV_RESULT_DENIED, delay=2.5)
    assert len(times) == 1 and back.given[0].answer == "denied" and back.over
    back, times = late(mavlink.MAV_RESULT_ACCEPTED, delay=3.5)
    assert np.diff(times).min() > 3.5 and {one.answer for one in back.given[:-1]} == {"accepted"}


def test_counts_include_positions_that_are_no_longer_stored(monkeypatch):
    monkeypatch.setattr("circnav_mav.extras.external_position.external_position.MOST_GIVEN", 5)
    back, times = late(mavlink.MAV_RESULT_ACCEPTED, delay=0.2)
    assert [one.time for one in back.given] == times[-5:] and len(times) > 20
    assert back.plain() == {"sent": len(times), "accepted": len(times), "ended": "going on"}


TARGET = Place(0.0, ON_PLANE, 0.0, 0.0, 0.0, np.eye(2), up_sigma=1.0, up_known=True)


def by_ranges(time, east, north, drift=5 + 0j, sigma=2.0, r=None):
    """Return the filter's estimate for a vehicle at a position that flies north at 20 m/s through
    the air, in a drift."""
    motion = RelativeMotion(
        east, north, sigma, drift.real, drift.imag, pi / 2, 0.0, 20.0, 1.0, True
    )
    return RangeEstimate(
        time, hypot(east, north) if r is None else r, 0.0, 0.5, 0.5, relative=motion
    )


def reckoned_by(estimates, reckoning=None):
    """Return dead reckoning of a vehicle that flies north at 20 m/s through the air, with ten
    filter estimates a second."""
    reckoning = reckoning or DeadReckoning()
    for estimate in estimates:
        own = OwnMotion(estimate.time, pi / 2, 0.0, 20.0)
        reckoning.step(estimate.time, own, TARGET, estimate if estimate.r > 0 else None)
    return reckoning


def test_external_position_away_from_circle_uses_learned_wind():
    """Away from the circle the filter keeps the last gust as drift: 2 m/s to the east, with a large
    sigma. The ground speed is 21 m/s, which only ranges show."""
    reckoning = reckoned_by(by_ranges(t, 0.0, 150.0) for t in np.arange(1, 301) / 10)
    away = [(30 + t, 5 * t, 150 + 21 * t) for t in np.arange(1, 601) / 10]
    reckoned_by(
        (
            by_ranges(t, e + 2 * (t - 30), n, 7 + 0j, 2 + 1.5 * (t - 30), hypot(e, n))
            for t, e, n in away
        ),
        reckoning,
    )
    here = reckoning.where
    t = here.time - 30
    assert here.by_ranges and hypot(here.east, here.north) == pytest.approx(
        hypot(5 * t, 150 + 21 * t), abs=0.1
    )
    assert (here.east, here.north) == pytest.approx((5 * t, 150 + 21 * t), abs=15.0)
    assert here.wind == pytest.approx(5 + 0j, abs=0.1)
    reckoned_by([by_ranges(90.0 + t, 0.0, 0.0, r=0.0) for t in np.arange(1, 601) / 10], reckoning)
    assert (reckoning.where.east - here.east, reckoning.where.north - here.north) == pytest.approx(
        (300, 1200), abs=10
    )


def test_learned_wind_follows_lasting_change_but_no_gust():
    def circled(*drifts):
        return reckoned_by(
            by_ranges(t, 0.0, 150.0, drift)
            for t, drift in zip(np.arange(1, 2000) / 10, drifts, strict=False)
        )

    old = [5 + 0j] * 900
    new = [-3 + 4j] * 150
    assert abs(circled(*old, *new).where.wind - (-3 + 4j)) < 0.5
    assert abs(circled(*old, *new[:60]).where.wind - 5) < 1.5


def test_filter_outweighs_dead_reckoning_on_conflict():
    """The filter's standard deviation grows when the wind changes. Dead reckoning still uses the
    old wind."""
    reckoning = reckoned_by(by_ranges(t, 0.0, 150.0) for t in np.arange(1, 301) / 10)
    for t in np.arange(301, 401) / 10:
        here = reckoned_by([by_ranges(t, 0.0, 150.0, 5 + 20j, 8.0)], reckoning).where
        assert hypot(here.east, here.north - 150.0) < 3 * 8.0 + 3.0


def test_dead_reckoning_ignores_impossible_distance_from_target():
    reckoning = reckoned_by(by_ranges(t, 0.0, 150.0) for t in np.arange(1, 301) / 10)
    reckoned_by(
        (by_ranges(t, 0.0, 150.0, sigma=900.0, r=2000.0) for t in np.arange(301, 311) / 10),
        reckoning,
    )
    assert (reckoning.where.east, reckoning.where.north) == pytest.approx((5.0, 170.0), abs=1.0)


@pytest.mark.parametrize(
    ("result", "off", "times", "ended"),
    [
        (mavlink.MAV_RESULT_UNSUPPORTED, 0.0, 1, "the autopilot answered: "),
        (mavlink.MAV_RESULT_DENIED, 0.0, 1, "the autopilot answered: "),
        (77, 0.0, 1, "the autopilot answered: result 77"),
        (mavlink.MAV_RESULT_ACCEPTED, 400.0, 3, "positions are accepted, but have no effect"),
    ],
    ids=["unknown", "denied", "not understood", "accepted without effect"],
)
def test_refusing_autopilot_gets_no_more_positions(result, off, times, ended):
    back, given = give([False] * 600, result, off=off)
    assert len(given) == times and back.over and back.ended.startswith(ended)
