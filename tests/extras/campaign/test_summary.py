"""Summary of a campaign: confidence intervals with their stated coverage, against textbook values
and in simulation, and pictures."""

import json
from math import inf, isnan

import numpy as np
import pytest

from circnav_mav.extras.campaign.command import _print_figures
from circnav_mav.extras.campaign.figures import figures, summarize, wilson
from circnav_mav.extras.campaign.plots import _against, _distributions, _starts, plot_campaign
from circnav_mav.runlog.many_flights import median_interval, quantile

TURN = {
    "turn_std_deg_s": "1",
    "turn_at_limit": "0.25",
    "turn_variation_rad_s2": "0.2",
    "turn_limit_cycle": "false",
}


def rows_of(kept, rms, points=1):
    """Return rows in the order of their runs, at some points of a grid with the key k."""
    return [
        {
            "run": str(run),
            "k": str(run % points),
            "outcome": "completed",
            "kept": "true" if good else "false",
            "rms_m": f"{error:.6g}",
            "settled_s": "5",
            "closest_m": "3",
            "right_way": "true",
            "wind": f"{error:.4g}",
            **TURN,
        }
        for run, (good, error) in enumerate(zip(kept, rms, strict=True))
    ]


def test_confidence_intervals_match_textbook():
    """Wilson's interval (1927) for 8 of 10 flights. By the binomial distribution, the values of
    rank 40 and 61 of 100 enclose the median with 95 % confidence."""
    assert wilson(0.8, 10) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    assert median_interval(list(range(1, 101)), 100) == (40.0, 61.0)


def test_settling_time_quantile_is_infinite_for_unsettled_flights():
    assert quantile([4.2, 5.8, 10.8, 12.0], 0.5) == pytest.approx(8.3)
    assert [quantile(values, 0.5) for values in ([1, 2, inf], [1, inf], [inf, inf])] == [
        2,
        inf,
        inf,
    ]
    assert isnan(quantile([], 0.5))


def test_confidence_interval_of_proportion_0_or_1_includes_proportion():
    for worlds in (1, 7, 30, 1000):
        assert (wilson(0.0, worlds)[0], wilson(1.0, worlds)[1]) == (0.0, 1.0)


def test_confidence_intervals_with_shared_draws_have_stated_coverage():
    """The four grid points of one world give equal results, so the 100 rows of 25 worlds contain 25
    independent samples. The true share kept is 0.7, and the true median is 0."""
    chance = np.random.default_rng(5)
    shares = 0
    medians = 0
    for _ in range(400):
        world = chance.normal(size=25)
        rms = np.repeat(world, 4) + 1e-6 * chance.normal(size=100)
        found = figures(rows_of(np.repeat(chance.random(25) < 0.7, 4), rms, 4), 4)
        shares += found["kept_interval"][0] <= 0.7 <= found["kept_interval"][1]
        medians += found["rms_interval"][0] <= 0 <= found["rms_interval"][1]
    assert found["worlds"] == 25
    # 92 % expected by the binomial distribution; treating all rows as independent would give 62 %
    assert shares / 400 > 0.9
    assert medians / 400 > 0.93


def test_summary_counts_flights_and_conditions_per_varied_value():
    rows = rows_of([True] * 40, np.arange(1.0, 41.0), 4)
    rows[0] |= {"right_way": "false", "kept": "false", "settled_s": "", "turn_limit_cycle": "true"}
    summary = summarize([*rows, never_engaged(40, "0") | {"outcome": "error"}], {"k": (0, 1, 2, 3)})
    rows_of_summary = [summary["all"], *summary["by"]["k"].values()]
    assert [(one["flights"], one["worlds"]) for one in rows_of_summary] == [
        (41, 11),
        (11, 11),
        (10, 10),
        (10, 10),
        (10, 10),
    ]
    assert [(one["kept"], one["wrong_way"], one["failed"]) for one in rows_of_summary[:3]] == [
        (39, 1, 1),
        (9, 1, 1),
        (10, 0, 0),
    ]
    assert (rows_of_summary[0]["closest"], rows_of_summary[0]["limit_cycles"]) == (3.0, 1)
    assert (
        rows_of_summary[0]["turn_std_deg_s"],
        rows_of_summary[0]["turn_at_limit"],
        rows_of_summary[0]["turn_variation_rad_s2"],
    ) == (1.0, 0.25, 0.2)
    assert rows_of_summary[0]["settled_p95"] == 5.0 and figures(rows[:1])["settled_median"] is None
    json.dumps(summary, allow_nan=False)


