"""The table of conditions, of which one row feeds display, STATUSTEXT and documentation, and stream
requests."""

from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from itertools import takewhile
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mav.codec import Decoder
from circnav_mav.pilot import conditions
from circnav_mav.pilot.conditions import TABLE, Condition
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.runtime.onlookers import Onlookers
from circnav_mav.runtime.status import StatusSource
from tests.flight.lockstep import Flight, flight
from tests.rig import LOITER, MISSION, Rig

MODULES = [conditions]
for extra in ("locate", "handback"):
    with suppress(ModuleNotFoundError):  # the core flies without its extras
        MODULES.append(import_module(f"circnav_mav.extras.{extra}.conditions"))
RAISED = [row for module in MODULES for row in vars(module).values() if isinstance(row, Condition)]
ROWS = list({row.name: row for row in (*TABLE, *RAISED)}.values())
TROUBLESHOOTING = (Path(__file__).parents[2] / "docs" / "troubleshooting.md").read_text()


def texts(rig: Rig) -> list[str]:
    return [text.removeprefix("circnav: ") for text in rig.texts()]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_each_condition_is_sent_or_shown_fits_one_statustext_and_is_documented(row):
    title = " ".join(takewhile(str.isupper, row.long.partition(":")[0].split()))
    assert row.short or row.long
    assert len(row.over) <= 41 and len(row.short.partition("{")[0]) <= 41
    assert title in TROUBLESHOOTING


def test_the_table_is_read_by_display_and_statustext_from_begin_to_end(rig):
    rig.engage().run(2.0, ranges=False)
    alarm = rig.pilot.conditions.alarms["holding"]
    assert alarm.startswith("RANGE STALE ") and "setpoints per second" in alarm
    rig.run(2.0, ranges=True)
    assert rig.pilot.conditions.alarms.keys() == {"no_attitude"}, "which the bench does not send"
    assert [text for text in texts(rig) if "range" in text] == [
        "range lost, holding",
        "range regained",
    ]


def test_a_condition_of_steering_ends_without_a_text_if_the_operator_takes_the_vehicle():
    rig = Rig(end_on_takeover=False).engage()
    rig.run(2.0, ranges=False).run(1.0, mode=LOITER, ranges=False)
    assert rig.pilot.mission.phase is Phase.YIELDED
    assert list(rig.pilot.conditions.alarms) == ["range_stale"]
    assert texts(rig)[-2:] == ["range lost, holding", "taken over, GUIDED left for LOITER"]


def test_a_vehicle_that_receives_nothing_and_one_that_sends_nothing_are_two_alarms():
    rig = Rig().engage()
    rig.run(3.0, round_trip=None)
    assert {"uplink_silent", "link_silent"} & rig.pilot.conditions.alarms.keys() == {
        "uplink_silent"
    }
    rig.run(3.0, speaks=False, ranges=False)
    assert {"uplink_silent", "link_silent"} & rig.pilot.conditions.alarms.keys() == {"link_silent"}
    assert rig.pilot.conditions.alarms["link_silent"].startswith("LINK SILENT for ")


def flown_in_wind(max_turn_rate: float, seconds: float) -> tuple[Flight, list[str]]:
    """Fly in 6 m/s of wind, where (V + W)^2/(V omega_max) <= r_d allows 2.7 m/s at 12 deg/s. Return
    the flight and its texts."""
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
    assert said.endswith("m/s, circle allows 2.7 m/s")
    alarms = StatusSource(flown.pilot, Onlookers()).status(flown.ticks[-1], 30.0).alarms
    assert [alarm.split(":")[0] for alarm in alarms] == ["DRIFT TOO STRONG"]


def test_an_alarm_is_said_once_as_a_warning_and_its_end_as_news(rig):
    """MAV_SEVERITY_WARNING is 4, NOTICE is 5. A takeover that ends the flight is no second
    alarm."""
    since = rig.engage().now
    rig.run(2.5, speaks=False)
    rig.run(4.0, speaks=True)
    rig.run(1.0, mode=LOITER)
    said = [
        (text.severity, text.text.removeprefix("circnav: ")) for text in rig.of("STATUSTEXT", since)
    ]
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
