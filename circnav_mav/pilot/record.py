"""Record of a step, and the values that a ground station plots."""

from math import isfinite
from typing import NamedTuple

from circnav_mav.guidance.types import Orbit, RangeEstimate, TurnCommand
from circnav_mav.mav.frames import YawRate, yaw_rate_from_turn_rate
from circnav_mav.mav.session import Session
from circnav_mav.pilot.controller import Controller
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.pilot.range_tracker import RangeTracker
from circnav_mav.pilot.settings import OutputMode

_WOULD = {Phase.ENGAGED: "would steer", Phase.HOLDING: "would hold"}


def phase_name(phase: Phase, output_mode: OutputMode) -> str:
    """Return the human-readable phase: "would steer" instead of "engaged" if no setpoints are
    sent."""
    return phase.value if output_mode is OutputMode.FLY else _WOULD.get(phase, phase.value)


class TickRecord(NamedTuple):
    """One step, for the log and the display. None means "unknown" or "not sent".

    Turn rates are the paper's (counterclockwise positive) except yaw_rate_sent, which is MAVLink's.
    turn_gain, turn_delay (s): response of the vehicle to turn commands. gain_share: share of the
    gains left after an oscillation. law: law in use. x to airspeed_scale: relative motion if
    estimated (vehicle minus target, m; wind minus target velocity, m/s; paper's frame). felt:
    weight of the measured accelerations in this estimate, 0 to 1. height: above the target, m, used
    to convert slant ranges. measured_rate: newest accepted range rate of the radio, m/s. desired:
    radius of the circle flown now, m.
    """

    time: float
    phase: Phase
    measured: float | None
    r: float | None
    r_dot: float | None
    r_sigma: float | None
    r_dot_sigma: float | None
    nis: float | None
    demanded: float | None
    turn_rate: float | None
    saturated: bool
    yaw_rate_sent: float | None
    turn_gain: float
    turn_delay: float
    gain_share: float
    law: str
    x: float | None
    y: float | None
    drift_x: float | None
    drift_y: float | None
    airspeed_scale: float | None
    felt: float | None
    heading: float | None
    airspeed: float | None
    altitude: float | None
    height: float | None
    range_age: float | None
    link_age: float | None
    mode: str
    accepted: int
    rejected: int
    measured_rate: float | None = None
    desired: float | None = None


def plot_values(
    orbit: Orbit, estimate: RangeEstimate | None, command: TurnCommand | None
) -> dict[str, float]:
    """Return NAMED_VALUE_FLOAT names and values: range, range rate, error, yaw rate (clockwise
    positive)."""
    if estimate is None:
        return {}
    yaw_rate = yaw_rate_from_turn_rate(command.turn_rate) if command else 0.0
    return {
        "CN_RNG": estimate.r,
        "CN_RRATE": estimate.r_dot,
        "CN_ERR": estimate.r - orbit.radius,
        "CN_YRATE": yaw_rate,
    }


def tick_record(
    now: float,
    phase: Phase,
    estimate: RangeEstimate | None,
    command: TurnCommand | None,
    sent: YawRate | None,
    *,
    desired: float,
    session: Session,
    tracker: RangeTracker,
    controller: Controller,
    law: str,
) -> TickRecord:
    """Return the record of a step. sent: yaw rate in its setpoint, or None. desired: radius, m.
    law: chosen law."""
    link_age = session.heartbeat_age(now)
    motion = session.motion.at(now)
    newest = tracker.newest
    where = (
        estimate.relative if estimate and estimate.relative and estimate.relative.trusted else None
    )
    return TickRecord(
        time=now,
        phase=phase,
        measured=newest.r if newest else None,
        r=estimate.r if estimate else None,
        r_dot=estimate.r_dot if estimate else None,
        r_sigma=estimate.r_sigma if estimate else None,
        r_dot_sigma=estimate.r_dot_sigma if estimate else None,
        nis=tracker.estimator.nis,
        demanded=command.demanded if command else None,
        turn_rate=command.turn_rate if command else None,
        saturated=command.saturated if command else False,
        yaw_rate_sent=sent,
        turn_gain=controller.vehicle.gain,
        turn_delay=controller.vehicle.response.delay,
        gain_share=controller.vehicle.limit_cycle.share,
        law=(command.flies or law) if command and phase is Phase.ENGAGED else "",
        x=where.x if where else None,
        y=where.y if where else None,
        drift_x=where.drift_x if where else None,
        drift_y=where.drift_y if where else None,
        airspeed_scale=where.scale if where else None,
        felt=where.acceleration_weight if where else None,
        heading=motion.yaw,
        airspeed=motion.airspeed,
        altitude=motion.altitude,
        height=tracker.height.at(now),
        range_age=tracker.age(now),
        link_age=link_age if isfinite(link_age) else None,
        mode=session.vehicle.mode_name,
        accepted=tracker.accepted,
        rejected=tracker.ranging.refused,
        measured_rate=tracker.measured_rate(now),
        desired=desired,
    )
