"""Verdict: the result of a flight as text."""

from pathlib import Path
from typing import Any

from circnav_mav.guidance.maths import radius_sensitivity
from circnav_mav.mav.ranging.interface import OTHERS, Reject, describe_rejected
from circnav_mav.pilot.conditions import clock_alarm, limit_cycle_alarm

RESTARTED = (
    "a radio may change its port after 1.5 s of silence if its range continues, not its host"
)
"""Rule for ranges from another address (`RangeReader`)."""
NOTABLE = 1.0
"""The steered time is printed if circnav did not steer for longer than this, s."""


def verdict(summary: dict[str, Any], folder: Path) -> str:
    """Return the result of a flight in a few lines. summary: from `summarise`, with additions of
    listeners."""
    lines = [f"{summary['outcome'].upper()}: {summary['reason']}"]
    if summary["output_mode"] != "fly":
        title = f"{summary['output_mode'].upper():<9}"
        lines.append(
            f"  {title}  no setpoint sent, would have steered for {summary['steered_s']:.0f} s"
        )
    elif summary["engaged_s"] is not None:
        lines += _circle(summary)
    lines.append(
        f"  ranges     {summary['samples_accepted']} accepted,"
        f" {_refused(summary['samples_rejected'])}"
    )
    if refused := summary["frames_refused"]:
        why = ", ".join(f"{count} {reason}" for reason, count in sorted(refused.items()))
        lines.append(f"  frames     rejected by their signature: {why}")
    lines.append(f"  setpoints  {summary['setpoints_sent']} sent")
    lines += summary.get("notes", ())
    if summary["clock_speed"] is not None:
        lines.append(f"  WARNING    {clock_alarm(summary['clock_speed'])}")
    if summary["recording_problem"]:
        lines.append(f"  WARNING    {summary['recording_problem']}")
    lines.append(f"  run folder {folder}")
    return "\n".join(lines)


def _refused(rejected: dict[str, int]) -> str:
    """Return the counts of rejected ranges as text. Ranges of other senders are harmless and
    counted separately."""
    own = {reason: count for reason, count in sorted(rejected.items()) if reason not in OTHERS}
    others = sum(rejected.values()) - sum(own.values())
    ignored = f"; {others} of other senders ignored" if others else ""
    if rejected.get(Reject.WRONG_SOURCE.value):
        ignored += f" ({RESTARTED})"
    return f"{sum(own.values())} rejected ({describe_rejected(own)}){ignored}"


def _circle(summary: dict[str, Any]) -> list[str]:
    """Return the lines of settling and radius, estimated and by the simulator's truth."""
    desired = summary["desired_radius_m"]
    truth = summary["truth"]
    flown = summary["flown_s"]
    steered = summary["steered_s"]
    of_these = f" ({steered:.0f} s steered)" if flown - steered > NOTABLE else ""
    circles = summary["circles"]
    lines = [
        f"  before     circle of {circle['desired_radius_m']:g} m {circle['direction']}, begun at"
        f" {circle['begun_s']:.0f} s: {_figures(circle, circle['desired_radius_m'])}"
        for circle in circles[:-1]
    ]
    lines.append(
        f"  desired    {desired:g} m {summary['direction']}, flown {flown:.0f} s{of_these}; its"
        " last third:"
    )
    lines.append(f"  estimated  {_figures(summary, desired)}")
    # A flight that ended before its first steered step has neither a radius nor a height.
    if summary["radius_mean_m"] is not None:
        lines.append(f"  rests on   {_basis(desired, summary.get('height_max_m'))}")
    if truth is not None:
        lines.append(f"  truth      {_figures(truth, desired)}")
        right = "as desired" if truth["direction"] == summary["direction"] else "NOT AS DESIRED"
        rotation = f"{truth['direction']} ({right})" if truth["direction"] else "unknown"
        lines.append(
            f"             rotation {rotation}, closest approach"
            f" {truth['closest_approach_m']:.1f} m"
        )
    else:
        commanded = summary["direction_commanded"] or "none"
        lines.append(f"  rotation   {commanded} commanded; ranges cannot confirm the direction")
    return lines + _turn(summary)


def _basis(radius: float, height: float | None) -> str:
    """Return text with the inputs on which the estimated radius depends. Errors of these inputs do
    not show in the estimate."""
    given = "no height, ranges taken as horizontal" if height is None else f"height {height:.1f} m"
    return f"the radio, and {given}; {radius_sensitivity(radius, height or 0.0)}"


def _turn(summary: dict[str, Any]) -> list[str]:
    """Return the printed lines about the turn command, the vehicle's turn response and a limit
    cycle, if detected."""
    std, at_limit, variation = map(
        summary.get, ("turn_std_deg_s", "turn_at_limit", "turn_variation_rad_s2")
    )
    if std is None or at_limit is None:
        return []
    varies = "" if variation is None else f", variation {variation:.2g} rad/s^2"
    lines = [
        f"  turn       command std {std:.1f} deg/s, at the limit {100 * at_limit:.0f} % of the"
        f" time{varies}"
    ]
    gain, delay, share = map(summary.get, ("turn_gain", "turn_delay_s", "gain_share"))
    if gain is not None and delay is not None:
        changes = summary["law_changes"]
        lines.append(
            f"  vehicle    turn gain {gain:.2f}, turn delay {delay:.2f} s; law changes {changes}"
        )
    reduced = share is not None and share < 1
    if summary["turn_limit_cycle"] or reduced:
        alarm = limit_cycle_alarm(share or 1.0)
        lines.append(f"  WARNING    {alarm if reduced else alarm.partition(',')[0]}")
    return lines


def _figures(figures: dict[str, Any], desired: float) -> str:
    if figures["radius_mean_m"] is None:
        return "radius unknown"
    settled = (
        "never settled"
        if figures["settled_s"] is None
        else f"settled after {figures['settled_s']:.0f} s"
    )
    mean = figures["radius_mean_m"]
    rms = figures["radius_rms_error_m"]
    line = f"{settled}, radius {mean:.2f} m, RMS error {rms:.2f} m ({100 * rms / desired:.2f} %)"
    # The RMS error is that of the estimate about the desired radius. Without GPS it was 0.1 to
    # 0.25 m smaller than the true one.
    sigma = figures.get("radius_sigma_m")
    return line if sigma is None else f"{line} + estimator's own error, sigma {sigma:.2f} m"
