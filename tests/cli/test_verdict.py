"""The verdict's words: what a dry run, a short flight and a busy link are told of."""

from pathlib import Path
from typing import Any

import pytest

from circnav_mav.cli.verdict import verdict

FIGURES = {"settled_s": 20.0, "radius_mean_m": 100.5, "radius_rms_error_m": 0.7}
SUMMARY: dict[str, Any] = {
    "voice": "fly", "outcome": "completed", "reason": "flown to its end", "desired_radius_m": 100.0,
    "direction": "clockwise", "direction_commanded": "clockwise", "engaged_s": 2.0, "flown_s": 60.0, **FIGURES,
    "samples_accepted": 600, "samples_rejected": {"gated": 3}, "frames_refused": {}, "setpoints_sent": 1200,
    "truth": {**FIGURES, "direction": "clockwise", "closest_approach_m": 97.0}, "recording_problem": None,
}  # fmt: skip


def told(**changes: Any) -> str:
    return verdict({**SUMMARY, **changes}, Path("run"))


@pytest.mark.parametrize(
    ("flown", "words"),
    [
        ("clockwise", "rotation clockwise (as desired)"),
        ("counterclockwise", "rotation counterclockwise (NOT AS DESIRED)"),
        (None, "rotation not known yet, closest"),
    ],
)
def test_only_a_wrong_sense_of_rotation_is_called_wrong(flown: str | None, words: str) -> None:
    assert words in told(truth={**SUMMARY["truth"], "direction": flown})
    assert ("NOT AS DESIRED" in words) == ("NOT AS DESIRED" in told(truth={**SUMMARY["truth"], "direction": flown}))


@pytest.mark.parametrize("voice", ["dry run", "shadow"])
def test_a_flight_that_sent_nothing_says_so_and_is_given_no_marks(voice: str) -> None:
    words = told(voice=voice, reason="dry run to its end", setpoints_sent=0)
    assert f"{voice.upper()}" in words.splitlines()[1]
    assert "no setpoint sent, would have steered for 60 s" in words
    assert not any(mark in words for mark in ("settled", "RMS", "rotation"))


def test_a_flight_with_a_takeover_tells_how_much_of_it_was_steered() -> None:
    assert "flown 120 s (70 s steered); " in told(flown_s=120.0, steered_s=70.0)
    assert "flown 120 s; " in told(flown_s=120.0, steered_s=119.9)
    assert "would have steered for 70 s" in told(voice="dry run", flown_s=120.0, steered_s=70.0)
    assert "flown 60 s; " in told()


def test_ranges_of_other_senders_are_told_apart() -> None:
    """PX4 repeats each range of the radio under its own id."""
    assert "600 accepted, 0 rejected (none); 599 of other senders ignored" in told(
        samples_rejected={"wrong_source": 599}
    )
    mixed = told(samples_rejected={"clock": 12, "too_old": 1, "other_sensor": 3})
    assert "13 rejected (12 clock (sensor clock stepped), 1 too_old); 3 of other senders ignored" in mixed
    assert "600 accepted, 3 rejected (3 gated)\n" in told()


def test_a_summary_of_before_there_were_voices_is_of_a_flight() -> None:
    older = {name: value for name, value in SUMMARY.items() if name != "voice"}
    assert "settled after 20 s" in verdict(older, Path("run"))


def test_time_that_ran_at_another_speed_is_warned_of() -> None:
    assert 'ran 8 times as fast as ours: for a simulator set link.clock = "autopilot"' in told(clock_speed=8.0)
    assert "WARNING" not in told(clock_speed=None)


def test_a_busy_turn_command_is_told_of() -> None:
    figures = {"turn_std_deg_s": 7.31, "turn_at_limit": 0.112}
    assert "turn       command std 7.3 deg/s, at the limit 11 %\n" in told(**figures)
    assert "at the limit 11 %, variation 1.2 rad/s^2" in told(**figures, turn_variation_rad_s2=1.24)
    assert "at the limit" not in told(turn_std_deg_s=None, turn_at_limit=None)
    assert "at the limit" not in told(turn_std_deg_s=5.0, turn_at_limit=None)
    assert "WARNING    limit cycle: the turn command oscillates" in told(**figures, turn_limit_cycle=True)
    assert "limit cycle" not in told(**figures, turn_limit_cycle=False)
