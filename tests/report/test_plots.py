"""flight.png and replay.png for every kind of run, without overlapping elements."""

from itertools import product

import numpy as np
import pytest

from circnav_mav.guidance.types import Direction, Orbit
from circnav_mav.report import plots
from circnav_mav.report.chart_data import chart_data
from circnav_mav.report.plots import plot_flight, plot_replay
from circnav_mav.runlog.ticks import read_ticks, read_truth
from tests.runlog.conftest import EPOCH_US, rewrite_ticks

ORBIT = Orbit(100.0, Direction.CLOCKWISE, 15.0, 0.35)


@pytest.mark.parametrize(
    "kind", [{}, {"truth": False}, {"engaged": False}], ids=["truth", "no truth", "never engaged"]
)
def test_every_kind_of_run_gets_picture(run_folder, tmp_path, kind):
    folder = run_folder(**kind)
    arguments = read_ticks(folder), read_truth(folder, EPOCH_US), ORBIT, "by hand"
    plot_flight(tmp_path / "flight.png", *arguments)
    picture = (tmp_path / "flight.png").read_bytes()
    assert picture.startswith(b"\x89PNG\r\n\x1a\n")
    assert len(picture) > 10_000
    with pytest.raises(OSError, match="No such file or directory"):
        plot_flight(tmp_path / "no" / "x.png", *arguments)


@pytest.fixture
def drawn(monkeypatch):
    """Return the figure instead of writing it to a file."""
    figures = []
    monkeypatch.setattr(plots, "save", lambda figure, path: figures.append(figure))

    def draw(plot, *arguments, title="by hand"):
        plot("nowhere.png", *arguments, title)
        figures[-1].draw_without_rendering()
        return figures.pop()

    return draw


@pytest.fixture
def ticks(run_folder):
    return read_ticks(run_folder())


def legend(axis):
    return [entry.get_text() for entry in axis.get_legend().get_texts()]


def test_picture_legend_covers_no_line(run_folder, ticks, drawn):
    figure = drawn(plot_flight, ticks, read_truth(run_folder(), EPOCH_US), ORBIT)
    for axis in figure.axes:
        around = axis.get_legend().get_window_extent()
        inside = axis.get_window_extent()
        assert around.y0 >= inside.y1 - 1 or around.y1 <= inside.y0


def test_picture_legend_names_outages_and_unsent_commands(run_folder, drawn):
    folder = rewrite_ticks(
        run_folder(), lambda time, row: row.update(phase="coasting") if 120 <= time < 130 else None
    )
    ticks = read_ticks(folder)
    *others, turn_rate = drawn(plot_flight, ticks, None, ORBIT).axes
    assert all("no range, coasting" in legend(axis) for axis in (*others, turn_rate))
    (shaded,) = turn_rate.collections[-1].get_paths()
    assert shaded.get_extents().intervalx == pytest.approx([120, 130], abs=0.5)
    assert legend(turn_rate)[0] == "commanded"
    limits = [line.get_ydata()[0] for line in turn_rate.lines if line.get_linestyle() == ":"]
    assert limits == pytest.approx([-20.05, 20.05], abs=0.01)  # turn limit of 0.35 rad/s in deg/s
    ticks.numbers["yaw_rate_sent"][:] = np.nan
    assert legend(drawn(plot_flight, ticks, None, ORBIT).axes[-1])[0] == "would command"


def test_picture_shows_compensated_command_for_low_turn_gain(ticks, drawn):
    """At a turn gain of 0.75, a command of -11.5 deg/s gives a turn of -8.6 deg/s. At a gain of 1
    both lines coincide, and only one is drawn."""
    turn_rate = drawn(plot_flight, ticks, None, ORBIT).axes[-1]
    assert "steady command" not in " ".join(legend(turn_rate))
    ticks.numbers["turn_gain"][:] = 0.75
    turn_rate = drawn(plot_flight, ticks, None, ORBIT).axes[-1]
    level = {line.get_label(): line.get_ydata()[-1] for line in turn_rate.lines}
    assert level["steady circle"] == pytest.approx(-8.59, abs=0.01)
    assert level["steady command, gain 0.75"] == pytest.approx(-11.46, abs=0.01)
    columns = chart_data(ticks, None, ORBIT, {})["columns"]
    # turn rate in rad/s, as in the report
    assert columns["steady_command"][1][-1] == pytest.approx(-0.2, abs=1e-3)


def test_picture_shows_estimated_track_without_truth(ticks, drawn):
    """The synthetic run has no estimate for 50 s, then a quarter of a circle."""
    assert len(drawn(plot_flight, ticks, None, ORBIT).axes) == 3
    angle = np.where(ticks.time < 50, np.nan, np.radians(90 * (ticks.time - 50) / 250))
    ticks.numbers["x"], ticks.numbers["y"] = 100 * np.cos(angle), 100 * np.sin(angle)
    track, *others = drawn(plot_flight, ticks, None, ORBIT).axes
    assert len(others) == 3
    lines = {line.get_label(): line for line in track.lines}
    assert list(lines) == ["desired", "flown (estimate)", "first estimate", "target"]
    assert lines["first estimate"].get_xydata()[0] == pytest.approx([100, 0])
    assert lines["first estimate"].get_markerfacecolor() == "none"
    assert np.nanmax(lines["flown (estimate)"].get_ydata()) == pytest.approx(100)
    assert len(track.texts) > 1


def test_picture_lines_have_gaps_at_missing_ticks(run_folder, drawn):
    ticks = read_ticks(rewrite_ticks(run_folder(), lambda time, row: not 100 <= time < 105))
    *_, error, _ = drawn(plot_flight, ticks, None, ORBIT).axes
    # radius errors at 120 m and 101 m, m
    assert error.lines[0].get_ydata()[[0, -1]] == pytest.approx([20.0, 1.0])
    for axis in (error, *drawn(plot_replay, None, ticks, ORBIT).axes[:2]):
        values = next(
            line for line in axis.lines if line.get_label() in ("estimated", "replayed")
        ).get_ydata()
        assert np.isnan(values).sum() == 1


def test_dollar_signs_in_title_are_printed_literally(ticks, drawn):
    titles = ("a $_{ b$ c", "one $", r"\$ and $_{$")
    pictures = (plot_flight, ticks, None, ORBIT), (plot_replay, None, ticks, ORBIT)
    for title, (plot, *arguments) in product(titles, pictures):
        figure = drawn(plot, *arguments, title=title)
        shown, is_formula = figure._suptitle._preprocess_math(figure._suptitle.get_text())
        assert (shown, is_formula) == (title, False)
