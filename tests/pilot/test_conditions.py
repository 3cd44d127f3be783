"""The table of conditions, which contains the texts of display, STATUSTEXT and documentation.
Requests of missing streams."""

from dataclasses import replace
from itertools import takewhile
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.guidance.monitors import AirspeedAlarm, ClosingAlarm, DriftAlarm, LapAlarm
from circnav_mav.mav.codec import Decoder
from circnav_mav.mav.identity import OUR_NAME, RADIO_NAME, VEHICLE_NAME
from circnav_mav.pilot.conditions import ENDED, LOST, TABLE
from circnav_mav.pilot.mission_state import Ending, Outcome, Phase
from circnav_mav.pilot.rates import Rates
from circnav_mav.pilot.step_view import StepView
from circnav_mav.runtime.listeners import Listeners
from circnav_mav.runtime.status import StatusSource
from tests.flight.lockstep import Flight, flight
from tests.rig import LOITER, Rig

TROUBLESHOOTING = (Path(__file__).parents[2] / "docs" / "troubleshooting.md").read_text()


def texts(rig: Rig) -> list[str]:
    return [text.removeprefix("circnav: ") for text in rig.texts()]


def views() -> list[StepView]:
    """Return step views in which each condition of the table is active at least once."""
    view = Rig().engage().pilot.view
    assert view is not None
    identities = (VEHICLE_NAME, OUR_NAME, RADIO_NAME)
    coasting = replace(
        view,
        phase=Phase.COASTING,
        range_age=5.0,
        link_age=1.0,
        gain_share=0.5,
        outcome=Outcome(Ending.ABORTED, "battery at 5 %"),
        second_senders=tuple(f"{name} has a second sender" for name in identities),
        second_controller="the vehicle flies +20 deg/s, commanded -3 deg/s",
        flood=468.0,
        uplink_silent=True,
        stalled=1.0,
        clock_speed=0.25,
        full_rates=Rates(50.0, 0.0, 10.0, 20.0),
        steered_rates=Rates(50.0, 0.0, 10.0, 2.0),
        one_way=2.0,
        frozen_for=12.0,
        jumped_by=-120.0,
        noise_found=(0.3, 2.5),
        noise_lowered=(5.0, 0.2),
        range_rate_trouble="it differs from the ranges",
        sensor_clock_doubted=True,
        source_choice="2 range sources: set component_id",
        lost_reports=tuple(LOST),
        failed_imu="RAW_IMU",
        used_imu="",
        heading_jump=1.0,
        height_held=True,
        altitude_jump=300.0,
        implausible_airspeed=99.0,
        unchecked_bound="no battery in SYS_STATUS: bounds.min_battery_percent needs it",
        not_airborne="5 m of height",
        method_failure="",
        drift_alarm=DriftAlarm(on=True, drift=6.0, allowed=2.7),
        closing_alarm=ClosingAlarm(True, 2100.0, 18.0, 15.4),
        lap_alarm=LapAlarm(by_ranges=150.0, by_turns=192.4, on=True),
        circle=replace(view.circle, radius=120.0),
        flown_law="drift",
        why="drift: wind 5 m/s",
        follows=False,
        lean_share=0.8,
        lean_limit=0.4,
        bank_limit=0.5,
    )
    stale = replace(
        coasting,
        phase=Phase.ENGAGED,
        link_age=3.0,
        height=20.0,
        drift_alarm=DriftAlarm(),
    )
    alarmed = replace(coasting, lap_alarm=LapAlarm())
    return [coasting, stale, alarmed, replace(stale, airspeed_alarm=AirspeedAlarm(True, 4.6, 0.2))]


VIEWS = views()


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)
def test_alarm_text_fits_statustext_and_has_documented_title(row):
    found = [active for view in VIEWS if (active := row.find(view)) is not None]
    assert found and len(row.over) <= 41
    for active in found:
        title = " ".join(takewhile(str.isupper, active.long.partition(":")[0].split()))
        assert active.short or active.long
        assert len(active.short) <= 41
        assert row is ENDED or title in TROUBLESHOOTING


@pytest.mark.parametrize("title", ["NOT RECORDING", "EXTERNAL POSITION", "RANGING"])
def test_alarms_outside_condition_table_are_documented(title):
    assert title in TROUBLESHOOTING


def test_display_and_statustext_show_texts_of_condition_table(rig):
    rig.engage().run(2.0, ranges=False)
    alarm = rig.pilot.conditions.alarms["coasting"]
    assert alarm.startswith("RANGE STALE ") and "setpoints per second" in alarm
    rig.run(2.0, ranges=True)
    assert rig.pilot.conditions.alarms.keys() == {"no_attitude"}, "the rig sends no attitude"
    assert [text for text in texts(rig) if "range" in text] == [
        "range lost, coasting",
        "range regained",
    ]


