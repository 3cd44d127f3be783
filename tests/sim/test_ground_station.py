"""Requests that QGroundControl sends while it connects (InitialConnectStateMachine,
ParameterManager, PlanManager, LogDownload). Each must be answered, because QGroundControl repeats
an unanswered request and waits."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.sim.station import Station, build

REQUEST_MESSAGE = 512
SET_INTERVAL = 511
GCS = 6
QGROUNDCONTROL = (255, 190)
MISSION_TYPES = (0, 1, 2)  # mission, fence, rally points
# FILE_TRANSFER_PROTOCOL: open the parameter file for reading
FTP = [0, 0, 0, 4, 15, *[0] * 7, *b"@PARAM/param.pck", *[0] * 223]


def asked(number: int, *params: float) -> mavlink.MAVLink_command_long_message:
    return mavlink.MAVLink_command_long_message(
        1, 1, number, 0, *params, *[0.0] * (7 - len(params))
    )


QUESTIONS = {
    "autopilot version": (asked(REQUEST_MESSAGE, 148), {"AUTOPILOT_VERSION", "COMMAND_ACK"}),
    "protocol version": (asked(REQUEST_MESSAGE, 300), {"COMMAND_ACK"}),
    "available modes": (asked(REQUEST_MESSAGE, 435), {"COMMAND_ACK"}),
    "component metadata": (asked(REQUEST_MESSAGE, 397), {"COMMAND_ACK"}),
    "home": (asked(REQUEST_MESSAGE, 242), {"HOME_POSITION", "COMMAND_ACK"}),
    "a stream": (asked(SET_INTERVAL, 30, 250_000), {"COMMAND_ACK"}),
    "parameters by file": (
        mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, FTP),
        {"FILE_TRANSFER_PROTOCOL"},
    ),
    "parameters": (mavlink.MAVLink_param_request_list_message(1, 1), {"PARAM_VALUE"}),
    "logs": (mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF), {"LOG_ENTRY"}),
}
for number in MISSION_TYPES:
    QUESTIONS[f"mission {number}"] = (
        mavlink.MAVLink_mission_request_list_message(1, 1, number),
        {"MISSION_COUNT"},
    )
    QUESTIONS[f"no mission {number}"] = (
        mavlink.MAVLink_mission_clear_all_message(1, 1, number),
        {"MISSION_ACK"},
    )


@pytest.mark.parametrize(
    "profile", ["arducopter", "arduplane", "ardurover", "px4_copter", "px4_plane"]
)
def test_emulator_answers_every_request_of_qgroundcontrol(profile):
    station = Station(
        build(vehicle={"profile": profile, "default_streams": False}), *QGROUNDCONTROL
    )
    station.heartbeat(GCS)
    station.wait(1.0)
    assert {"HEARTBEAT"} <= {message.get_type() for message in station.listen()}
    for name, (question, kinds) in QUESTIONS.items():
        station.forget()
        station.send(question)
        answers = station.listen(*kinds)
        assert {message.get_type() for message in answers} == kinds, name
        for answer in answers:
            assert getattr(answer, "mission_type", None) == getattr(
                question, "mission_type", None
            ), name
            assert getattr(answer, "num_logs", 0) == 0
