"""`circnav report`: one page without network that shows the flight, also in a real browser; one line for bad runs."""

import csv
import importlib
import json
import re
import shutil
import struct
import subprocess
from itertools import pairwise
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.mission.load import load_mission
from circnav_mav.runlog.tlog import message_id, read_tlog
from tests.flight.lockstep import CONFIG
from tests.flight.recorded import recorded_flight
from tests.process import PATIENCE

cli_report = importlib.import_module("circnav_mav.cli.report")  # the package's `report` is the command
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
CHARTS = ("phase", "range", "error, range - radius", "range rate", "turn rate, left positive", "innovation", "ranges",
          "vehicle mode")  # fmt: skip


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
    assert [title for title in CHARTS if f"<figcaption><b>{title}</b>" not in page] == []
    for part in ("UNFINISHED", "The simulator's truth", "orbit.radius_m", "pymavlink", "exit code", "engaged", "gate"):
        assert part in page
    assert not re.search(r"""(src|href)=["'](?!data:)|https?://|@import|url\((?!#)""", page)
    assert not re.search(r"@[A-Z]+@|\bnan\b", page)
    assert {path.name for path in flown.glob("*.png")} == {"flight.png", "estimates.png"}


def test_a_run_without_truth_tells_ranges_and_no_track(circnav, tmp_path):
    overrides = ("limits.duration_s=8", "sim.truth.rate_hz=0", 'guidance.estimator="kalman"', 'guidance.law="smooth"')
    recorded_flight(tmp_path / "run", "quickstart", *overrides).fly(15).recorder.close()
    assert circnav("report", tmp_path / "run").code == 0
    page = (tmp_path / "run" / "report.html").read_text()
    assert "Range alone does not tell where it flew" in page
    assert "differenced over 1 s" in page


def colour(page: str, word: str) -> str:
    (found,) = set(re.findall(rf'background:(#\w+)"></i>{re.escape(word)}<', page))
    return found


def test_a_mode_and_a_law_have_the_same_colour_in_every_report(circnav, flown, tmp_path):
    """Whatever modes came before; and what is well is not the red of refusals."""
    folder = copy_of(flown, tmp_path / "run")
    rows = (folder / "ticks.csv").read_text().splitlines()
    early = [row.replace("LOITER", ("ACRO", "STABILIZE")[at % 2]) for at, row in enumerate(rows)]
    (folder / "ticks.csv").write_text("\n".join(early) + "\n")
    pages = []
    for run in (flown, folder):
        assert circnav("report", run).code == 0
        pages.append((run / "report.html").read_text())
    assert "ACRO" in pages[1]
    for word in ("GUIDED", "drift"):
        assert colour(pages[0], word) == colour(pages[1], word) != colour(pages[0], "rejected")


def test_a_dry_run_would_steer_and_never_is_engaged(circnav, flown, tmp_path):
    folder = copy_of(flown, tmp_path / "run")
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps(manifest | {"voice": "dry run"}))
    assert circnav("report", folder).code == 0
    page = (folder / "report.html").read_text()
    assert "</i>would steer<" in page
    assert "</i>engaged<" not in page


@pytest.mark.parametrize(
    ("voice", "curve"), [("fly", "commanded"), ("dry run", "would command"), ("shadow", "would command")]
)
def test_the_curve_of_turn_rates_that_never_left_is_called_so(circnav, flown, tmp_path, voice, curve):
    folder = copy_of(flown, tmp_path / "run")
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps(manifest | {"voice": voice}))
    assert circnav("report", folder).code == 0
    assert re.findall(r"</i>([a-z ]*command(?:ed)?)<", (folder / "report.html").read_text()) == [curve]


