"""Charts without a plotting library: thinned lines keep their peaks, gaps stay gaps."""

import re

import numpy as np
import pytest

from circnav_mav.report.svg import Chart, Line, spans_chart, thin, track


def test_a_long_line_keeps_every_peak_in_few_points():
    time = np.arange(200_000) / 20
    values = np.sin(time)
    values[123_456], values[77] = 50.0, -50.0
    thinned_time, thinned = thin(time, values, 500)
    assert len(thinned) <= 1000
    assert (thinned.max(), thinned.min()) == (50.0, -50.0)
    assert list(thinned_time) == sorted(thinned_time)
    assert thinned_time[thinned.argmax()] == time[123_456]


def dots_of(values):
    """Heights of the dots of an hour at 20 Hz, in pixels from the top, and the size of the drawing."""
    line = Line("a", np.arange(len(values)) / 20, values, "red", dots=True)
    drawn = Chart("x", "m", [line], shown=(0.0, 10.0)).draw((0.0, 3600.0))
    return np.array([float(y) for y in re.findall(r",([\d.]+)h0", drawn)]), len(drawn)


def test_the_dots_of_an_hour_are_few_and_dense_where_most_of_them_are():
    values = np.abs(np.random.default_rng(1).normal(size=72_000))
    values[54_321] = 9.0
    heights, size = dots_of(values)
    assert size < 120_000
    told = 10.0 * (190 - 22 - heights) / (190 - 22 - 8)
    assert told.max() == pytest.approx(9.0, abs=0.05)
    assert np.mean((told > 0.3) & (told < 1.5)) > 0.4  # of a half-normal 0.63, of the extremes alone next to none


def test_the_lines_of_an_hour_are_no_longer_than_those_of_a_minute():
    def size(seconds):
        time = np.arange(20 * seconds) / 20
        return len(Chart("x", "m", [Line("a", time, np.sin(time), "red")]).draw((0.0, float(seconds))))

    assert size(3600) < 2 * size(60)


def test_a_short_line_is_left_alone():
    time = np.arange(10.0)
    assert thin(time, time)[1] is time


def test_a_gap_lifts_the_pen_also_in_a_long_line():
    time = np.arange(10_000.0)
    values = np.where((time > 3000) & (time < 6000), np.nan, 1.0)
    drawn = Chart("x", "m", [Line("a", time, values, "red")]).draw((0.0, 9999.0))
    path = re.search(r'<path d="(M[^"]*)" fill="none" stroke="red"', drawn)[1]
    assert path.count("M") == 2


@pytest.mark.parametrize("values", [[np.nan, np.nan], [5.0, 5.0], [0.0, 0.0], [-1e-9, 1e9]])
def test_any_values_can_be_drawn(values):
    drawn = Chart("x", "m", [Line("a", np.array([0.0, 1.0]), np.array(values), "red")]).draw((0.0, 1.0))
    assert "nan" not in drawn
    assert "inf" not in drawn


def test_a_line_leaves_the_frame_as_steep_as_it_is_and_the_frame_cuts_it_off():
    """From 0 to 10 in ten seconds, shown up to 1: it leaves after one second, and is flat nowhere."""
    time, values = np.array([0.0, 10.0, 20.0]), np.array([0.0, 10.0, 10.0])
    drawn = Chart("a b", "m", [Line("a", time, values, "red")], shown=(-1.0, 1.0)).draw((0.0, 20.0))
    clip = re.search(r'<clipPath id="frame-a-b"><rect x="(\d+)" y="(\d+)" width="(\d+)" height="(\d+)"/>', drawn)
    assert [int(number) for number in clip.groups()] == [64, 8, 884, 160]
    path = re.search(r'<g clip-path="url\(#frame-a-b\)"><path d="([^"]*)" fill="none" stroke="red"', drawn)[1]
    points = [tuple(map(float, point)) for point in re.findall(r"([\d.]+),(-?[\d.]+)", path)]
    assert points == [(64.0, 88.0), (506.0, -712.0), (948.0, -712.0)]


def test_dots_beyond_the_frame_are_triangles_at_its_edge_that_point_there():
    time, values = np.array([0.0, 1.0, 2.0]), np.array([0.5, 3.0, -3.0])
    drawn = Chart("x", "m", [Line("a", time, values, "red", dots=True)], shown=(0.0, 1.0)).draw((0.0, 2.0))
    assert set(re.findall(r"M([\d.]+,[\d.]+)h0", drawn)) == {"64.0,88.0"}
    beyond = re.search(r'<path d="([^"]*)" fill="red" class="beyond"/>', drawn)[1]
    assert set(re.findall("M[^Z]*Z", beyond)) == {"M506.0,8.0l-3,5h6Z", "M948.0,168.0l-3,-5h6Z"}


def test_a_line_breaks_where_its_samples_pause():
    """At 20 Hz, with a pause of 1.5 s; a single sample that is missing is none."""
    time = np.concatenate([np.arange(0, 5, 0.05), np.arange(6.5, 10, 0.05)])
    time = np.delete(time, 30)
    drawn = Chart("x", "m", [Line("a", time, time, "red")]).draw((0.0, 10.0))
    assert re.search(r'<path d="(M[^"]*)" fill="none" stroke="red"', drawn)[1].count("M") == 2


def test_a_track_breaks_where_it_is_not_known():
    x, y = np.linspace(0, 100, 9000), np.full(9000, 100.0)
    x[5000:5002] = np.nan
    drawn = track(x, y, 100.0, "blue")
    assert re.search(r'<path d="(M[^"]*)" fill="none" stroke="blue"', drawn)[1].count("M") == 2


def test_words_become_one_stretch_each():
    drawn = spans_chart("phase", np.arange(6.0), ["a", "a", "b", "b", "a", "a"], {"a": "red", "b": "blue"}, (0.0, 5.0))
    assert drawn.count("<rect") == 3
    assert drawn.count('class="key"') == 2


def test_north_is_up_and_east_is_right_and_arrows_point_ahead():
    """From 100 m north of the target towards the east: starts above the middle, arrows point to the right."""
    drawn = track(np.linspace(0, 100, 50), np.full(50, 100.0), 100.0, "blue", side=520)
    start = re.search(r'<path d="M([\d.]+),([\d.]+)m0,-8', drawn)
    assert float(start[1]) == pytest.approx(260.0)
    assert float(start[2]) < 40
    assert set(re.findall(r"rotate\((-?\d+)\)", drawn)) <= {"0", "-0"}


def test_text_is_escaped():
    assert "<b>x</b>" not in spans_chart("<b>x</b>", np.arange(2.0), ["<i>", "<i>"], {}, (0.0, 1.0))


def test_the_desired_circle_lies_on_the_track_not_under_it():
    angle = np.linspace(0, 20, 500)
    drawn = track(100 * np.cos(angle), 100 * np.sin(angle), 100.0, "blue")
    assert drawn.index('stroke="blue"') < drawn.index('class="desired"')


def test_the_last_number_of_the_time_axis_is_not_cut_off():
    drawn = spans_chart("phase", np.array([0.0, 36000.0]), ["a", "a"], {}, (0.0, 36000.0))
    (last,) = re.findall(r'<text x="([0-9.]+)" y="[0-9]+" text-anchor="middle">36000</text>', drawn)
    assert float(last) + 2.5 * 6.5 <= 960
