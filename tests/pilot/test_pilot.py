"""Setpoints and other output of a pilot: for fresh ranges, while coasting, in outages and at the
end."""

from itertools import pairwise
from math import nan

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.guidance.types import Direction, TurnCommand, TurnRate
from circnav_mav.pilot import Ending, Phase
from circnav_mav.pilot.status_text import waits_for
from tests.rig import Rig, Voice, attitude, decode, heartbeat

GUIDED = 4
LOITER = 5
STEADY = 15.0 / 100.0
"""V/r_d of the rig's mission, rad/s."""
SAFE_THREE_TIMES = [(0.0, 0.0)] * 3
"""Speed and yaw rate of the three safe setpoints at the end of a mission."""


def flown(setpoints):
    """Return speed and yaw rate of setpoints."""
    return [(message.vx, message.yaw_rate) for message in setpoints]


# --- other output and kept values


def test_plot_values_are_sent_at_4_hz_or_less(rig):
    since = rig.engage().now
    rig.run(5.0)
    values = rig.of("NAMED_VALUE_FLOAT", since)
    assert 60 <= len(values) <= 80
    newest = {message.name: message.value for message in values}
    assert newest == {
        "CN_RNG": pytest.approx(150.0, abs=0.5),
        "CN_RRATE": pytest.approx(0.0, abs=0.1),
        "CN_ERR": pytest.approx(50.0, abs=0.5),
        "CN_YRATE": pytest.approx(rig.setpoints()[-1].yaw_rate, abs=1e-3),
    }


def test_heartbeat_is_sent_only_by_steps_of_loop(rig):
    """A loop that hangs must not send heartbeats, so that the failsafe of the autopilot can act."""
    rig.engage()
    for _ in range(100):
        rig.now = round(rig.now + 0.05, 6)
        rig.heartbeat()
    before = len(rig.of("HEARTBEAT"))
    rig.step()
    assert len(rig.of("HEARTBEAT")) == before + 1


def test_received_frames_are_kept_for_recorder(rig):
    frame = Voice(9, 9).pack(heartbeat())
    rig.pilot.receive(frame + b"\x00" + frame, 0.0, "x")
    assert rig.pilot.take_frames() == [frame, frame]
    assert rig.pilot.take_frames() == []


def test_each_step_leaves_one_record(rig):
    rig.engage().pilot.take_records()
    records = rig.run(1.0).pilot.take_records()
    assert [record.phase for record in records] == [Phase.ENGAGED] * len(records)
    assert len(records) >= 20
    assert all(
        record.yaw_rate_sent == pytest.approx(-record.turn_rate)
        for record in records
        if record.yaw_rate_sent
    )
    assert records[-1].link_age == pytest.approx(rig.now % 0.25, abs=1e-6)
    assert (records[-1].mode, records[-1].measured) == ("GUIDED", 150.0)


def test_estimator_gets_no_motion_of_vehicle_ignoring_commands(rig):
    """A copter without uplink hovers. With the commanded speed as own motion, the estimated
    position would be wrong."""
    rig.engage()
    received = []
    heading = [0.0]
    rig.pilot.tracker.estimator.move = received.append

    def report_heading(turns):
        heading[0] += 0.05 * rig.setpoints()[-1].yaw_rate if turns else 0.0
        rig.receive(attitude(round(1000 * rig.now), heading[0]))

    for turns in (True, False):
        received.clear()
        rig.run(10.0, lambda turns=turns: report_heading(turns))
        assert len([own for own in received if own.time > rig.now - 5.0]) == (99 if turns else 0)


def test_setpoint_is_first_frame_sent_in_each_step(rig):
    rig.engage()
    first = set()
    rest = set()
    for _ in range(30):
        rig.pass_time(0.05)
        rig.heartbeat()
        rig.range()
        setpoint, *others = sent(rig)
        first |= {message.get_type() for message in decode(setpoint)}
        rest |= {message.get_type() for message in decode(b"".join(others))}
        assert sent(rig) == [], "only one setpoint for each range"
    assert first == {"SET_POSITION_TARGET_LOCAL_NED"}
    assert {"HEARTBEAT", "TIMESYNC", "NAMED_VALUE_FLOAT"} <= rest - first