def test_paired_difference_removes_spread_of_shared_draws():
    """Two laws fly in 20 worlds of very different difficulty. In each world the second law's RMS
    error is larger by 0.1 m."""
    worlds = np.random.default_rng(2).uniform(1.0, 50.0, 20)
    rows = rows_of([True] * 40, np.column_stack([worlds, worlds + 0.1]).ravel(), 2)
    by = summarize([*rows, never_engaged(40, "0")], {"k": ("0", "1")})["by"]["k"]
    assert "pairs" not in by["0"]
    assert (by["1"]["pairs"], by["1"]["difference_median"]) == (20, pytest.approx(0.1, abs=1e-3))
    assert by["1"]["difference_interval"] == pytest.approx((0.1, 0.1), abs=1e-3)


# --- pictures


def test_pictured_median_equals_summary():
    rows = rows_of([True] * 4, [1.0, 2.0, 4.0, 8.0])
    legends = [axis.get_legend() for axis in _distributions(rows, "x").axes]
    texts = [text.get_text() for legend in legends for text in legend.get_texts()]
    assert texts == ["median 3 m", "median 5 s", "median 3 m"]
    assert figures(rows)["rms_median"] == 3.0


def never_engaged(run, k):
    """Row of a flight that ended before it was engaged."""
    return {
        "run": str(run),
        "k": k,
        "outcome": "no range",
        "kept": "false",
        "rms_m": "",
        "settled_s": "",
        "closest_m": "",
        "right_way": "",
        **dict.fromkeys(TURN, ""),
    }


def test_printed_summary_shows_median_interval_and_percentile(capsys):
    _print_figures("all flights", figures(rows_of([True] * 20, np.arange(1.0, 21.0))))
    printed = capsys.readouterr().out
    assert (
        "kept 20 of 20 (100.0 %, 83.9 to 100.0)  RMS 10.5 m (5 to 16), p95 19.1 m  settled 5 s,"
        " p95 5 s" in printed
    )
    assert "  turn sd 1.0 deg/s, at the limit 25 %\n" in printed


def test_pictured_share_of_successful_flights_equals_summary():
    """At one value half of the flights never engaged, and at another value no flight engaged."""
    rows = rows_of([True] * 4, [1.0, 2.0, 3.0, 4.0])
    rows += [never_engaged(run, "0") for run in range(4, 8)] + [
        never_engaged(run, "7") for run in range(8, 12)
    ]
    error, share = _against(rows, "k", ["k"], "x").axes
    shares = {
        value["kept_share"] for value in summarize(rows, {"k": ("0", "7")})["by"]["k"].values()
    }
    assert (
        [100 * one for one in sorted(shares, reverse=True)]
        == list(share.lines[0].get_ydata())
        == [50.0, 0.0]
    )
    assert np.isnan(error.lines[0].get_ydata()[1])


def test_unengaged_and_failed_flights_are_counted_separately():
    rows = [
        *rows_of([True] * 4, [1.0, 2.0, 3.0, 4.0]),
        never_engaged(4, "0"),
        never_engaged(5, "0"),
    ]
    found = figures(rows)
    title = _distributions([*rows, rows[-1] | {"outcome": "error"}], "x").get_suptitle()
    assert (
        found["flights"],
        round(found["kept_share"], 2),
        found["not_engaged"],
        found["failed"],
    ) == (6, 0.67, 2, 0)
    assert title == "x: 4 flights, 2 more never engaged, 1 more could not be flown"


def test_start_picture_shows_share_of_successful_flights():
    starts = {"start_range_m": "50", "start_bearing_deg": "90"}
    rows = [
        row | starts | {"start_heading_deg": f"{30 * at}"}
        for at, row in enumerate(rows_of([True] * 4, [1.0] * 4))
    ]
    rows[3]["kept"] = "false"
    place, turned, _ = _starts(rows, "x").axes
    assert list(place.collections[0].get_array()) == [75.0]
    assert sorted(turned.collections[0].get_array()) == [0.0, 100.0, 100.0, 100.0]


def test_dollar_signs_in_names_are_printed_literally(tmp_path):
    rows = [
        row | dict.fromkeys(("start_range_m", "start_bearing_deg", "start_heading_deg"), row["run"])
        for row in rows_of([True] * 8, [1.0, 2.0, 3.0, 4.0] * 2, 2)
    ]
    rows = [row | {"k": f"$_{{{row['k']}$"} for row in rows]
    drawn, problems = plot_campaign(tmp_path, rows, ["k"], ["k"], "cost $_{\\x $")
    assert ([path.name for path in drawn], problems) == (
        ["starts.png", "distributions.png", "error-k.png"],
        [],
    )
