"""The benchmark: figures of a cell, and its tables and picture."""

import time
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest

from circnav_mav.api import tune
from circnav_mav.extras.bench.bench import FLIGHTS, BenchError, cell_of, figures, run, table
from circnav_mav.extras.bench.flight import ROWS, Track
from circnav_mav.extras.bench.pictures import draw, draw_consistency
from circnav_mav.extras.bench.situations import ORBIT, SITUATIONS, TURN_LAG
from circnav_mav.extras.bench.table import line, markdown
from circnav_mav.guidance.laws import LAWS
from circnav_mav.mission.checks import check_mission
from circnav_mav.mission.load import load_mission
from circnav_mav.report import plots
from tests.process import PATIENCE

QUICKSTART = Path(__file__).parents[3] / "config" / "quickstart.toml"


@pytest.mark.parametrize("law", LAWS)
def test_benchmark_gain_matches_check_of_quickstart(law):
    (printed,) = (
        line.text
        for line in check_mission(load_mission(QUICKSTART, [f"guidance.law={law}"]))
        if line.subject == "gain"
    )
    assert f"k = {tune(ORBIT, law, turn_lag=TURN_LAG).gain:.4g} " in printed


SHORT = replace(SITUATIONS["wind 0.20 V"], start=(80.0, 160.0), duration=125.0)


def test_benchmark_table_shows_larger_error_of_feedforward_in_wind(tmp_path):
    cells = [(SHORT, "full information"), (SHORT, "feedforward")]
    full, feedforward = table(run(cells, 1, 1, tmp_path))
    assert full.kept == feedforward.kept == 1
    assert full.rms_median < 0.05 < 1.0 < feedforward.rms_median
    assert (tmp_path / "table.png").stat().st_size > 10_000
    assert (tmp_path / "table.csv").read_text().count("\n") == 3
    page = (tmp_path / "table.md").read_text().splitlines()
    assert page[0] == (
        "| situation (1 flights a cell; median RMS radius error, m, 95 % interval) |"
        " full information | feedforward |"
    )
    assert page[2].startswith(
        f"| wind 0.20 V | {full.rms_median:.2f}, sd {full.turn_std_deg_s:.1f} | "
    )
    assert "at the limit 0 %" in line(full) and "limit cycles" not in line(full)
    assert "kept    1 of 1" in line(full)


@pytest.fixture(scope="module")
def rows():
    """Rows of five synthetic flights from 200 m to a counter-clockwise circle in 40 s. Three
    flights have errors of 0, 1 and 20 m, one flies in the wrong direction, and one is lost in the
    wind."""
    time = np.arange(0.0, 400.0, 0.5)
    e = np.broadcast_to([0.0, 1.0, 20.0, 0.0, 300.0], (800, 5))
    r = np.where(time[:, None] < 40.0, 200.0, 100.0 + e)
    angle = np.outer(time, [0.15, 0.15, 0.15, -0.15, 0.001])
    still = np.zeros((800, 5))
    command = np.full((800, 5), 0.15)
    nees = np.broadcast_to([0.01, 1.0, 1.0, 1.0, np.nan], (800, 5))
    columns = (r, still, angle, command, r + 0.1, still + 0.2, nees, nees / 2)
    tracks = [
        Track(
            {name: column[:, i] for name, column in zip(ROWS, columns, strict=True)},
            time,
            1.0,
            (200.0, 0.0),
            np.pi,
        )
        for i in range(5)
    ]
    cell = {"situation": "calm", "policy": "auto", "seconds": 0.0}
    return [cell | {"flight": i} | figures(track) for i, track in enumerate(tracks)]


@pytest.fixture(scope="module")
def cell(rows):
    return cell_of(rows, [row | {"rms": row["rms"] - 2.0} for row in rows])


def test_benchmark_interval_of_six_flights_has_their_extremes(rows):
    """Six flights are the least number for 95 %: the median is outside them with 2 / 2^6."""
    six = [rows[0] | {"flight": i, "rms": float(i)} for i in range(6)]
    found = cell_of(six, six)
    assert (found.rms_low, found.rms_median, found.rms_high) == (0.0, 2.5, 5.0)


