"""Output of a pilot besides setpoints: texts for people, and stream requests."""

from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.codec import Decoder
from circnav_mav.runtime.onlookers import Onlookers
from circnav_mav.runtime.status import StatusSource
from tests.flight.lockstep import Flight, flight
from tests.rig import LOITER, MISSION, Rig


def flown_in_wind(max_turn_rate: float, seconds: float) -> tuple[Flight, list[str]]:
    """Fly in 6 m/s of wind, where (V + W)^2/(V omega_max) <= r_d allows 2.7 m/s at 12 deg/s. Return the flight and
    its texts."""
    limit = f"vehicle.max_turn_rate_deg_s={max_turn_rate}"
    windy = ('sim.vehicle.dynamics="airborne"', "sim.wind.speed_mps=6.0", limit)
    flown = flight("quickstart", *windy, law="auto").fly(seconds)
    sent = [message for _, data in flown.sent for message in Decoder().decode(data)]
    return flown, [message.text for message in sent if message.get_type() == "STATUSTEXT"]


@pytest.mark.parametrize(("component", "asked"), [(1, True), (7, False)])
def test_the_stream_of_ranges_is_asked_for_only_where_the_autopilot_sends_them(component, asked):
    rig = Rig(ranging=replace(MISSION.ranging, component_id=component))
    rig.run(5.0, lambda: rig.acknowledge(511), ranges=False)
    asked_for = {command.param1 for command in rig.commands(511)}
    assert (mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR in asked_for) is asked
    assert mavlink.MAVLINK_MSG_ID_ATTITUDE in asked_for


def test_a_drift_that_the_circle_does_not_allow_is_said_once_and_shown():
    flown, texts = flown_in_wind(12.0, 30.0)
    (said,) = (text for text in texts if "allows" in text)
    assert said.startswith(("circnav: drift 6.", "circnav: drift 5."))
    assert said.endswith("m/s, this circle allows 2.7")
    alarms = StatusSource(flown.pilot, Onlookers()).status(flown.ticks[-1], 30.0).alarms
    assert [alarm.split(":")[0] for alarm in alarms] == ["DRIFT TOO STRONG"]


def test_an_alarm_is_said_once_as_a_warning_and_its_end_as_news(rig):
    """MAV_SEVERITY_WARNING is 4, NOTICE is 5. A takeover that ends the flight is no second alarm."""
    since = rig.engage().now
    rig.run(2.5, speaks=False)
    rig.run(4.0, speaks=True)
    rig.run(1.0, mode=LOITER)
    said = [(text.severity, text.text.removeprefix("circnav: ")) for text in rig.of("STATUSTEXT", since)]
    said.remove((4, "no attitude"))  # the bench sends no attitude
    taken = "taken over, GUIDED left for LOITER"
    ended = "ended, pilot or failsafe switched to LOITER after"
    assert said[:4] == [(4, "link silent"), (5, "link restored"), (4, taken), (5, ended[:41])]


def test_the_ground_station_is_told_which_law_flies_and_of_no_outage_or_drift_where_there_is_none():
    _, said = flown_in_wind(20.0, 45.0)
    assert said[0] == "circnav: engaged, 100 m clockwise"
    laws = [text.split(":")[1].strip() for text in said[1:]]
    assert laws[0] == "feedforward"
    assert "drift" in laws
    assert len(said) == len(set(said))
    assert [text for text in said if "range" in text or "allows" in text] == []
