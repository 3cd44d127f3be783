"""`circnav report`: one page without network that shows the flight, also in a real browser; one line for bad runs."""

import importlib
import json
import re
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mission.load import load_mission
from circnav_mav.runlog.tlog import message_id, read_tlog
from tests.browser import CHROMIUM, Browser
from tests.flight.lockstep import CONFIG
from tests.flight.recorded import recorded_flight
from tests.process import PATIENCE
from tests.runlog.conftest import rewrite_ticks

cli_report = importlib.import_module("circnav_mav.cli.report")  # the package's `report` is the command
CHARTS = ("phase", "range", "error, range - radius", "range rate", "turn rate, left positive",
          "drift: wind less target motion", "innovation", "ranges", "vehicle mode", "law")  # fmt: skip


def data_of(page: str) -> dict:
    """What the charts of a page are drawn from."""
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page)[1])


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """30 s of the quickstart, unfinished: without a summary, like a run that was killed."""
    folder = tmp_path_factory.mktemp("flown")
    recorded_flight(folder, "quickstart").fly(30).recorder.close()
    return folder


def copy_of(folder: Path, to: Path) -> Path:
    shutil.copytree(folder, to)
    return to


def test_the_page_holds_every_part_and_needs_nobody(circnav, flown):
    ran = circnav("report", flown)
    assert (ran.code, ran.err) == (0, "")
    page = (flown / "report.html").read_text()
    columns = "measured r true_r r_dot true_r_dot turn_rate true_turn innovation accepted rejected drift_x"
    assert set(columns.split()) <= set(data_of(page)["columns"])
    assert '<div class="outcome bad">UNFINISHED: ' in page, "the outcome in words and colour, first"
    assert "2026-09-21 14:13 UTC, vehicle not known" in page
    assert page.index("<noscript><img") < page.index('id="charts"'), "the flight without a script"
    for part in ("UNFINISHED", "The simulator's truth", "orbit.radius_m", "pymavlink", "exit code", "engaged", "gate"):
        assert part in page
    assert not re.search(r"""(src|href)=["'](?!data:)|https?://|@import|url\((?!#)""", page)
    assert not re.search(r"@[A-Z.]+@|\bnan\b", page)
    assert {path.name for path in flown.glob("*.png")} == {"flight.png"}


def test_a_run_without_truth_tells_ranges_and_no_track(circnav, tmp_path):
    overrides = ("limits.duration_s=8", "sim.truth.rate_hz=0", 'guidance.estimator="kalman"', 'guidance.law="smooth"')
    recorded_flight(tmp_path / "run", "quickstart", *overrides).fly(15).recorder.close()
    assert circnav("report", tmp_path / "run").code == 0
    page = (tmp_path / "run" / "report.html").read_text()
    assert "Range alone does not tell where it flew" in page
    assert "differenced" in data_of(page)["columns"]
    assert data_of(page)["ways"] == []


def test_a_dry_run_would_steer_and_never_is_engaged(circnav, flown, tmp_path):
    folder = copy_of(flown, tmp_path / "run")
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps(manifest | {"voice": "dry run"}))
    assert circnav("report", folder).code == 0
    words = {word for _, _, word in data_of((folder / "report.html").read_text())["bands"]["phase"]}
    assert "would steer" in words
    assert "engaged" not in words


@pytest.mark.parametrize(
    ("voice", "curve"), [("fly", "commanded"), ("dry run", "would command"), ("shadow", "would command")]
)
def test_the_curve_of_turn_rates_that_never_left_is_called_so(circnav, flown, tmp_path, voice, curve):
    folder = copy_of(flown, tmp_path / "run")
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps(manifest | {"voice": voice}))
    assert circnav("report", folder).code == 0
    assert data_of((folder / "report.html").read_text())["flight"]["commanded"] == curve


def without_truth(folder):
    """As of a vehicle that tells none."""
    frames = read_tlog(folder / "flight.tlog")
    told = [(us, frame) for us, frame in frames if message_id(frame) != mavlink.MAVLINK_MSG_ID_DEBUG_FLOAT_ARRAY]
    (folder / "flight.tlog").write_bytes(b"".join(struct.pack(">Q", us) + frame for us, frame in told))


