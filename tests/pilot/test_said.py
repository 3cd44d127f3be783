"""What a pilot says besides setpoints: texts for people, and which streams it asks for."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.codec import Decoder
from circnav_mav.runtime.status import Watch
from tests.flight.lockstep import Flight, flight

WINDY = ('sim.vehicle.dynamics="airborne"', "sim.wind.speed_mps=6.0")


def messages(flown: Flight, kind: str) -> list:
    """All messages of a kind that were sent."""
    found = (message for _, data in flown.sent for message in Decoder().decode(data))
    return [message for message in found if message.get_type() == kind]


def texts(flown: Flight) -> list[str]:
    return [message.text for message in messages(flown, "STATUSTEXT")]


def test_an_outage_of_ranging_is_told_once_and_its_end_once():
    flown = flight("quickstart", 'sim.events=[{at_s=6.0,action="mute_ranging"},{at_s=8.0,action="unmute_ranging"}]')
    said = [text for text in texts(flown.fly(20.0)) if "range" in text]
    assert said == ["circnav: range lost, holding", "circnav: range regained"]


@pytest.mark.parametrize(("settings", "asked"), [((), True), (("ranging.component_id=7",), False)])
def test_the_stream_of_ranges_is_asked_for_only_where_the_autopilot_sends_them(settings, asked):
    flown = flight("quickstart", "ranging.component_id=1", *settings)
    flown.hears = lambda frame, now: int.from_bytes(frame[7:10], "little") != mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR
    asked_for = {command.param1 for command in messages(flown.fly(5.0), "COMMAND_LONG") if command.command == 511}
    assert (mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR in asked_for) is asked
    assert mavlink.MAVLINK_MSG_ID_ATTITUDE in asked_for


def test_a_drift_that_the_circle_does_not_allow_is_said_once_and_shown():
    """6 m/s where (V + W)^2/(V omega_max) <= r_d allows 2.7."""
    flown = flight("quickstart", *WINDY, "vehicle.max_turn_rate_deg_s=12.0", law="auto").fly(60.0)
    (said,) = (text for text in texts(flown) if "allows" in text)
    assert said.startswith(("circnav: drift 6.", "circnav: drift 5."))
    assert said.endswith("m/s, this circle allows 2.7")
    alarms = Watch(flown.pilot).status(flown.ticks[-1], 60.0).alarms
    assert [alarm.split(":")[0] for alarm in alarms] == ["DRIFT TOO STRONG"]


def test_the_ground_station_is_told_which_law_flies_and_of_no_outage_or_drift_where_there_is_none():
    """In a wind that the circle allows."""
    said = texts(flight("quickstart", *WINDY, "vehicle.max_turn_rate_deg_s=20.0", law="auto").fly(60.0))
    assert said[0] == "circnav: engaged, 100 m clockwise"
    laws = [text.split(":")[1].strip() for text in said[1:]]
    assert laws[0] == "feedforward"
    assert "drift" in laws
    assert len(said) == len(set(said))
    assert [text for text in said if "range" in text or "allows" in text] == []