def sent(rig, accepts=True):
    """Run a step of the pilot and return the data that it passes to `send`. accepts: result of
    `send`, True if the data are sent."""
    out = []
    rig.pilot.step(rig.now, lambda data: out.append(data) or accepts)
    return out


def test_unsent_setpoint_is_neither_counted_nor_recorded(rig):
    before = rig.engage().pilot.setpoints_sent
    rig.pilot.take_records()
    for accepts in (False, True):
        rig.pass_time(0.1)
        rig.range()
        assert sent(rig, accepts)
    assert rig.pilot.setpoints_sent == before + 1
    assert [record.yaw_rate_sent is None for record in rig.pilot.take_records()] == [True, False]


# --- steering: phases and estimates


def test_mission_waits_for_link_then_ranging_then_mode(rig):
    assert (
        rig.run(1.0, speaks=False, ranges=False, mode=LOITER).pilot.mission.phase is Phase.WAIT_LINK
    )
    assert rig.run(1.0, speaks=True).pilot.mission.phase is Phase.WAIT_RANGING
    assert rig.run(1.5, ranges=True).pilot.mission.phase is Phase.READY
    assert rig.setpoints() == [] and rig.pilot.setpoints_sent == 0
    assert rig.run(1.0, mode=GUIDED).pilot.mission.phase is Phase.ENGAGED
    assert len(rig.setpoints()) == rig.pilot.setpoints_sent > 0


def test_first_setpoint_waits_for_five_ranges(rig):
    rig.run(1.0, ranges=False)
    for count in range(1, 6):
        rig.range()
        rig.run(0.3)
        assert bool(rig.setpoints()) == (count == 5)


def test_first_setpoint_waits_1_s_to_detect_second_source(rig):
    rig.run(1.0, ranges=False)
    assert rig.run(1.0, ranges=True).setpoints() == []
    assert waits_for(rig.pilot, rig.now) == "checking for a second range source"
    assert rig.run(0.2).setpoints()


def test_fresh_range_gets_setpoint_in_next_step(rig):
    rig.engage()
    rig.now += 0.041
    assert rig.step() == [], "no setpoint without a new range or a due tick"
    rig.range(15050)  # an equal value after this short time would be rejected as a repetition
    (setpoint,) = [
        message for message in rig.step() if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
    ]
    assert setpoint.time_boot_ms == round(rig.now * 1000)
    assert rig.step() == [], "only one setpoint for each range"


@pytest.mark.parametrize(
    ("direction", "sign"), [(Direction.CLOCKWISE, 1), (Direction.COUNTERCLOCKWISE, -1)]
)
def test_law_turns_at_constant_range_only_outside_circle(direction, sign):
    """Outside the circle a constant range means flight across the line of sight, so the law turns.
    Clockwise is to the right, positive in MAVLink."""
    way = f"orbit.direction={direction.value}"
    setpoint = Rig(way).engage().setpoints()[-1]
    assert setpoint.yaw_rate * sign > 0
    assert (setpoint.vx, setpoint.vy, setpoint.vz) == (15.0, 0.0, 0.0)
    assert {message.yaw_rate for message in Rig(way).engage(range_cm=5000).setpoints()} == {0.0}


def test_setpoints_stay_within_turn_limit(rig):
    """The equation of law 1 has no bound. In an approach at 600 m, the law demands much more than
    the limit of 0.35 rad/s."""
    rig.engage(range_cm=59000)
    assert max(abs(message.yaw_rate) for message in rig.setpoints()) == pytest.approx(0.35)
    assert rig.pilot.take_records()[-1].saturated