def test_an_estimated_track_says_when_it_was_first_believed_and_breaks_where_it_was_not(circnav, flown, tmp_path):
    """Believed from second 10 to 12, and from 14 on."""
    folder = copy_of(flown, tmp_path / "run")
    without_truth(folder)

    def believed(time, row):
        known = 10 <= time < 12 or time >= 14
        row["x"], row["y"] = (f"{time:.2f}", "50.0") if known else ("", "")

    rewrite_ticks(folder, believed)
    assert circnav("report", folder).code == 0
    page = (folder / "report.html").read_text()
    assert "Estimated position relative to the target, where it was known: first believed at 10.0 s" in page
    (way,) = data_of(page)["ways"]
    known = [time for time, east in zip(way["times"], way["east"], strict=True) if east is not None]
    assert (way["name"], known[0]) == ("estimated", 10.0)
    assert not [time for time in known if 12 <= time < 14]


def test_lines_break_where_no_tick_was_made(circnav, flown, tmp_path):
    """A stall of 1.5 s at second 15, in a chart of what was estimated: no ramp leads over it."""
    folder = copy_of(flown, tmp_path / "run")
    rewrite_ticks(folder, lambda time, row: not 15 < time < 16.5)
    assert circnav("report", folder).code == 0
    page = (folder / "report.html").read_text()
    times, values = data_of(page)["columns"]["r"]
    unknown = [time for time, value in zip(times, values, strict=True) if value is None and time > 1]
    assert unknown == [pytest.approx(15.75, abs=0.1)]


def test_innovations_and_ranges_are_dots_of_new_ranges_alone(circnav, flown, tmp_path):
    """The first second of every ten has its ranges, the others repeat the last."""
    folder, last = copy_of(flown, tmp_path / "run"), {}

    def seldom(time, row):
        if time % 10 < 1 or not last:
            last.update({name: row[name] for name in ("measured", "nis", "accepted", "rejected")})
        row.update(last)

    rewrite_ticks(folder, seldom)
    assert circnav("report", folder).code == 0
    page = (folder / "report.html").read_text()
    for name in ("innovation", "measured"):
        times, _ = data_of(page)["columns"][name]
        assert len(times) > 10
        assert all((time + 0.2) % 10 < 1.5 for time in times)


def test_of_very_many_events_the_first_and_the_last_are_told(circnav, flown, tmp_path):
    folder = copy_of(flown, tmp_path / "run")

    def flapping(time, row):
        if time > 1:
            row["mode"] = ("LOITER", "GUIDED")[round(20 * time) % 2]
        if time > 29.5:
            row["phase"] = "ended"

    rewrite_ticks(folder, flapping)
    assert circnav("report", folder).code == 0
    events = (folder / "report.html").read_text().partition("<h2>Events</h2>")[2].partition("</table>")[0]
    rows = re.findall("<tr>.*?</tr>", events)
    assert len(rows) == 61
    assert "<td>0.0 s</td>" in rows[0]
    assert re.search(r"\d+ more", rows[30])
    assert any("<td>ended</td>" in row for row in rows[31:])
    times = [float(time) for time in re.findall(r"<td>([\d.]+) s</td>", events)]
    assert times == sorted(times)


def test_a_mission_name_is_no_markup_and_no_placeholder(circnav, flown, tmp_path):
    folder = copy_of(flown, tmp_path / "run")
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps(manifest | {"mission": "<script>alert(1)</script>"}))
    assert circnav("report", folder).code == 0
    assert "<script>alert" not in (folder / "report.html").read_text()


def test_ten_minutes_stay_under_five_megabytes(circnav, flown, tmp_path):
    """The ticks of the flight twenty times over, one after the other: 600 s."""
    folder = copy_of(flown, tmp_path / "run")
    header, *rows = (folder / "ticks.csv").read_text().splitlines()
    longer = [f"{float(t) + 30 * n:.6f},{rest}" for n in range(20) for t, _, rest in (r.partition(",") for r in rows)]
    (folder / "ticks.csv").write_text("\n".join([header, *longer]) + "\n")
    assert circnav("report", folder).code == 0
    assert (folder / "report.html").stat().st_size < 1_000_000


@pytest.mark.parametrize(
    ("spoil", "code", "says"),
    [
        (lambda run: shutil.rmtree(run), 2, "no such run folder"),
        (lambda run: (run / "flight.tlog").unlink(), 2, "is not a run folder"),
        (lambda run: (run / "ticks.csv").write_text(""), 2, "has no header"),
        (lambda run: (run / "ticks.csv").unlink(), 2, "No such file"),
        (lambda run: cut(run / "ticks.csv", 1), 3, "an empty run"),
        (lambda run: (run / "mission.toml").write_text("nonsense"), 2, "not valid TOML"),
        (lambda run: (run / "manifest.json").write_text("{"), 2, "manifest.json"),
        (lambda run: (run / "report.html").mkdir(), 2, "Is a directory"),
    ],
    ids=range(8),
)
def test_a_run_that_cannot_be_told_is_one_line(circnav, flown, tmp_path, spoil, code, says):
    folder = copy_of(flown, tmp_path / "run")
    (folder / "report.html").unlink(missing_ok=True)
    spoil(folder)
    ran = circnav("report", folder)
    assert ran.code == code
    assert says in ran.line


