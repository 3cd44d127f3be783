"""`circnav report`: one self-contained page of the flight, also checked in a real browser, and one
error line for unusable runs."""

import csv
import importlib
import io
import json
import re
import shutil
import struct

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.runlog.tlog import message_id, read_tlog
from tests.flight.recorded import recorded_flight
from tests.process import python
from tests.runlog.conftest import rewrite_ticks

# import the module by name, because the attribute `report` of the package is the command
cli_report = importlib.import_module("circnav_mav.cli.report")
pytestmark = pytest.mark.usefixtures("no_pictures")
CHARTS = [
    "phase",
    "range",
    "error, range - radius",
    "range rate",
    "turn rate, left positive",
    "drift: wind minus target motion",
    "innovation",
    "ranges",
    "vehicle mode",
    "law",
]


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """30 s of the quickstart, unfinished: without a summary, like a run that was killed."""
    folder = tmp_path_factory.mktemp("flown")
    recorded_flight(folder, "quickstart").fly(30).recorder.close()
    return folder


@pytest.fixture
def page_of(circnav, run):
    """Return a function that makes the page of the run, with the data of its charts."""

    def page_of():
        assert circnav("report", run).done
        page = (run / "report.html").read_text()
        return page, json.loads(
            re.search(r'<script type="application/json" id="data">(.*?)</script>', page)[1]
        )

    return page_of


def test_report_is_complete_and_self_contained(page_of, run):
    page, data = page_of()
    columns = (
        "measured r true_r r_dot true_r_dot turn_rate true_turn innovation accepted rejected"
        " drift_x"
    )
    assert set(columns.split()) <= set(data["columns"])
    assert '<dt class="warning">WARNING</dt>' in page
    assert '<div class="outcome bad">UNFINISHED: ' in page, (
        "the page begins with the outcome in words and color"
    )
    sent = sum(
        row["yaw_rate_sent"] != ""
        for row in csv.DictReader((run / "ticks.csv").read_text().splitlines())
    )
    assert f"<span>{sent} sent</span>" in page
    assert "2026-09-21 14:13 UTC, vehicle unknown" in page
    assert page.index("<noscript><img") < page.index('id="charts"'), (
        "without scripts the page shows the picture of the flight"
    )
    for part in (
        "UNFINISHED",
        "The simulator's truth",
        "orbit.radius_m",
        "pymavlink",
        "exit code",
        "engaged",
        "gate",
    ):
        assert part in page
    assert not re.search(r"""(src|href)=["'](?!data:)|https?://|@import|url\((?!#)""", page)
    assert not re.search(r"@[A-Z.]+@|\bnan\b", page)
    assert {path.name for path in run.glob("*.png")} == {"flight.png"}


def test_report_without_truth_has_no_track(page_of, run):
    shutil.rmtree(run)
    overrides = (
        "limits.duration_s=8",
        "sim.truth.rate_hz=0",
        'guidance.estimator="kalman"',
        'guidance.law="smooth"',
    )
    recorded_flight(run, "quickstart", *overrides).fly(15).recorder.close()
    page, data = page_of()
    assert "range alone does not determine it" in page
    assert "differenced" in data["columns"]
    assert data["ways"] == []


def test_report_labels_match_output_mode_of_flight(page_of, with_manifest):
    for voice, phase, curve in (
        ("fly", "engaged", "commanded"),
        ("dry run", "would steer", "would command"),
        ("shadow", "would steer", "would command"),
    ):
        with_manifest(output_mode=voice, mission="<script>alert(1)</script>@EVENTS@")
        page, data = page_of()
        words = {word for _, _, word in data["bands"]["phase"]}
        assert words & {"engaged", "would steer"} == {phase}
        assert data["flight"]["commanded"] == curve
        assert "<script>alert" not in page
        assert "<h1>&lt;script&gt;alert(1)&lt;/script&gt;@EVENTS@</h1>" in page


def test_estimated_track_has_gaps_without_trusted_estimate(page_of, run):
    """The estimate is trusted from 10 s to 12 s, and from 14 s on. The log has no truth."""
    frames = list(read_tlog(run / "flight.tlog"))
    kept = [
        (us, frame)
        for us, frame in frames
        if message_id(frame) != mavlink.MAVLINK_MSG_ID_DEBUG_FLOAT_ARRAY
    ]
    (run / "flight.tlog").write_bytes(b"".join(struct.pack(">Q", us) + frame for us, frame in kept))

    def track_from_10_s(time, row):
        known = 10 <= time < 12 or time >= 14
        row["x"], row["y"] = (f"{time:.2f}", "50.0") if known else ("", "")

    rewrite_ticks(run, track_from_10_s)
    page, data = page_of()
    assert "Estimated position relative to the target: first estimate at 10.0 s" in page
    (way,) = data["ways"]
    known = [time for time, east in zip(way["times"], way["east"], strict=True) if east is not None]
    assert (way["name"], known[0]) == ("estimated", 10.0)
    assert not [time for time in known if 12 <= time < 14]


def test_charts_have_gaps_and_draw_each_range_once(page_of, run):
    """The program stalls for 1.5 s at 15 s: the estimate's chart has a gap there. In every 10 s,
    the first second has new ranges, and the other ticks repeat the last range."""
    last = {}

    def seldom(time, row):
        if 15 < time < 16.5:
            return False
        if time % 10 < 1 or not last:
            last.update({name: row[name] for name in ("measured", "nis", "accepted", "rejected")})
        return row.update(last)

    rewrite_ticks(run, seldom)
    columns = page_of()[1]["columns"]
    times, values = columns["r"]
    unknown = [
        time for time, value in zip(times, values, strict=True) if value is None and time > 1
    ]
    assert unknown == [pytest.approx(15.75, abs=0.1)]
    for name in ("innovation", "measured"):
        times, _ = columns[name]
        assert len(times) > 10
        assert all((time + 0.2) % 10 < 1.5 for time in times)


