"""The status of a flight: reasons for waiting, alarms and data rates, and its picture with 80
columns and 24 lines."""

import io
import re
from dataclasses import replace

import pytest
from rich.console import Console

from circnav_mav.pilot import OutputMode, Phase
from circnav_mav.pilot.status_text import waits_for
from circnav_mav.runtime.display import LiveScreen
from circnav_mav.runtime.listeners import Listeners
from circnav_mav.runtime.picture import Picture
from circnav_mav.runtime.status import StatusSource, status_facts
from tests.flight.lockstep import flight
from tests.rig import Rig

GROUND = ("sim.start.altitude_m=0.0", "sim.start.armed=false", 'sim.start.mode="STABILIZE"')
BACK = "the operator has control: enter GUIDED again to give control to circnav"
STALE = (
    r"RANGE STALE 4\.\d s: holding the circle's turn rate with 20 setpoints per second, "
    r"the flight ends after 10\.5 s without a range"
)


def drawn(*statuses, ascii_only=False, columns=80):
    """Return the picture of the last of these statuses as lines of text."""
    console = Console(width=columns, file=io.StringIO(), color_system=None)
    picture = Picture("small", ascii_only=ascii_only)
    for status in statuses:
        last = picture.draw(status, columns)
    console.print(last)
    return console.file.getvalue().splitlines()


NO_RANGING = "no ranging: no usable DISTANCE_SENSOR"
MANUAL = "engage.request_mode=false"
STATES = {
    "waiting": (0.1, [], None, "waiting for ranging", NO_RANGING, ""),
    "no ranging": (4.0, ["sim.ranging.rate_hz=0.0"], None, "waiting for ranging", NO_RANGING, ""),
    "mode": (4.0, [MANUAL], None, "ready", "mode GUIDED: the operator must enter it", ""),
    "ground": (4.0, GROUND, None, "ready", "the vehicle is on the ground", ""),
    "engaged": (12.0, [], None, "engaged", "", ""),
    "outage": (10.2, [], "outage", "coasting", "", STALE),
    "takeover": (9.0, ['engage.on_takeover="wait"'], "takeover", "yielded", BACK, ""),
    "ended": (9.0, [], "takeover", "ended", "", ""),
    "rejected": (
        8.0,
        ["ranging.bias_m=900.0"],
        None,
        "waiting for ranging",
        "no ranging: ",
        "MOST RANGES REJECTED: .* per second",
    ),
    "silent": (9.0, [], "silence", "waiting for the link", "", r"LINK SILENT for [23]\.\d s; .*"),
}


@pytest.mark.parametrize(
    ("seconds", "overrides", "event", "phase", "waits", "alarms"), STATES.values(), ids=STATES
)
def test_status_shows_phase_reason_and_alarms(
    statuses, seconds, overrides, event, phase, waits, alarms
):
    last = statuses(seconds, *overrides, event=event)[-1]
    assert last.phase == phase
    assert last.view.waits.startswith(waits)
    assert re.fullmatch(alarms, "; ".join(last.alarms))
    lines = drawn(last)
    assert len(lines) <= 24
    assert {len(line) for line in lines} == {80}
    shown = re.sub(r"[│\s]+", " ", "\n".join(lines))
    for words in (
        f" {phase.upper()} ",
        f"mode {last.tick.mode}",
        waits,
        *(alarm[:40] for alarm in last.alarms),
    ):
        assert words in shown
    assert ("alarms none" in shown) is (alarms == "")
    assert "".join(drawn(last, ascii_only=True)[1:-1]).replace("│", "").isascii()


def during(statuses, phase):
    return [status for status in statuses if status.tick.phase.value == phase]


def test_status_of_normal_flight_has_rates_and_no_alarm(statuses):
    seen = statuses(12.0)
    assert [status.alarms for status in seen if status.alarms] == []
    last = seen[-1]
    assert 9 < last.view.rates.taken <= 11  # ranges at 10 Hz
    assert 40 < last.view.rates.frames < 100
    assert last.view.rates.setpoints > 9
    assert "law         smooth" in "\n".join(drawn(last))
    flown = during(seen, "engaged")
    assert [status.flown for status in seen if status.time < flown[0].time] == [None] * seen.index(
        flown[0]
    )
    engaged = flown[0].time - flown[0].flown
    assert seen[0].time < engaged <= flown[0].time
    assert [status.time - status.flown for status in flown] == pytest.approx([engaged] * len(flown))


