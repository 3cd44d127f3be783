"""Positions never steer: with and without locator and external position, the pilot sends the same
bytes.

test_external_position.py tests a complete flight.
"""

from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.extras.external_position import companion
from circnav_mav.extras.external_position.companion import COMMANDS, Companion
from circnav_mav.extras.external_position.settings import ExternalPositionSettings
from circnav_mav.extras.locate.estimator import locate
from circnav_mav.extras.locate.locator import SENT_TYPES, Locator
from circnav_mav.pilot import VEHICLE
from circnav_mav.pilot.mission_state import Phase
from tests.rig import Rig, decode

SETPOINTS = {
    "SET_POSITION_TARGET_LOCAL_NED",
    "SET_ATTITUDE_TARGET",
    "MANUAL_CONTROL",
    "SET_POSITION_TARGET_GLOBAL_INT",
}
ALLOWED = SENT_TYPES | companion.SENT_TYPES


class LocatingRig(Rig):
    """A rig with locator and external position beside its pilot."""

    def __init__(self, **changes):
        super().__init__(**changes)
        self.locator = Locator(194, self.pilot)
        self.companion = Companion(
            ExternalPositionSettings(193, (47.3, 8.5)), self.pilot, self.locator
        )
        self.beside: list[bytes] = []

    def receive(self, message, **how):
        super().receive(message, **how)
        self.show(how.get("source") or self.source)

    def show(self, source):
        frames = self.pilot.take_frames()
        self.locator.on_frames(VEHICLE, source, frames, self.now)
        self.companion.on_frames(VEHICLE, source, frames, self.now)

    def step(self):
        messages = super().step()
        if (job := self.locator.job(self.now)) is not None and self.tick % 40 == 0:
            self.locator.found(locate(*job))
        self.beside += self.locator.step(self.now)
        self.beside += self.companion.step(self.now)
        return messages


def circling(latitude, longitude, tick):
    return mavlink.MAVLink_global_position_int_message(
        50 * tick, latitude + 40 * tick, longitude, 500_000, 40_000, 1500, 0, 0, 0
    )


FALSE_POSITIONS: dict[str, Callable[[int], list[Any]]] = {
    "a position that runs away": lambda tick: [
        mavlink.MAVLink_gps_raw_int_message(50_000 * tick, 3, 0, 0, 0, 1, 1, 0, 0, 9),
        circling(473_000_000, 85_000_000, tick),
    ],
    "a fix that comes and goes, and jumps by kilometres": lambda tick: [
        mavlink.MAVLink_gps_raw_int_message(
            50_000 * tick, 3 * (tick // 30 % 2), 0, 0, 0, 1, 1, 0, 0, 9
        ),
        circling(473_000_000 + 1_000_000 * (tick // 45 % 2), 85_000_000, tick),
    ],
    "no fix, and every answer a yes": lambda tick: [
        mavlink.MAVLink_gps_raw_int_message(50_000 * tick, 1, 0, 0, 0, 1, 1, 0, 0, 9),
        circling(473_000_000, 85_000_000, tick),
        mavlink.MAVLink_command_ack_message(
            mavlink.MAV_CMD_EXTERNAL_POSITION_ESTIMATE, 0, 0, 0, 1, 193
        ),
    ],
}


@pytest.mark.parametrize("lie", FALSE_POSITIONS.values(), ids=FALSE_POSITIONS)
def test_false_positions_change_no_output(lie):
    honest = Rig()
    deceived = LocatingRig()
    for tick in range(160):
        honest.run(0.05)
        deceived.run(0.05)
        for message in lie(tick):
            # The frames do not use the vehicle's sequence numbers: the honest rig receives none of
            # them.
            frame = deceived.vehicle.pack(message)
            deceived.pilot.receive(frame, deceived.now, deceived.source)
            deceived.show(deceived.source)
    assert honest.pilot.mission.phase is Phase.ENGAGED
    assert deceived.raw == honest.raw
    sent_messages = [message for frame in deceived.beside for message in decode(frame)]
    assert sent_messages
    assert {one.get_type() for one in sent_messages} <= ALLOWED and not ALLOWED & SETPOINTS
    assert {
        one.command for one in sent_messages if one.get_type().startswith("COMMAND")
    } <= COMMANDS
    assert {one.get_srcComponent() for one in sent_messages} == {193, 194}


def test_late_position_stamps_do_not_change_timesync():
    """The stamps of the positions look like a clock step. The vehicle no longer answers
    TIMESYNC."""

    def flown(kind, late):
        rig = kind()

        def positions():
            lag = late if rig.tick >= 215 else 0
            rig.receive(
                mavlink.MAVLink_gps_raw_int_message(50_000 * rig.tick, 3, 0, 0, 0, 1, 1, 0, 0, 9)
            )
            rig.receive(circling(473_000_000, 85_000_000, rig.tick - lag))

        rig.run(8.0, positions)
        return rig.run(6.0, positions, round_trip=None).raw

    assert flown(LocatingRig, 8) == flown(LocatingRig, 0) == flown(Rig, 8)


def test_locator_refuses_to_send_setpoints():
    rig = LocatingRig()
    for message in (
        mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 0, [1, 0, 0, 0], 0, 0, 0, 0),
        mavlink.MAVLink_command_long_message(
            1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, 4, 0, 0, 0, 0, 0
        ),
    ):
        with pytest.raises(ValueError, match="must not send"):
            rig.locator._encode(message)
