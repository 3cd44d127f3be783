"""The charts of report and live page, drawn by their script without a browser, and their data."""

import json
import re

import numpy as np
import pytest
import quickjs

from circnav_mav.guidance.types import Direction, Orbit
from circnav_mav.report.chart_data import alarms, as_script, chart_data, peaks, stretches
from circnav_mav.report.charts import CHARTS
from circnav_mav.runlog.events import Event
from circnav_mav.runlog.ticks import read_ticks, read_truth
from tests.runlog.conftest import EPOCH_US

FLIGHT = {"radius": 100.0, "tolerance": 5.0, "limit": 0.35, "steady": -0.15, "gate": 5.0}
# size of a chart in pixels, and of the area inside its frame
WIDTH = 1000
LEFT = 54
WIDE = 934
TALL = 162


def script(expression, **values):
    """Evaluate a JavaScript expression with `Charts` and these variables defined."""
    context = quickjs.Context()
    context.eval(CHARTS.read_text(encoding="utf-8") + "globalThis.Charts = Charts;")
    for name, value in values.items():
        context.eval(f"globalThis.{name} = {json.dumps(value)}")
    return json.loads(context.eval(f"JSON.stringify({expression})"))


def strip(times, values, view, **chart):
    line = {
        "name": "a",
        "colour": "estimate",
        "times": times,
        "values": values,
        **chart.pop("line", {}),
    }
    return script(
        f"Charts.strip(chart, view, {WIDTH}, marked)",
        chart={"lines": [line], **chart},
        view=view,
        marked=chart.pop("marked", []),
    )


def path(drawn, kind="line estimate"):
    return re.search(f'<path d="([^"]*)" class="{kind}"/>', drawn)[1]


def points(drawn):
    return [
        tuple(map(float, point)) for point in re.findall(r"[ML](-?[\d.]+),(-?[\d.]+)", path(drawn))
    ]


# --- strips


def test_chart_line_is_clipped_by_its_frame():
    """A line rises from 0 to 10 in 10 s in a frame that shows values up to 1. It leaves the frame
    after 1 s and does not continue along the frame."""
    for values in ([None, None], [5, 5], [0, 0], [-1e-9, 1e9]):
        assert not re.search("NaN|Infinity|undefined", strip([0, 1], values, [0, 1])), values
    drawn = strip([0, 10, 20], [0, 10, 10], [0, 20], shown=[-1, 1])
    assert f'<svg x="{LEFT}" y="8" width="{WIDE}" height="{TALL}">' in drawn
    assert points(drawn) == [(0.0, 81.0), (467.0, -729.0), (934.0, -729.0)]


@pytest.mark.parametrize(
    ("values", "chart", "kind", "drawn"),
    [
        (
            [1, 1, None, 1, 1],
            {"shown": [0, 2]},
            "line",
            "M0.0,81.0L233.5,81.0M700.5,81.0L934.0,81.0",
        ),
        ([0.5, 3, -3], {"shown": [0, 1], "line": {"dots": True}}, "dots", "M0.0,81.0h0"),
        (
            [0.5, 3, -3],
            {"shown": [0, 1], "line": {"dots": True}},
            "filled beyond",
            "M467.0,0l-3,5h6ZM934.0,162l-3,-5h6Z",
        ),
        (
            [2, 0, None],
            {"shown": [0, 4], "line": {"bars": True}},
            "filled",
            "M0.0,162V81.0H467.0V162Z",
        ),
    ],
    ids=[
        "line with gap",
        "dots",
        "dots outside the frame are triangles at its edge",
        "bars",
    ],
)
def test_chart_lines_are_drawn_with_gaps_dots_or_bars(values, chart, kind, drawn):
    times = list(range(len(values)))
    assert path(strip(times, values, [0, times[-1]], **chart), f"{kind} estimate") == drawn


def test_chart_with_fixed_limits_shows_distant_values():
    """A vehicle far from its circle has an error outside the limits of the error chart."""
    drawn = strip([0, 10], [15, 5], [0, 10], shown=[-15, 15])
    assert points(drawn) == [(0.0, 0.0), (934.0, 54.0)]
    drawn = strip([0, 10], [200, 105], [0, 10], shown=[-15, 15])
    assert [0 < y < TALL for _, y in points(drawn)] == [True, True]


