"""The table of conditions: one row feeds display, STATUSTEXT and documentation."""

from contextlib import suppress
from importlib import import_module
from itertools import takewhile
from pathlib import Path

import pytest

from circnav_mav.pilot import conditions
from circnav_mav.pilot.conditions import TABLE, Condition
from circnav_mav.pilot.mission_state import Phase
from tests.rig import LOITER, Rig

MODULES = [conditions]
with suppress(ModuleNotFoundError):  # the core flies without its extras
    MODULES.append(import_module("circnav_mav.extras.locate.conditions"))
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
    assert [text for text in texts(rig) if "range" in text] == ["range lost, holding", "range regained"]


def test_a_condition_of_steering_ends_without_a_text_if_the_operator_takes_the_vehicle():
    rig = Rig(end_on_takeover=False).engage()
    rig.run(2.0, ranges=False).run(1.0, mode=LOITER, ranges=False)
    assert rig.pilot.mission.phase is Phase.YIELDED
    assert list(rig.pilot.conditions.alarms) == ["range_stale"]
    assert texts(rig)[-2:] == ["range lost, holding", "taken over, GUIDED left for LOITER"]


def test_a_vehicle_that_receives_nothing_and_one_that_sends_nothing_are_two_alarms():
    rig = Rig().engage()
    rig.run(3.0, round_trip=None)
    assert {"uplink_silent", "link_silent"} & rig.pilot.conditions.alarms.keys() == {"uplink_silent"}
    rig.run(3.0, speaks=False, ranges=False)
    assert {"uplink_silent", "link_silent"} & rig.pilot.conditions.alarms.keys() == {"link_silent"}
    assert rig.pilot.conditions.alarms["link_silent"].startswith("LINK SILENT for ")