@pytest.mark.parametrize(
    ("message", "count"),
    [
        (
            mavlink.MAVLink_global_position_int_message(
                1, 473_000_000, 85_000_000, 0, 0, 1500, 0, 0, 0
            ),
            3,
        ),
        (
            mavlink.MAVLink_gps_raw_int_message(1, 3, 473_000_000, 85_000_000, 0, 1, 1, 1500, 0, 9),
            3,
        ),
        (mavlink.MAVLink_local_position_ned_message(1, 1e4, -1e4, -30, 15, 0, 0), 3),
        (mavlink.MAVLink_gps_global_origin_message(473_000_000, 85_000_000, 0), 1),
        (
            mavlink.MAVLink_home_position_message(
                473_000_000, 85_000_000, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
            ),
            1,
        ),
        (
            mavlink.MAVLink_odometry_message(
                1, 1, 8, 1e4, 1e4, -30, [1, 0, 0, 0], 15, 0, 0, 0, 0, 0.3, [0.0] * 21, [0.0] * 21
            ),
            3,
        ),
        (
            mavlink.MAVLink_gps2_raw_message(
                1, 3, 473_000_000, 85_000_000, 0, 1, 1, 1500, 0, 9, 0, 0
            ),
            3,
        ),
        (
            mavlink.MAVLink_sim_state_message(
                1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 47.3, 8.5, 500, 0, 0, 15, 0, 0
            ),
            3,
        ),
    ],
    ids=lambda value: value.get_type() if hasattr(value, "get_type") else "",
)
def test_false_positions_do_not_change_output(message, count):
    """The guidance must use no position, because the vehicle has no GPS."""
    undisturbed = Rig().engage()
    disturbed = Rig()
    disturbed.run(3.0, lambda: [disturbed.receive(message) for _ in range(count)])
    assert disturbed.raw == undisturbed.raw


def test_false_setpoint_report_raises_alarm_without_effect():
    undisturbed = Rig().engage().run(5.0)
    disturbed = Rig().engage()
    report = mavlink.MAVLink_position_target_local_ned_message(
        1, 8, 0x407, 1, 2, 3, 4, 5, 6, 7, 8, 9, 1, 1
    )
    disturbed.run(5.0, lambda: disturbed.receive(report))
    assert list(map(str, disturbed.setpoints())) == list(map(str, undisturbed.setpoints()))
    assert "circnav: another program also steers" in disturbed.texts()


def test_range_outage_is_predicted_before_coasting_begins(
    rig,
):
    last = rig.engage().now
    assert rig.run(0.45, ranges=False).pilot.mission.phase is Phase.ENGAGED
    since = rig.run(0.15).now
    assert rig.pilot.mission.phase is Phase.COASTING
    rig.run(2.0)
    assert {round(message.yaw_rate, 6) for message in rig.setpoints(since)} == {STEADY}
    assert rig.run(1.0, ranges=True).pilot.mission.phase is Phase.ENGAGED
    texts = [text for text in rig.texts(last) if "range" in text]
    assert texts == ["circnav: range lost, coasting", "circnav: range regained"]


def test_setpoints_pause_while_link_is_lost(rig):
    """The link is lost by 3 s without a heartbeat, while the ranges continue."""
    lost = rig.engage().now
    quiet = rig.run(3.3, speaks=False).now
    assert rig.pilot.mission.phase is Phase.WAIT_LINK
    rig.run(5.0)
    assert rig.setpoints(quiet) == []
    assert rig.setpoints(lost), "setpoints until the link is lost"
    assert rig.run(1.0, speaks=True).pilot.mission.phase is Phase.ENGAGED
    assert rig.setpoints(quiet)


# --- end of the mission


def holds(rig):
    assert rig.run(10.3, ranges=False).pilot.mission.phase is Phase.COASTING


def fails(rig):
    nonsense = TurnCommand(TurnRate(nan), TurnRate(nan), saturated=False)
    rig.pilot.controller._loop._steer = lambda *arguments: nonsense


@pytest.mark.parametrize(
    ("happens", "ending", "reason"),
    [
        (holds, Ending.ABORTED, "no range for 10"),
        (
            lambda rig: rig.run(rig.pilot.mission.engaged_at + 14.8 - rig.now),
            Ending.COMPLETED,
            "flown to its end",
        ),
        (lambda rig: rig.pilot.interrupt(rig.now, "SIGINT"), Ending.INTERRUPTED, "SIGINT"),
        (fails, Ending.ABORTED, "unsafe setpoint of law smooth not sent"),
    ],
    ids=["coasting", "timeout", "interrupt", "law fails"],
)
def test_flight_ends_with_three_safe_setpoints(happens, ending, reason):
    """The end of the flight also restores the default stream rates of the vehicle."""
    rig = Rig("limits.duration_s=15.0").engage()
    happens(rig)
    since = rig.now
    assert rig.run(1.0).pilot.done
    assert (rig.pilot.mission.outcome.ending, rig.pilot.mission.outcome.reason[: len(reason)]) == (
        ending,
        reason,
    )
    assert flown(rig.setpoints(since)[-3:]) == SAFE_THREE_TIMES
    safe = [then for then, message in rig.sent if getattr(message, "vx", None) == 0.0]
    assert len(safe) == 3 and rig.sent[-1][0] < safe[0] + 0.2
    if ending is Ending.COMPLETED:
        assert safe[0] == pytest.approx(rig.pilot.mission.engaged_at + 15.0, abs=0.051)
    given_back = {message.param1 for message in rig.commands(511, since) if message.param2 == 0}
    adapter = rig.pilot.session.adapter
    assert given_back == {
        *adapter.firmware.streams, adapter.echo, *rig.pilot.connection.more_streams
    }  # fmt: skip
    quiet = len(rig.sent)
    assert len(rig.run(5.0).sent) == quiet


