"""What is told of a step: its record, and the values that a ground station plots."""

from math import isfinite

from circnav_mav.guidance.phases import Phase
from circnav_mav.guidance.types import Orbit, RangeEstimate, RangeSample, TurnCommand
from circnav_mav.mav.frames import YawRate, yaw_rate_from_turn_rate
from circnav_mav.mav.session import Session
from circnav_mav.pilot.settings import TickRecord


def plot_values(orbit: Orbit, estimate: RangeEstimate | None, command: TurnCommand | None) -> dict[str, float]:
    """NAMED_VALUE_FLOAT names and values: range, range rate, error, yaw rate (clockwise positive)."""
    if estimate is None:
        return {}
    yaw_rate = yaw_rate_from_turn_rate(command.turn_rate) if command else 0.0
    return {
        "CN_RNG": estimate.r, "CN_RRATE": estimate.r_dot, "CN_ERR": estimate.r - orbit.radius, "CN_YRATE": yaw_rate
    }  # fmt: skip


def tick_record(
    now: float,
    phase: Phase,
    session: Session,
    estimate: RangeEstimate | None,
    command: TurnCommand | None,
    sent: YawRate | None,
    *,
    newest: RangeSample | None,
    height: float | None,
    nis: float | None,
    turn_gain: float,
    turn_delay: float,
    gain_share: float,
    law: str,
    accepted: int,
    rejected: int,
) -> TickRecord:
    """A step in numbers. law: of the mission. sent: the yaw rate that left."""
    link_age, motion = session.heartbeat_age(now), session.motion.at(now)
    where = estimate.relative if estimate and estimate.relative and estimate.relative.trusted else None
    return TickRecord(
        time=now,
        phase=phase,
        measured=newest.r if newest else None,
        r=estimate.r if estimate else None,
        r_dot=estimate.r_dot if estimate else None,
        r_sigma=estimate.r_sigma if estimate else None,
        r_dot_sigma=estimate.r_dot_sigma if estimate else None,
        nis=nis,
        demanded=command.demanded if command else None,
        turn_rate=command.turn_rate if command else None,
        saturated=command.saturated if command else False,
        yaw_rate_sent=sent,
        turn_gain=turn_gain,
        turn_delay=turn_delay,
        gain_share=gain_share,
        law=(command.flies or law) if command and phase is Phase.ENGAGED else "",
        x=where.x if where else None,
        y=where.y if where else None,
        drift_x=where.drift_x if where else None,
        drift_y=where.drift_y if where else None,
        airspeed_scale=where.scale if where else None,
        heading=motion.yaw,
        airspeed=motion.airspeed,
        altitude=motion.altitude,
        height=height,
        range_age=None if newest is None else now - newest.time,
        link_age=link_age if isfinite(link_age) else None,
        mode=session.mode_name,
        accepted=accepted,
        rejected=rejected,
    )