def test_long_event_list_is_shortened(page_of, run):
    def flapping(time, row):
        if time > 1:
            row["mode"] = ("LOITER", "GUIDED")[round(20 * time) % 2]
        if time > 29.5:
            row["phase"] = "ended"

    rewrite_ticks(run, flapping)
    events = page_of()[0].partition("<h2>Events</h2>")[2].partition("</table>")[0]
    rows = re.findall("<tr>.*?</tr>", events)
    assert len(rows) == 61
    assert "<td>0.0 s</td>" in rows[0]
    assert re.search(r"\d+ more", rows[30])
    assert any("<td>ended</td>" in row for row in rows[31:])
    times = [float(time) for time in re.findall(r"<td>([\d.]+) s</td>", events)]
    assert times == sorted(times)


def test_report_of_ten_minutes_stays_below_one_megabyte(page_of, run):
    """The ticks of the flight, repeated twenty times: 600 s."""
    header, *rows = (run / "ticks.csv").read_text().splitlines()
    longer = [
        f"{float(t) + 30 * n:.6f},{rest}"
        for n in range(20)
        for t, _, rest in (r.partition(",") for r in rows)
    ]
    (run / "ticks.csv").write_text("\n".join([header, *longer]) + "\n")
    assert len(page_of()[0]) < 1_000_000


def first_tick_only(run):
    lines = (run / "ticks.csv").read_text().splitlines(keepends=True)
    (run / "ticks.csv").write_text("".join(lines[:2]))


REFUSED = {
    "no log": (lambda run: (run / "flight.tlog").unlink(), 2, "is not a run folder"),
    "no header": (lambda run: (run / "ticks.csv").write_text(""), 2, "has no header"),
    "no ticks": (lambda run: (run / "ticks.csv").unlink(), 2, "No such file"),
    "no tick": (lambda run: (run / "ticks.csv").write_text("time,phase\n"), 3, "an empty run"),
    "one tick": (first_tick_only, 3, "only one tick was recorded, a report needs two"),
    "mission": (lambda run: (run / "mission.toml").write_text("x"), 2, "not valid TOML"),
    "manifest": (lambda run: (run / "manifest.json").write_text("{"), 2, "manifest.json"),
    "no place": (lambda run: (run / "report.html").mkdir(), 2, "Is a directory"),
}


@pytest.mark.parametrize(("damage", "code", "error"), REFUSED.values(), ids=REFUSED)
def test_impossible_report_is_refused_in_one_line(circnav, run, damage, code, error):
    damage(run)
    ran = circnav("report", run)
    assert ran.code == code
    assert error in ran.line


@pytest.mark.parametrize(
    ("maker", "lost", "left", "size"),
    [
        ("write_report", "report.html", "flight.png", 8),
        ("plot_flight", "flight.png", "report.html", 1000),
    ],
)
def test_failed_picture_after_flight_prints_one_line(
    circnav, run, monkeypatch, maker, lost, left, size
):
    def broken(*arguments):
        raise ZeroDivisionError("failed")

    monkeypatch.setattr(cli_report, maker, broken)
    monkeypatch.setattr("sys.stdin", io.StringIO("over\n"))
    assert (
        circnav("report", run, "--after-flight").done
        == f"{run / lost}: could not be made: failed\n"
    )
    assert (run / left).stat().st_size > size


def test_browser_zooms_charts_and_shows_values(browser, page_of, run):
    """Tested in the window sizes of a phone and a desktop. Dragging over one chart zooms all
    charts, and pointing at a chart shows the values there."""
    _, data = page_of()
    for width in (390, 1100):
        browser.open((run / "report.html").as_uri(), width=width, dark=True)
        assert browser.value("document.documentElement.scrollWidth <= innerWidth")
    names = browser.value(
        "[...document.querySelectorAll('figcaption > b:first-child')].map(name => name.textContent)"
    )
    assert names == ["track", *CHARTS]
    box = browser.value(
        "document.querySelectorAll('svg.strip')[1].getBoundingClientRect().toJSON()"
    )
    at = [(box["left"] + share * box["width"], box["top"] + 20) for share in (0.4, 0.6, 0.5)]
    browser.mouse("mousePressed", *at[0])
    browser.mouse("mouseReleased", *at[1])
    browser.mouse("mouseMoved", *at[2])
    seconds = (
        "[...{}.querySelectorAll(':scope > text[text-anchor=middle]')].map(label =>"
        " Number(label.textContent))"
    )
    axes = browser.value(
        f"[...document.querySelectorAll('svg.strip')].map(one => {seconds.format('one')})"
    )
    assert len(axes) == len(CHARTS)
    assert all(8 < min(axis) < max(axis) < 20 for axis in axes), (
        "every time axis shows the middle of the 30 s"
    )
    time = float(browser.value("document.querySelector('#tools output').textContent").split()[0])
    shown = browser.value("document.querySelectorAll('figcaption')[2].innerText")
    estimated = np.interp(time, *(np.array(column, float) for column in data["columns"]["r"]))
    assert float(re.search(r"estimated ([\d.]+)", shown)[1]) == pytest.approx(estimated, abs=1.0)
    assert browser.complaints == []


def test_missing_matplotlib_is_named(run):
    program = (
        "import sys; sys.modules['matplotlib'] = None; from circnav_mav.cli import main; main()"
    )
    drawing = python("-c", program, "report", str(run))
    output, errors = drawing.communicate()
    assert (drawing.returncode, output) == (1, "")
    assert errors == (
        "circnav: the Python package matplotlib is not installed: install it with pip\n"
    )
