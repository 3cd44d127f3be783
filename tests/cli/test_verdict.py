"""Texts of the verdict for a dry run, a short flight and a busy link."""

from pathlib import Path
from typing import Any

import pytest

from circnav_mav.cli.verdict import verdict

FIGURES = {"settled_s": 20.0, "radius_mean_m": 100.5, "radius_rms_error_m": 0.7}
TRUTH: dict[str, Any] = {**FIGURES, "direction": "clockwise", "closest_approach_m": 97.0}
SUMMARY: dict[str, Any] = {
    "output_mode": "fly",
    "outcome": "completed",
    "reason": "flown to its end",
    "desired_radius_m": 100.0,
    "direction": "clockwise",
    "direction_commanded": "clockwise",
    "engaged_s": 2.0,
    "flown_s": 60.0,
    **FIGURES,
    "steered_s": 60.0,
    "circles": [{}],
    "clock_speed": None,
    "law_changes": 0,
    "turn_limit_cycle": False,
    "samples_accepted": 600,
    "samples_rejected": {"gated": 3},
    "frames_refused": {},
    "setpoints_sent": 1200,
    "truth": TRUTH,
    "recording_problem": None,
}
TURN = {"turn_std_deg_s": 7.31, "turn_at_limit": 0.112}
GAIN = {"turn_gain": 0.98, "turn_delay_s": 0.31, "law_changes": 2}


def verdict_of(**changes: Any) -> str:
    return verdict({**SUMMARY, **changes}, Path("run"))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "rotation clockwise (as desired), closest approach 97.0 m"),
        (
            {"truth": {**TRUTH, "direction": "counterclockwise"}},
            "rotation counterclockwise (NOT AS DESIRED)",
        ),
        ({"truth": {**TRUTH, "direction": None}}, "rotation unknown, closest"),
        ({"truth": None}, "rotation   clockwise commanded; ranges cannot confirm the direction"),
        ({}, "estimated  settled after 20 s, radius 100.50 m, RMS error 0.70 m (0.70 %)\n"),
        ({"radius_sigma_m": 0.213}, "(0.70 %) + estimator's own error, sigma 0.21 m\n"),
        (
            {"height_max_m": 37.0},
            "rests on   the radio, and height 37.0 m; 1 m of height: 0.37 m of radius, 1 m of range"
            " offset: 1.07 m of radius\n",
        ),
        (
            {},
            "rests on   the radio, and no height, ranges taken as horizontal; 1 m of height: 0.00",
        ),
        ({"settled_s": None}, "estimated  never settled, radius"),
        ({"radius_mean_m": None}, "estimated  radius unknown"),
        ({}, "flown 60 s; "),
        ({"flown_s": 120.0, "steered_s": 70.0}, "flown 120 s (70 s steered); "),
        ({"flown_s": 120.0, "steered_s": 119.9}, "flown 120 s; "),
        (
            {"output_mode": "dry run", "flown_s": 120.0, "steered_s": 70.0},
            "would have steered for 70 s",
        ),
        ({}, "600 accepted, 3 rejected (3 gated (outliers))\n"),
        (
            {"samples_rejected": {"wrong_source": 599}},
            "0 rejected (none); 599 of other senders ignored",
        ),
        (
            {"samples_rejected": {"clock": 12, "too_old": 1, "other_sensor": 3}},
            "13 rejected (12 clock (sensor clock stepped), 1 too_old); 3 of other senders ignored",
        ),
        ({"frames_refused": {"unsigned": 5}}, "frames     rejected by their signature: 5 unsigned"),
        (
            {"clock_speed": 8.0},
            'runs 8 times as fast as ours: for a simulator set link.clock = "autopilot"',
        ),
        (TURN, "turn       command std 7.3 deg/s, at the limit 11 % of the time\n"),
        (
            {**TURN, "turn_variation_rad_s2": 1.24},
            "at the limit 11 % of the time, variation 1.2 rad/s^2",
        ),
        ({**TURN, **GAIN}, "vehicle    turn gain 0.98, turn delay 0.31 s; law changes 2"),
        ({**TURN, "turn_limit_cycle": True}, "WARNING    LIMIT CYCLE: the turn command oscillates"),
        ({**TURN, "gain_share": 0.7}, "oscillates, gains reduced to 70 %"),
        (
            {"notes": ["  target     found", "  WARNING    lost"]},
            "1200 sent\n  target     found\n  WARNING    lost\n",
        ),
        (
            {
                "circles": [
                    {**FIGURES, "desired_radius_m": 80.0, "direction": "clockwise", "begun_s": 2.0},
                    {},
                ]
            },
            "80 m clockwise, begun at 2 s: settled",
        ),
    ],
)
def test_verdict_text_follows_summary_values(changes: dict[str, Any], words: str) -> None:
    assert words in verdict_of(**changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "WARNING"),
        ({"clock_speed": None, "turn_limit_cycle": False, **TURN}, "WARNING"),
        ({"turn_std_deg_s": 5.0, "turn_at_limit": None}, "at the limit"),
        ({"radius_mean_m": None, "height_max_m": None}, "no height"),
    ],
)
def test_verdict_omits_normal_values(changes: dict[str, Any], words: str) -> None:
    assert words not in verdict_of(**changes)


@pytest.mark.parametrize("output_mode", ["dry run", "shadow"])
def test_verdict_of_dry_run_has_no_figures(output_mode: str) -> None:
    words = verdict_of(output_mode=output_mode, reason="dry run to its end", setpoints_sent=0)
    assert (
        f"  {output_mode.upper():<9}  no setpoint sent, would have steered for 60 s"
        == words.splitlines()[1]
    )
    assert not any(mark in words for mark in ("settled", "RMS", "rotation"))