def test_takeover_ends_steering_alarms_without_further_text():
    rig = Rig("engage.on_takeover=wait").engage()
    rig.run(2.0, ranges=False).run(1.0, mode=LOITER, ranges=False)
    assert rig.pilot.mission.phase is Phase.YIELDED
    assert list(rig.pilot.conditions.alarms) == ["range_stale"]
    assert texts(rig)[-2:] == ["range lost, coasting", "taken over, GUIDED left for LOITER"]


def test_lost_uplink_and_lost_downlink_are_separate_alarms():
    rig = Rig().engage()
    rig.run(3.0, round_trip=None)
    assert {"uplink_silent", "link_silent"} & rig.pilot.conditions.alarms.keys() == {
        "uplink_silent"
    }
    rig.run(3.0, speaks=False, ranges=False)
    assert {"uplink_silent", "link_silent"} & rig.pilot.conditions.alarms.keys() == {"link_silent"}
    assert rig.pilot.conditions.alarms["link_silent"].startswith("LINK SILENT for ")


def flown_in_wind(max_turn_rate: float, seconds: float) -> tuple[Flight, list[str]]:
    """Fly in a wind of 6 m/s with a turn limit of 12 deg/s, at which (V + W)^2/(V omega_max) <= r_d
    allows a wind of 2.7 m/s. Return the flight and its texts."""
    limit = f"vehicle.max_turn_rate_deg_s={max_turn_rate}"
    windy = ('sim.vehicle.dynamics="airborne"', "sim.wind.speed_mps=6.0", "sim.seed=2", limit)
    flown = flight("quickstart", *windy, law="auto").fly(seconds)
    sent = [message for _, data in flown.sent for message in Decoder().decode(data)]
    return flown, [message.text for message in sent if message.get_type() == "STATUSTEXT"]


@pytest.mark.parametrize(("component", "asked"), [(1, True), (7, False)])
def test_range_stream_is_requested_only_from_autopilot(component, asked):
    rig = Rig(f"ranging.component_id={component}")
    rig.run(5.0, lambda: rig.acknowledge(511), ranges=False)
    asked_for = {command.param1 for command in rig.commands(511)}
    assert (mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR in asked_for) is asked
    assert mavlink.MAVLINK_MSG_ID_ATTITUDE in asked_for


def test_excessive_drift_is_reported_once_and_displayed():
    flown, texts = flown_in_wind(12.0, 30.0)
    (said,) = (text for text in texts if "allows" in text)
    assert said.startswith(("circnav: wind 6.", "circnav: wind 5."))
    assert said.endswith("m/s, circle allows 2.7 m/s")
    alarms = StatusSource(flown.pilot, Listeners()).status(flown.ticks[-1], 30.0).alarms
    assert [alarm.split(":")[0] for alarm in alarms] == ["WIND TOO STRONG"]


def test_alarm_sends_one_warning_and_one_end_text(rig):
    """MAV_SEVERITY_WARNING is 4 and NOTICE is 5. A takeover that ends the flight raises no further
    alarm."""
    since = rig.engage().now
    rig.run(2.5, speaks=False)
    rig.run(4.0, speaks=True)
    rig.run(1.0, mode=LOITER)
    said = [
        (text.severity, text.text.removeprefix("circnav: ")) for text in rig.of("STATUSTEXT", since)
    ]
    said.remove((4, "no attitude"))  # the rig sends no attitude
    taken = "taken over, GUIDED left for LOITER"
    ended = "ended, pilot or failsafe switched to LOITER after"
    assert said[:4] == [(4, "link silent"), (5, "link restored"), (4, taken), (5, ended[:41])]


def test_statustext_names_each_law_once():
    _, said = flown_in_wind(20.0, 35.0)
    assert said[0] == "circnav: engaged, 100 m clockwise"
    laws = [text.split(":")[1].strip() for text in said[1:]]
    assert laws[0] == "feedforward"
    assert "drift" in laws
    assert len(said) == len(set(said))
    assert [text for text in said if "range" in text or "allows" in text] == []


def test_bank_limit_equal_to_mission_limit_is_not_reported():
    view = VIEWS[0]
    (row,) = (row for row in TABLE if row.name == "bank_limit")
    most = view.settings.facts.max_bank
    assert row.find(replace(view, bank_limit=0.99 * most)) is None
    assert row.find(replace(view, bank_limit=0.8 * most)) is not None