def test_benchmark_figures_match_hand_calculation(cell):
    """A flight is kept if its RMS error is below 10 m and its direction is right. The straight
    flight from 200 m to the tangent point takes about 12 s."""
    assert (cell.flights, cell.kept, cell.wrong_way, cell.limit_cycles) == (5, 2, 1, 0)
    assert (cell.rms_median, cell.rms_p95, cell.rms_max, cell.mean_error) == pytest.approx(
        (1.0, 244.0, 300.0, 64.2)
    )
    assert 40.0 / 15 < cell.settled10_median < 40.0 / 11 and cell.settled10_p95 == inf
    assert cell.settled2_median == cell.settled10_median
    assert (cell.closest_outside, cell.turn_std_deg_s, cell.turn_at_limit) == pytest.approx(
        (100.0, 0.0, 0.0)
    )
    assert (cell.range_rmse, cell.rate_rmse) == pytest.approx((0.1, 0.2))
    assert (cell.nees_mean, cell.nees_in_band) == pytest.approx((3.01 / 4, 0.75))
    assert (cell.nis_last, cell.consistency_flights) == pytest.approx((3.01 / 8, 4))
    shown = "RMS   1.000 m p95  244.000 (<= 0.12), minus the first law's +2.000"
    assert f"kept    2 of 5  wrong way 1  {shown}" in line(cell)
    assert "| calm | 2 of 5 | **1.000** / 244.000 / 300.00;" in markdown([cell])


def test_benchmark_rows_are_independent_of_processes_and_resuming(tmp_path):
    """The first run ends by Ctrl-C after one flight, in the middle of a line of the table."""
    cells = [(replace(SHORT, duration=101.0), law) for law in ("smooth", "feedforward")]

    def interrupt(line):
        raise KeyboardInterrupt

    def rows(**how):
        return [row | {"seconds": 0.0} for row in run(cells, 2, **how)]

    assert len(run(cells, 2, out=tmp_path, report=interrupt)) == 2
    with pytest.raises(BenchError, match="--resume"):
        run(cells, 2, out=tmp_path)
    with pytest.raises(BenchError, match="seed 1"):
        run(cells, 2, 2, tmp_path, resume=True)
    kept = (tmp_path / FLIGHTS).read_text().splitlines(keepends=True)
    (tmp_path / FLIGHTS).write_text("".join(kept[:2]) + kept[2][:40])
    alone = rows()
    resumed = rows(out=tmp_path, resume=True)
    for other in (resumed, rows(processes=2)):
        assert list(map(str, other)) == list(map(str, alone))


def test_benchmark_rows_on_dask_worker_equal_local_rows():
    distributed = pytest.importorskip("distributed", reason="needs the extra [cluster]")
    cells = [(replace(SHORT, duration=101.0), "smooth")]
    local = run(cells, 2)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        there = run(cells, 2, scheduler=cluster.scheduler_address)
    for rows in (local, there):
        for row in rows:
            del row["seconds"]
    assert list(map(str, there)) == list(map(str, local))


def test_consistency_picture_shows_chi_squared_band(cell, monkeypatch):
    """Band of the mean of ten values with two degrees of freedom: 9.591 / 10 to 34.170 / 10."""
    drawn = []
    monkeypatch.setattr(plots, "save", lambda figure, path, dpi: drawn.append(figure))
    draw_consistency([replace(cell, consistency_flights=10)], Path("consistency.svg"))
    (band,) = drawn[0].axes[0].patches
    assert (band.get_x(), band.get_x() + band.get_width()) == pytest.approx(
        (0.9591, 3.4170), abs=1e-4
    )
    assert list(drawn[0].axes[1].lines[1].get_xdata()) == [cell.nis_last]


def test_picture_of_single_law_shows_color_scale_within_frame(cell, monkeypatch):
    figures = []
    monkeypatch.setattr(plots, "save", lambda figure, path, dpi: figures.append(figure))
    kept = [replace(cell, situation=str(rms), rms_median=rms, kept=5) for rms in (299.0, 301.0)]
    draw(kept, Path("table.png"))
    (figure,) = figures
    figure.draw_without_rendering()
    scale = figure.axes[1].yaxis.label.get_window_extent()
    assert figure.bbox.y0 <= scale.y0 < scale.y1 <= figure.bbox.y1
    assert [text.get_text() for text in figure.axes[0].texts] == ["299", "lost"]


def test_benchmark_stops_when_its_output_closes():
    """The output closes after the first cell, as in `circnav bench | head`. The other 100 cells
    would take very long."""

    def show(line):
        shown.append(line)
        raise BrokenPipeError

    shown = []
    began = time.monotonic()
    calm = SITUATIONS["calm"]
    short = replace(SHORT, name="short", duration=101.0)
    cells = [(short, "smooth"), *((replace(calm, name=f"calm {n}"), "auto") for n in range(100))]
    with pytest.raises(BrokenPipeError):
        run(cells, flights=1, report=show, processes=2)
    assert [line.split()[1] for line in shown] == ["smooth"]
    assert time.monotonic() - began < PATIENCE