def test_status_counts_rejected_ranges_by_reason(statuses):
    """PX4 sends the radio's ranges again under its own id."""
    rejecting = statuses(8.0, "ranging.bias_m=900.0")[-1]
    assert list(rejecting.rejected) == ["no_range"]
    assert re.search(r"rejected +\d+ of \d+: \d+ no_range", "\n".join(drawn(rejecting)))
    assert statuses(10.2, event="outage")[-1].view.rates.taken == 0
    flown = flight("px4_copter")
    assert waits_for(flown.pilot, 0.0) == "no autopilot heartbeat, 0 bytes received"
    flown.fly(8.0)
    status = StatusSource(flown.pilot, Listeners()).status(flown.ticks[-1], 8.0)
    assert status.others > 30
    assert "wrong_source" not in status.rejected
    assert flown.ticks[-1].rejected == sum(status.rejected.values())


def test_status_shows_dry_run_and_reason_for_law(statuses):
    seen = statuses(9.0, event="takeover", law="auto")
    assert {bool(status.why) for status in during(seen, "engaged")} == {True}
    assert {status.why for status in seen if status.tick.law == ""} == {""}
    assert seen[-1].tick.law == ""
    dry = statuses(6.0, output=OutputMode.DRY_RUN)[-1]
    assert (dry.phase, dry.view.setpoints) == ("would steer", 0)
    shown = "\n".join(drawn(dry))
    assert "DRY RUN: no setpoint" in shown


def test_status_shows_no_range_age_for_lost_vehicle(statuses):
    flown = statuses(30.0, "limits.coast_s=2.0", event="gone")
    old = [status.tick for status in flown if (status.tick.range_age or 0.0) > 2.6]
    assert old
    assert {(tick.r, tick.r_dot) for tick in old} == {(None, None)}


def test_status_shows_target_drift_and_recording_problem():
    """The vehicle is 30 m east and 40 m south of the target, and the drift is to the north."""
    flown = flight("quickstart").fly(6.0)
    tick = replace(
        flown.ticks[-1], x=30.0, y=-40.0, drift_x=0.0, drift_y=2.0, turn_gain=0.72, turn_delay=0.46
    )
    status = StatusSource(flown.pilot, Listeners()).status(tick, 6.0, "disk full")
    assert status.target == "bearing 323 deg, drift 2.0 m/s towards 000 deg"
    assert status.alarms == ("NOT RECORDING: disk full",)
    lines = "\n".join(drawn(status))
    assert " m horizontal, desired 100.0 m" in lines
    assert "deg/s (limit 20.0), gain 0.72, delay 0.46 s" in lines
    assert f"target      {status.target}" in lines


def test_status_picture_uses_width_of_terminal(statuses):
    """The bar has 41 cells at 80 columns and 101 cells at 140 columns. At 140 columns no text is
    shortened."""
    for columns, cells in ((60, 41), (80, 41), (140, 101)):
        picture = Picture("small", ascii_only=False).draw(statuses(12.0)[-1], columns)
        assert picture.width == max(columns, 80)
        assert (
            max(
                sum(line.count(sign) for sign in "─┼●")
                for line in picture.renderable.plain.splitlines()
            )
            == cells
        )
    waits = statuses(8.0, "ranging.bias_m=900.0")[-1]
    assert [" ... " in "\n".join(drawn(waits, columns=columns)) for columns in (80, 140)] == [
        True,
        False,
    ]


@pytest.mark.parametrize("height", [6, 14])
def test_status_picture_on_short_terminal_shows_phase_and_alarm(statuses, height):
    """On a low terminal the picture omits its last rows. The first picture is written by the
    display's thread, because writing may block forever."""
    console = Console(
        width=80, height=height, file=io.StringIO(), color_system=None, force_terminal=True
    )
    screen = LiveScreen(console, Picture("small", ascii_only=False))
    assert console.file.getvalue() == ""
    screen.draw(statuses(10.2, event="outage")[-1])
    seen = console.file.getvalue()
    screen.close()
    assert [words in seen for words in (" COASTING ", "RANGE STALE", "Ctrl-C ends")] == [
        True,
        True,
        False,
    ]


