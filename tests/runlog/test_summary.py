"""summary.json: its keys, which users' scripts read, and figures calculated by hand."""

import json
import math
from dataclasses import replace

import pytest

from circnav_mav.guidance.types import Direction, Orbit
from circnav_mav.runlog.atomic_write import write_json
from circnav_mav.runlog.metrics import NAMES
from circnav_mav.runlog.summary import FlightFacts, summarise
from circnav_mav.runlog.ticks import NO_TICKS, read_ticks, read_truth
from tests.runlog.conftest import EPOCH_US, rewrite_ticks

FACTS = FlightFacts(
    mission="by hand",
    outcome="completed",
    reason="flown to its end",
    orbit=Orbit(100.0, Direction.CLOCKWISE, 15.0, 0.35),
    samples_accepted=2800,
    samples_rejected={"gated": 3},
    setpoints_sent=5000,
    firmware="4.6.3",
    version="0",
    epoch_us=EPOCH_US,
    recording_problem=None,
)


@pytest.fixture
def summary(run_folder):
    """Return a function that summarizes a run folder with changed ticks and facts; see
    `rewrite_ticks`."""

    def make(change=lambda time, row: None, facts=FACTS, **kind):
        folder = rewrite_ticks(run_folder(**kind), change)
        return summarise(facts, read_ticks(folder), read_truth(folder, EPOCH_US))

    return make


def test_summary_contains_figures_after_engagement(summary):
    """The flight engages at 10 s and is at 101 m from 100 s on, so it settles 90 s after engaging.
    Users' scripts read these keys."""
    made = summary()
    figures = {"settled_s": 90.0, "radius_mean_m": 101.0, "radius_rms_error_m": 1.0}
    assert {key: made[key] for key in figures} == pytest.approx(figures)
    assert (made["engaged_s"], made["flown_s"], made["steered_s"]) == (10.0, 290.0, 290.0)
    assert made["direction"] == made["direction_commanded"] == "clockwise"
    expected = {"direction": "clockwise"}
    truth = figures | {"closest_approach_m": 101.0}
    assert made["truth"].items() >= expected.items()
    assert {key: made["truth"][key] for key in truth} == pytest.approx(truth, abs=2e-3)
    assert set(made) >= {
        "mission",
        "outcome",
        "reason",
        "desired_radius_m",
        "samples_accepted",
        "samples_rejected",
        "setpoints_sent",
    }
    assert summary(truth=False)["truth"] is None


ORDERED_LEFT = {"direction_commanded": "counterclockwise", "direction": "clockwise"}
TAKEOVER = {
    (100, 150): {"phase": "yielded"},
    (200, 200.5): {"phase": "ready"},
    (250, 260): {"phase": "coasting"},
}
EVENTS = {
    "wrong direction": ({"clockwise": False}, {}, ORDERED_LEFT),
    # 90 s of left turn at 1 rad/s, then 200 s of right turn at 0.15 rad/s
    "first turn to the other side": (
        {},
        {(10, 100): {"turn_rate": "1.0"}},
        {"direction_commanded": "clockwise"},
    ),
    # ticks during a lost link contain extrapolated values and are excluded
    "outage": (
        {},
        {(200, 999): {"phase": "waiting for the link", "r": "20.0"}},
        {"radius_mean_m": 101.0, "settled_s": 90.0},
    ),
    # a range outside the band (106 m) for a moment begins no new settling, for 11 s it does
    "single range": ({}, {(250, 250.5): {"r": "106.0"}}, {"settled_s": 90.0}),
    "outside the band": ({}, {(250, 261): {"r": "106.0"}}, {"settled_s": None}),
    # steered time excludes the takeover, and includes coasting
    "takeover": ({}, TAKEOVER, {"flown_s": 290.0, "steered_s": 239.5}),
}


@pytest.mark.parametrize(("kind", "change", "expected"), EVENTS.values(), ids=EVENTS)
def test_summary_figures_follow_events_of_flight(summary, kind, change, expected):
    def happened(time, row):
        row.update(*(cells for (begin, end), cells in change.items() if begin <= time < end))

    made = summary(happened, **kind)
    assert {name: made[name] for name in expected} == pytest.approx(expected)
    assert made["truth"]["direction"] == (
        "clockwise" if kind.get("clockwise", True) else "counterclockwise"
    )
    assert made["truth"]["settled_s"] == 90.0


def test_flight_without_engagement_has_no_figures(summary):
    made = summary(engaged=False)
    unknown = (
        "engaged_s",
        "settled_s",
        "radius_mean_m",
        "radius_rms_error_m",
        "radius_sigma_m",
        "truth",
        "direction_commanded",
        *NAMES,
    )
    assert [key for key in unknown if made[key] is not None] == []
    assert made["flown_s"] == made["steered_s"] == 0.0


def test_flight_time_continues_after_end_of_recording(summary):
    """The flight lasted until 500 s. The recording contains 300 s or is empty."""
    flown = replace(FACTS, engaged_s=10.0, until_s=500.0, recording_problem="full")
    made = summary(facts=flown)
    assert made["flown_s"] == 490.0
    assert (
        made["recording_problem"]
        == "full; figures cover estimates up to 300 s, truth up to 300 s of 500 s"
    )
    made = summarise(replace(flown, recording_problem=None), NO_TICKS, None)
    assert (made["engaged_s"], made["flown_s"], made["radius_mean_m"]) == (10.0, 490.0, None)
    assert made["recording_problem"] == "figures cover estimates up to 0 s of 500 s"


def test_turn_figures_cover_last_third_of_steering(summary):
    """From 200 s on, the turn rate alternates by 0.1 rad/s, with one tick in four at the limit.
    Values before 200 s and in other phases are excluded."""

    def change(time, row):
        at = round(2 * time)
        swings = time >= 200
        row.update(
            turn_rate=str(0.1 * (-1) ** at if swings else 3.0),
            saturated=str(int(swings and at % 4 == 0)),
        )
        if time > 295:
            row.update(phase="coasting", turn_rate="9.0")

    made = summary(change)
    assert made["turn_std_deg_s"] == pytest.approx(5.73, abs=0.01)
    assert made["turn_at_limit"] == pytest.approx(0.25, abs=0.01)
    assert made["turn_variation_rad_s2"] == pytest.approx(0.2 / 0.5, rel=0.01)


# --- the file


def test_summary_file_is_standard_json(summary, tmp_path):
    for made, expected in (
        (summary(), None),
        ({"a": math.nan, "b": {"c": [math.inf, 1.5]}, "d": (-math.inf, True), "e": None},
         {"a": None, "b": {"c": [None, 1.5]}, "d": [None, True], "e": None}),
    ):  # fmt: skip
        write_json(tmp_path / "summary.json", made)
        text = (tmp_path / "summary.json").read_text(encoding="utf-8")
        assert json.loads(text, parse_constant=pytest.fail) == (expected or made)


def test_requested_direction_begins_new_circle_in_summary(summary):
    """Counterclockwise is requested at 100 s. The simulated vehicle continues clockwise."""

    def reverse(time, row):
        row["direction"] = "clockwise" if time < 100 else "counterclockwise"

    made = summary(reverse)
    assert [one["direction"] for one in made["circles"]] == ["clockwise", "counterclockwise"]
    assert made["direction"] == "counterclockwise" and made["circles"][1]["begun_s"] == 100.0
