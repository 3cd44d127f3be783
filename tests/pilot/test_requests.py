"""Requests that MAVLink expects every component to answer, frame by frame."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.rig import Voice

GCS = Voice(255, 190)
OTHER_AUTOPILOT = Voice(2, 1)
OURS = (1, 191)
HEARTBEAT = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3)
CALIBRATE = mavlink.MAV_CMD_PREFLIGHT_CALIBRATION
COMMAND = mavlink.MAVLink_command_long_message(*OURS, CALIBRATE, 0, 1, 0, 0, 0, 0, 0, 0)
COMMAND_INT = mavlink.MAVLink_command_int_message(*OURS, 0, CALIBRATE, 0, 0, 1, 0, 0, 0, 0, 0, 0)
UNSUPPORTED = {
    "command": CALIBRATE,
    "result": mavlink.MAV_RESULT_UNSUPPORTED,
    "target_system": 255,
    "target_component": 190,
}


@pytest.fixture
def flying(make_rig):
    rig = make_rig()
    rig.run(5.0)
    return rig


def answers(rig, message, voice=GCS, **how):
    """Return the answers to a message, of the types that the request server sends."""
    rig.sent.clear()
    rig.receive(HEARTBEAT, voice=GCS)
    rig.receive(message, voice=voice, **how)
    rig.run(0.5)
    types = ("COMMAND_ACK", "PING", "MISSION_COUNT")
    return [
        one
        for _, one in rig.sent
        if one.get_type() in types or (one.get_type() == "TIMESYNC" and one.tc1)
    ]


@pytest.mark.parametrize(
    ("message", "fields"),
    [
        (COMMAND, UNSUPPORTED),
        (COMMAND_INT, UNSUPPORTED),
        (
            mavlink.MAVLink_ping_message(77, 3, 0, 0),
            {"time_usec": 77, "seq": 3, "target_system": 255, "target_component": 190},
        ),
        (mavlink.MAVLink_timesync_message(0, 12345), {"ts1": 12345}),
        (
            mavlink.MAVLink_mission_request_list_message(*OURS, 1),
            {"count": 0, "mission_type": 1, "target_system": 255, "target_component": 190},
        ),
    ],
    ids=["COMMAND_LONG", "COMMAND_INT", "PING", "TIMESYNC", "MISSION_REQUEST_LIST"],
)
def test_component_request_is_answered_to_its_sender(flying, message, fields):
    (answer,) = answers(flying, message)
    assert {name: getattr(answer, name) for name in fields} == fields


@pytest.mark.parametrize(
    ("message", "how"),
    [
        (mavlink.MAVLink_command_long_message(1, 1, CALIBRATE, 0, 1, 0, 0, 0, 0, 0, 0), {}),
        (COMMAND, {"source": "stranger"}),
        (mavlink.MAVLink_ping_message(77, 3, 1, 191), {}),
        (mavlink.MAVLink_timesync_message(0, 12345), {"voice": OTHER_AUTOPILOT}),
        (mavlink.MAVLink_mission_request_list_message(1, 1), {}),
    ],
    ids=["autopilot", "another address", "answer", "another autopilot", "autopilot's mission"],
)
def test_message_for_other_component_is_not_answered(flying, message, how):
    assert answers(flying, message, **how) == []


def test_flood_of_requests_is_answered_up_to_limit(flying):
    flying.sent.clear()
    for _ in range(100):
        flying.receive(COMMAND, voice=GCS)
    flying.run(1.0)
    assert len([one for _, one in flying.sent if one.get_type() == "COMMAND_ACK"]) == 4