def test_status_bars_and_sparkline_follow_turn_and_error(statuses):
    """The circle is clockwise, so the vehicle turns right. It approaches from outside the
    circle."""
    far = next(line for line in drawn(statuses(6.0)[-1]) if line.startswith("│             0 "))
    assert far.rstrip(" │").endswith("> 200 m")
    picture = Picture("small", ascii_only=False)
    flown = statuses(40.0)
    for status in flown:
        lines = picture.draw(status).renderable.plain.splitlines()
    turn = next(line for line in lines if "left " in line)
    assert flown[-1].tick.turn_rate < 0
    assert turn.index("●") > turn.index("┼")
    error = next(line for line in lines if line.startswith("error"))
    levels = ["▁▂▃▄▅▆▇█".index(mark) for mark in error if mark in "▁▂▃▄▅▆▇█"]
    assert len(levels) == 21  # each level of the sparkline covers 2 s
    assert (levels[0], levels[-1]) == (7, 0)
    assert re.search(r" 40 s, max 21\d\.\d m$", error.rstrip())


@pytest.mark.parametrize(
    ("seconds", "event"), [(12.0, None), (9.0, "takeover")], ids=["engaged", "ended"]
)
def test_every_row_of_status_has_value(statuses, seconds, event):
    facts = status_facts(statuses(seconds, event=event)[-1])
    assert {name: text for name, text in facts.items() if re.search(r"(^| )-(,| |$)", text)} == {}


def test_long_status_texts_are_complete_at_80_columns(statuses):
    flown = statuses(6.0)[-1]
    senders = "1/1 at 192.168.144.11:14550, ranges of 1/192 at 192.168.144.12:14560"
    tick = replace(flown.tick, saturated=True, turn_rate=-0.349)
    lines = drawn(
        replace(
            flown,
            tick=tick,
            view=replace(flown.view, trusted=senders),
            rejected={"a_reason_of_some_length": 1000000} | flown.rejected,
        )
    )
    seen = next(line for line in lines if "senders" in line)
    assert seen.strip("│ ") == "senders     1/1 at 192.168.144.11:14550, ranges of 1/192 at ..."
    assert re.search(
        r"heartbeat \d\.\d\d s old +│", next(line for line in lines if "│ link " in line)
    )
    assert "commanded -20.0 deg/s (AT LIMIT 20.0)" in "\n".join(lines)


# --- an alarm requires an action


def alarms_of(name, seconds, *overrides):
    """Return all alarms of the first seconds of a bundled flight."""
    under_way = flight(name, *overrides)
    found = set()
    watch = StatusSource(under_way.pilot, Listeners())
    under_way.fly(
        seconds, lambda f: f.ticks and found.update(watch.status(f.ticks[-1], f.now).alarms)
    )
    assert under_way.pilot.mission.phase is Phase.ENGAGED
    return found


@pytest.mark.parametrize(
    ("name", "rate", "seconds"), [("arduplane", 1.0, 40.0), ("arducopter", 100.0, 20.0)]
)
def test_radio_matching_mission_raises_no_alarm(name, rate, seconds):
    lost = "sim.ranging.dropout_fraction=0.1"
    radio = (f"ranging.rate_hz={rate}", f"sim.ranging.rate_hz={rate}", lost)
    assert alarms_of(name, seconds, *radio) == set()


def test_unknown_height_is_shown_as_reason_for_waiting():
    rig = Rig("orbit.target_altitude_m=500.0").run(5.0)
    watch = StatusSource(rig.pilot, Listeners())
    for _ in range(10):
        status = watch.status(rig.run(0.5).pilot.take_records()[-1], rig.now)
    assert status.alarms == () and status.rejected["no_height"] > 90
    assert status.view.waits.startswith("no altitude (VFR_HUD.alt)")


def test_low_setpoint_rate_raises_alarm():
    """The loop steps only twice per second, so setpoints are up to 0.5 s late in every phase."""
    rig = Rig().engage()
    watch = StatusSource(rig.pilot, Listeners())
    found = []
    for n in range(60):
        rig.pass_time(0.45)
        rig.heartbeat()
        rig.range()
        rig.step()
        if n % 2:
            records = rig.pilot.take_records()
            found = list(watch.status(records[-1], rig.now).alarms)
    (few,) = [alarm for alarm in found if alarm.startswith("SETPOINT RATE LOW")]
    assert re.match(
        r"SETPOINT RATE LOW: only [012]\.\d of 20 per second are sent: the computer is overloaded",
        few,
    )