def test_columns_without_data_give_no_chart():
    columns = {
        "r": [[0, 1], [99, 101]],
        "turn_rate": [[0, 1], [0.1, 0.2]],
        "true_r": [[0, 1], [None, None]],
    }
    charts = script("Charts.resolve(flight, columns)", flight=FLIGHT, columns=columns)
    assert [chart["title"] for chart in charts] == [
        "range",
        "error, range - radius",
        "turn rate, left positive",
    ]
    assert [line["name"] for line in charts[0]["lines"]] == ["estimated"]
    assert charts[1]["lines"][0]["values"] == [-1, 1]
    # the chart shows deg/s, the data are in rad/s
    assert charts[2]["lines"][0]["values"] == pytest.approx([5.7296, 11.4592], abs=1e-3)


# --- words over time, and marks


def test_chart_band_gives_each_word_a_constant_color():
    spans = stretches(np.arange(6.0), ["a", "a", "b", "b", "a", "a"])
    assert spans == [(0.0, 2.0, "a"), (2.0, 4.0, "b"), (4.0, 5.0, "a")]
    drawn = script(f"Charts.band(spans, [0, 5], {WIDTH})", spans=spans)
    assert re.findall('class="stretch (other[01])"', drawn) == ["other0", "other1", "other0"]
    assert "<i>" not in script(f"Charts.band([[0, 1, '<i>']], [0, 1], {WIDTH})")
    assert "<" not in as_script({"mode": "</script>"})
    for words in ("coasting", "would coast", "yielded", "GUIDED", "drift"):
        first, second = script(
            f"[Charts.colour('{words}'), Charts.colour('{words}', ['x', 'y', '{words}'])]"
        )
        assert first == second
        assert not first.startswith("other")


def test_chart_marks_show_takeovers_outages_laws_and_alarms():
    bands = {
        "phase": [
            (0, 2, "waiting for ranging"),
            (2, 3, "ready"),
            (3, 9, "engaged"),
            (9, 11, "coasting"),
            (11, 20, "engaged"),
            (20, 25, "yielded"),
            (25, 30, "waiting for the link"),
        ],
        "law": [
            (3, 5, "feedforward"),
            (5, 9, "drift"),
            (9, 11, ""),
            (11, 20, "drift"),
            (20, 30, "feedforward"),
        ],
    }
    marks = script("Charts.marks(bands, [[12, 'low battery']])", bands=bands)
    assert [mark[:3] for mark in marks] == [
        [5, 5, "law"],
        [9, 11, "outage"],
        [12, 12, "alarm"],
        [20, 25, "takeover"],
        [20, 20, "law"],
        [25, 30, "outage"],
    ]
    drawn = strip([0, 30], [0, 1], [0, 30], marked=marks)
    assert re.findall('class="mark ([a-z]+)"', drawn) == [mark[2] for mark in marks]
    assert "low battery, 12 s" in drawn


STARTED = [(0, 3, "ready"), (3, 9, "engaged")]
TAKEN_OVER = "taken over, GUIDED left for LOITER"
DISARMED = "ABORTED: taken over, vehicle disarmed"


@pytest.mark.parametrize(
    ("phases", "alarms", "marks"),
    [
        # if no phase shows the takeover, the text of the event gives the mark
        ([(9, 10, "ended")], [(9, TAKEN_OVER)], [[9, 9, "takeover"]]),
        ([(9, 10, "ended")], [(9, DISARMED)], [[9, 9, "takeover"]]),
        (
            [(9, 12, "yielded"), (12, 20, "engaged")],
            [(9, TAKEN_OVER), (9.1, "OPERATOR HAS THE VEHICLE, mode LOITER")],
            [[9, 12, "takeover"]],
        ),
        # an outage with a phase is marked once, although it also raises an alarm; an outage without
        # a phase is marked by its alarm
        (
            [(9, 12, "coasting"), (12, 40, "engaged")],
            [(9, "range lost, coasting"), (9.1, "RANGE STALE 0.6 s"), (20, "vehicle silent")],
            [[9, 12, "outage"], [20, 20, "outage"]],
        ),
        ([(9, 40, "engaged")], [(30, "range frozen, rejected")], [[30, 30, "alarm"]]),
    ],
)
def test_takeovers_and_outages_are_marked_once(phases, alarms, marks):
    bands = {"phase": [*STARTED, *phases]}
    found = script("Charts.marks(bands, alarms)", bands=bands, alarms=alarms)
    assert [mark[:3] for mark in found] == marks