def rewritten(folder, change):
    """ticks.csv with other rows: change(number, row as a dict) changes it or returns False to leave it out."""
    with (folder / "ticks.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    kept = [row for at, row in enumerate(rows) if change(at, row) is not False]
    with (folder / "ticks.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(kept)


def without_truth(folder):
    """As of a vehicle that tells none."""
    frames = read_tlog(folder / "flight.tlog")
    told = [(us, frame) for us, frame in frames if message_id(frame) != mavlink.MAVLINK_MSG_ID_DEBUG_FLOAT_ARRAY]
    (folder / "flight.tlog").write_bytes(b"".join(struct.pack(">Q", us) + frame for us, frame in told))


def test_an_estimated_track_says_when_it_was_first_believed_and_breaks_where_it_was_not(circnav, flown, tmp_path):
    """Believed from second 10 to 12, and from 14 on."""
    folder = copy_of(flown, tmp_path / "run")
    without_truth(folder)

    def believed(at, row):
        time = float(row["time"])
        known = 10 <= time < 12 or time >= 14
        row["x"], row["y"] = (f"{time:.2f}", "50.0") if known else ("", "")

    rewritten(folder, believed)
    assert circnav("report", folder).code == 0
    page = (folder / "report.html").read_text()
    assert "Estimated position relative to the target, where it was known: first believed at 10.0 s" in page
    drawn = re.search(r'<svg viewBox="0 0 520 520".*?</svg>', page)[0]
    assert re.search(r'<path d="(M[^"]*)" fill="none" stroke="#1f5fa8"', drawn)[1].count("M") == 2
    assert 'fill="none" stroke="red"' in drawn


def test_lines_break_where_no_tick_was_made(circnav, flown, tmp_path):
    """A stall of 1.5 s at second 15, in a chart of what was estimated: no ramp leads over it."""
    folder = copy_of(flown, tmp_path / "run")
    rewritten(folder, lambda at, row: not 15 < float(row["time"]) < 16.5)
    assert circnav("report", folder).code == 0
    page = (folder / "report.html").read_text()
    error = page[page.index("<b>error, range") :].partition("</figure>")[0]
    line = re.search(r'<path d="(M[^"]*)" fill="none" stroke="#1f5fa8"', error)[1]
    xs = [float(x) for x in re.findall(r"[ML]([\d.]+),", line)]
    assert line.count("M") == 2
    assert max(b - a for a, b in pairwise(xs)) == pytest.approx(1.5 * 884 / 30, rel=0.2)


def test_innovations_and_ranges_are_dots_of_new_ranges_alone(circnav, flown, tmp_path):
    """The first second of every ten has its ranges, the others repeat the last."""
    folder, last = copy_of(flown, tmp_path / "run"), {}

    def seldom(at, row):
        if float(row["time"]) % 10 < 1 or not last:
            last.update({name: row[name] for name in ("measured", "nis", "accepted", "rejected")})
        row.update(last)

    rewritten(folder, seldom)
    assert circnav("report", folder).code == 0
    page = (folder / "report.html").read_text()
    innovation = page[page.index("<b>innovation") :].partition("</figure>")[0]
    times = {float(x) for x in re.findall(r"M([\d.]+),[\d.]+h0", innovation)}
    assert len(times) > 10
    assert all((30 * (x - 64) / 884 + 0.2) % 10 < 1.5 for x in times)


def test_of_very_many_events_the_first_and_the_last_are_told(circnav, flown, tmp_path):
    folder = copy_of(flown, tmp_path / "run")

    def flapping(at, row):
        if at > 20:
            row["mode"] = ("LOITER", "GUIDED")[at % 2]
        if float(row["time"]) > 29.5:
            row["phase"] = "ended"

    rewritten(folder, flapping)
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


def test_a_truncated_log_is_reported_as_far_as_it_goes(circnav, flown, tmp_path):
    folder = copy_of(flown, tmp_path / "run")
    (folder / "flight.tlog").write_bytes((folder / "flight.tlog").read_bytes()[:5000])
    assert circnav("report", folder).code == 0


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
    assert dumped.stdout.count("<figure>") >= len(CHARTS)


def test_the_settings_of_the_report_stand_as_in_a_mission_file():
    settings = cli_report._settings(load_mission(CONFIG / "px4_plane_attitude.toml"))
    assert settings["vehicle.loops.trim_thrust"] == "0.63"
    assert settings["guidance.correct_radius"] == "true"
    assert settings["vehicle.kind"] == "plane"