def test_lost_link_ends_mission_after_outage_limit():
    """The outage begins when the link is lost, 3 s after the last heartbeat. The wait for the first
    heartbeat is not an outage."""
    rig = Rig("link.wait_s=2.0").engage()
    assert not rig.run(62.9, speaks=False).pilot.done
    assert rig.run(1.0).pilot.done
    assert (rig.pilot.mission.outcome.ending, rig.pilot.mission.outcome.reason) == (
        Ending.ABORTED, "no vehicle or no ranging for 60 s"
    )  # fmt: skip


@pytest.mark.parametrize(("comes_back", "what"), [(False, "heartbeat"), (True, "range")])
def test_timeout_during_outage_names_missing_message(comes_back, what):
    rig = Rig("limits.duration_s=10.0").engage()
    outage_since = rig.now
    rig.run(4.0, speaks=False, ranges=False).now_is(speaks=comes_back)
    while not rig.pilot.done:
        rig.run(0.05)
    assert rig.pilot.mission.outcome.ending is Ending.ABORTED
    assert rig.pilot.mission.outcome.reason.endswith(
        f", no {what} for {rig.now - outage_since:.0f} s"
    )


def test_safe_setpoints_begin_at_once_with_tick_interval(
    rig,
):
    since = rig.engage().now
    rig.pilot.interrupt(rig.now, "SIGINT")
    rig.now += 0.001
    rig.step()
    assert [message.vx for message in rig.setpoints(since)] == [0.0], (
        "the first safe setpoint does not wait for the next tick"
    )
    for _ in range(40):
        rig.now = round(rig.now + 0.005, 6)
        rig.range()
        rig.step()
    times = [
        then for then, message in rig.sent if then > since and getattr(message, "vx", None) == 0.0
    ]
    assert len(times) == 3
    assert all(b - a >= 0.05 - 1e-9 for a, b in pairwise(times))
    assert "circnav: ended, SIGINT" in rig.texts(since)


JUNK = (
    "no vehicle: no autopilot heartbeat, received 4 bytes, 0 frames, 1 CRC or framing errors,"
    " system/component ids: none, MAVLink version: none"
)
MISFIT = "no vehicle: system 1 is px4 quadrotor, the mission is for ardupilot copter"


@pytest.mark.parametrize(
    ("limit", "received", "state", "begins", "ends"),
    [
        ("wait_link", b"junk", {"speaks": False, "ranges": False}, JUNK, JUNK),
        ("wait_link", Voice().pack(heartbeat(autopilot=12)), {"speaks": False}, MISFIT, MISFIT),
        (
            "wait_ranging",
            b"",
            {"range_cm": 65535},
            "no ranging: no usable DISTANCE_SENSOR, rejected: ",
            " 2",
        ),
    ],
    ids=["no vehicle", "other vehicle", "no range"],
)
def test_mission_timeout_reports_received_data(limit, received, state, begins, ends):
    rig = Rig("link.wait_s=2.0")
    rig.pilot.receive(received, rig.now, rig.source)
    outcome = rig.run(3.0, **state).pilot.mission.outcome
    assert outcome.ending is Ending.NOTHING_RECEIVED
    assert outcome.reason.startswith(begins) and outcome.reason.endswith(ends)
    assert bool(" no_range; received " in outcome.reason) is (limit == "wait_ranging")