def cut(path, lines):
    path.write_text("\n".join(path.read_text().splitlines()[:lines]) + "\n")


@pytest.mark.parametrize(
    ("maker", "lost", "left"),
    [("write_report", "report.html", "flight.png"), ("plot_flight", "flight.png", "report.html")],
)
def test_a_picture_that_fails_at_the_end_of_a_flight_is_a_line_and_nothing_more(
    circnav, flown, tmp_path, monkeypatch, maker, lost, left
):
    def broken(*arguments):
        raise ZeroDivisionError("whatever")

    monkeypatch.setattr(cli_report, maker, broken)
    folder = copy_of(flown, tmp_path / "run")
    (folder / left).unlink(missing_ok=True)
    ran = circnav("report", folder, "--after-flight")
    assert (ran.code, ran.out) == (0, f"{folder / lost}: could not be made: whatever\n")
    assert (folder / left).stat().st_size > 1000


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_a_browser_draws_it_and_logs_no_error(circnav, flown, tmp_path):
    assert circnav("report", flown).code == 0
    page = (flown / "report.html").as_uri()
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    show = [CHROMIUM, *options, "--enable-logging=stderr", "--window-size=1100,2400"]
    ran = subprocess.run(
        [*show, f"--screenshot={tmp_path / 'page.png'}", page], capture_output=True, text=True, timeout=PATIENCE,
        check=False,
    )  # fmt: skip
    assert "CONSOLE" not in ran.stderr
    assert (tmp_path / "page.png").stat().st_size > 50_000
    dumped = subprocess.run([*show, "--dump-dom", page], capture_output=True, text=True, timeout=PATIENCE, check=False)
    drawn = dumped.stdout.partition("<script")[0]
    assert re.findall("<figcaption><b>([^<]*)</b>", drawn) == ["track", *CHARTS]


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
@pytest.mark.parametrize("width", [1100, 390], ids=["desk", "phone"])
def test_dragging_over_a_chart_zooms_all_of_them_and_pointing_at_it_tells_the_values(circnav, flown, tmp_path, width):
    assert circnav("report", flown).code == 0
    browser = Browser(tmp_path / "profile")
    try:
        browser.open((flown / "report.html").as_uri(), width=width, dark=True)
        assert browser.value("document.documentElement.scrollWidth <= innerWidth")
        box = browser.value("document.querySelectorAll('svg.strip')[1].getBoundingClientRect().toJSON()")
        at = [(box["left"] + share * box["width"], box["top"] + 20) for share in (0.4, 0.6, 0.5)]
        browser.mouse("mousePressed", *at[0])
        browser.mouse("mouseReleased", *at[1])
        browser.mouse("mouseMoved", *at[2])
        seconds = (
            "[...{}.querySelectorAll(':scope > text[text-anchor=middle]')].map(label => Number(label.textContent))"
        )
        axes = browser.value(f"[...document.querySelectorAll('svg.strip')].map(one => {seconds.format('one')})")
        assert len(axes) == len(CHARTS)
        assert all(8 < min(axis) < max(axis) < 20 for axis in axes), "of 30 s, the middle"
        time = float(browser.value("document.querySelector('#tools output').textContent").split()[0])
        shown = browser.value("document.querySelectorAll('figcaption')[2].innerText")
        data = data_of((flown / "report.html").read_text())["columns"]["r"]
        estimated = np.interp(time, *(np.array(column, float) for column in data))
        assert float(re.search(r"estimated ([\d.]+)", shown)[1]) == pytest.approx(estimated, abs=1.0)
        assert browser.complaints == []
    finally:
        browser.close()


def test_the_settings_of_the_report_stand_as_in_a_mission_file():
    settings = cli_report._settings(load_mission(CONFIG / "px4_plane_attitude.toml"))
    assert settings["vehicle.loops.trim_thrust"] == "0.63"
    assert settings["guidance.correct_radius"] == "true"
    assert settings["vehicle.kind"] == "plane"