# --- the track


def track(east, north, **options):
    way = {
        "name": "true",
        "colour": "true",
        "times": list(range(len(east))),
        "east": east,
        "north": north,
    }
    return script("Charts.track([way], [100], 520, options)", way=way, options=options)


def test_map_has_north_up_and_arrows_along_track():
    """The track leads from 100 m north of the target to the east: it starts above the center of the
    map, and its arrows point to the right."""
    drawn = track(list(range(0, 100, 2)), [100] * 50, at=49, heading=np.pi / 2)
    x, y = map(float, re.search(r'<path d="M([\d.]+),([\d.]+)m0,-8', drawn).groups())
    assert (x, y < 40) == (260.0, True)
    assert set(re.findall(r'6Z" transform="translate\([^)]*\) rotate\((-?[\d.]+)\)', drawn)) == {
        "0.0"
    }
    assert re.search(r'rotate\(90\.0\)" class="now true"', drawn), (
        "the arrow is rotated clockwise from north"
    )


def test_map_track_has_gap_without_position():
    drawn = track([None, 90, 80, None, 60, 50], [100] * 6, marked=[[4, 5, "takeover", "yielded"]])
    assert path(drawn, "line true").count("M") == 2
    assert 'class="start hollow"' in drawn
    assert drawn.index('class="line true"') < drawn.index('class="level desired"')
    assert ">T</text>" in drawn
    assert track([None], [None]) is None


# --- the data


def test_thinned_chart_line_keeps_peaks_and_gaps():
    values = np.sin(np.arange(200_000) / 20)
    values[123_456], values[77], values[5000:9000] = 50.0, -50.0, np.nan
    keep = peaks(values, 500)
    assert len(keep) <= 1500
    assert {77, 123_456} <= set(keep)
    assert list(keep) == sorted(keep)
    assert np.isnan(values[keep]).any()
    assert list(peaks(values[:10], 500)) == list(range(10))


def test_chart_data_use_time_of_run(run_folder):
    """The synthetic run is at 120 m for 100 s, then at 101 m, and turns clockwise at 0.15 rad/s. It
    has one range per second."""
    folder = run_folder()
    ticks = read_ticks(folder)
    ticks.numbers["desired"][:] = np.where(ticks.time < 150, 100.0, 60.0)
    data = chart_data(
        ticks, read_truth(folder, EPOCH_US), Orbit(100.0, Direction.CLOCKWISE, 15.0, 0.35), {}
    )
    columns = {name: dict(zip(*column, strict=True)) for name, column in data["columns"].items()}
    assert (columns["r"][50.0], columns["r"][200.0]) == (120.0, 101.0)
    assert columns["desired"] == {0.0: 100.0, 150.0: 60.0}
    assert columns["true_r"][200.0] == pytest.approx(101.0, abs=1e-3)
    assert columns["true_turn"][200.0] == columns["turn_rate"][200.0] == -0.15
    assert set(list(columns["accepted"].values())[1:-2]) <= {0.8, 1.6, 2.4}
    assert data["bands"]["phase"] == [(0.0, 10.0, "ready"), (10.0, 300.0, "engaged")]
    assert data["ways"][0]["name"] == "true"
    assert len(json.loads(as_script(data))["columns"]) == len(columns)


def test_alarms_and_warnings_are_marked_once():
    failsafe = Event(7.0, "vehicle message", "EKF failsafe", severe=True)
    hello = Event(8.0, "vehicle message", "hello")
    seen = [
        Event(8.0, "alarm", "LEAN LIMIT: 31 deg", True),
        Event(20.0, "alarm", "NOT RECORDING: full", True),
    ]
    messages = [
        Event(9.5, "circnav message", "LEAN LIMIT: on", True),
        Event(40.0, "circnav message", "vehicle banks", True),
    ]
    found = [
        (7.0, "EKF failsafe"),
        (8.0, seen[0].text),
        (20.0, seen[1].text),
        (40.0, "vehicle banks"),
    ]
    assert alarms([failsafe, *seen, hello, *messages]) == found
    assert alarms([failsafe, hello, *messages]) == [found[0], (9.5, "LEAN LIMIT: on"), found[3]], (
        "a killed flight has no summary, so its messages are used"
    )
