"""Observer of a flight: builds the frozen step that record, conditions and display read."""

from __future__ import annotations

from math import atan, inf, isfinite
from typing import TYPE_CHECKING, Any

from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.monitors import (
    AirspeedAlarm,
    ClosingMonitor,
    DriftMonitor,
    LapAlarm,
    watch_airspeed,
    watch_lap,
)
from circnav_mav.guidance.types import GRAVITY, Orbit, TurnCommand
from circnav_mav.mav.frames import YawRate
from circnav_mav.mission.mission import VEHICLE
from circnav_mav.pilot.authority import SILENT, unwatched
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.pilot.rates import RateMeter, Rates
from circnav_mav.pilot.record import TickRecord
from circnav_mav.pilot.status_text import waits_for
from circnav_mav.pilot.step_view import StepView
from circnav_mav.timers import Since

if TYPE_CHECKING:
    from circnav_mav.pilot.pilot import Pilot


class Unknown:
    """Stands for a value that is missing. Each of its attributes is None."""

    def __getattr__(self, name: str) -> Any:
        return None


UNKNOWN = Unknown()


class Observer:
    """Alarms and rates that steer nothing, and the newest step.

    view: newest step, None before the first step.
    records: records of the steps that were not taken yet.
    setpoints_sent: number of sent setpoints.
    """

    def __init__(self) -> None:
        self.view: StepView | None = None
        self.records: list[TickRecord] = []
        self.setpoints_sent = 0
        self._drift_monitor = DriftMonitor()
        self._airspeed_alarm = AirspeedAlarm()
        self._closing_monitor = ClosingMonitor()
        self._lap_alarm = LapAlarm()
        self._rates = RateMeter()
        self._since_silent = Since()
        """Since the newest step in which the vehicle's last mode report was older than SILENT."""

    def step(
        self,
        pilot: Pilot,
        circle: Orbit,
        command: TurnCommand | None,
        sent: YawRate | None,
        now: float,
    ) -> StepView:
        """Return the step.

        circle: circle for which the command was computed.
        sent: yaw rate in the setpoint of this step, rad/s, or None.
        """
        estimate = pilot.tracker.estimate or UNKNOWN
        turn = command or UNKNOWN
        self._judge(pilot)
        session = pilot.session
        tracker = pilot.tracker
        ranging = tracker.ranging
        height = tracker.height
        mission = pilot.mission
        controller = pilot.controller
        frames = pilot.connection.counts[VEHICLE].frames
        counts = Rates(frames, tracker.accepted, ranging.unexplained, self.setpoints_sent)
        self._rates.take(now, counts, steering=mission.steering)
        law, why = self._law(pilot, command)
        engaged = mission.phase is Phase.ENGAGED
        link_age = session.heartbeat_age(now)
        motion = session.motion.at(now)
        model = controller.vehicle
        air = session.adapter.air
        where = tracker.relative or UNKNOWN
        vehicle = session.adapter.name if session.up else "no vehicle yet"
        lateral = model.bank_limit.bank * (pilot.own.airspeed if pilot.own else inf)
        # uplink_silent, 2.0: time without an answer to TIMESYNC, s, after which an alarm is raised.
        # Requests are sent once a second and repeated if lost.
        self.view = StepView(
            time=now,
            phase=mission.phase,
            measured=(tracker.newest or UNKNOWN).r,
            r=estimate.r,
            r_dot=estimate.r_dot,
            r_sigma=estimate.r_sigma,
            r_dot_sigma=estimate.r_dot_sigma,
            nis=tracker.estimator.nis,
            demanded=turn.demanded,
            turn_rate=turn.turn_rate,
            saturated=bool(turn.saturated),
            yaw_rate_sent=sent,
            turn_gain=model.gain,
            turn_delay=model.response.delay,
            gain_share=model.limit_cycle.share,
            law=(command.flies or controller.law) if command and engaged else "",
            x=where.x,
            y=where.y,
            drift_x=where.drift_x,
            drift_y=where.drift_y,
            airspeed_scale=where.scale,
            acceleration_weight=where.acceleration_weight,
            heading=motion.yaw,
            airspeed=motion.airspeed,
            altitude=motion.altitude,
            height=height.at(now),
            range_age=tracker.age(now),
            link_age=link_age if isfinite(link_age) else None,
            mode=session.vehicle.mode_name,
            accepted=tracker.accepted,
            rejected=ranging.refused,
            measured_rate=tracker.measured_rate(now),
            desired=circle.radius,
            direction=circle.direction.value,
            settings=pilot.settings,
            output_mode=pilot.output_mode,
            engaged_at=mission.engaged_at,
            outcome=mission.outcome,
            coast=mission.coast,
            waits=waits_for(pilot, now),
            not_airborne=_not_airborne(pilot, now),
            exit_name=pilot.exit_action.named(session),
            vehicle=f"{vehicle}, firmware {session.vehicle.firmware or 'unknown'}",
            trusted=pilot.trusted,
            second_senders=tuple(session.identity.second_senders.recent(now)),
            second_controller=pilot.second_controller.evidence(now),
            flood=pilot.connection.allowance.flood(now) / 1000,
            uplink_silent=session.timesync.silent(now, 2.0),
            stalled=pilot.authority.stalled(now),
            clock_speed=session.vehicle.clock_speed.found,
            setpoints=self.setpoints_sent,
            rejected_by=dict(ranging.rejected.most_common()),
            rates=None if pilot.done else self._rates.newest,
            full_rates=self._rates.whole,
            steered_rates=self._rates.while_steering,
            one_way=tracker.one_way,
            frozen_for=tracker.noise.repeated,
            jumped_by=tracker.jumps.found,
            noise_found=tracker.noise.found,
            noise_lowered=tracker.noise.lowered,
            range_rate_trouble=tracker.rates.trouble,
            sensor_clock_doubted=ranging.clock.doubted,
            source_choice="" if ranging.sender_stays else ranging.sources.short_choice(now),
            lost_reports=self._lost_reports(pilot, now),
            failed_imu=session.motion.accelerations.failed,
            used_imu=session.motion.accelerations.used,
            heading_jump=session.motion.jumped,
            height_held=height.is_held(now),
            altitude_jump=height.jump,
            implausible_airspeed=pilot.path.implausible_airspeed,
            unchecked_bound=unwatched(pilot.settings, session, now),
            method_failure=pilot.method.failure,
            drift_alarm=self._drift_monitor.alarm,
            airspeed_alarm=self._airspeed_alarm,
            closing_alarm=self._closing_monitor.alarm,
            lap_alarm=self._lap_alarm,
            circle=controller.circle,
            flown_law=law,
            why=why,
            follows=model.command_following.follows,
            speed=controller.speed(session),
            lean_share=session.adapter.speed_share,
            lean_limit=0.0 if air is None else atan(air.lean.found / GRAVITY),
            bank_limit=atan(lateral / GRAVITY),
        )
        self.records.append(self.view)
        return self.view

    def _judge(self, pilot: Pilot) -> None:
        """Update the alarms of the guidance."""
        estimate = pilot.tracker.estimate
        orbit = pilot.controller.orbit
        steered = estimate if pilot.mission.steering else None
        self._drift_monitor.update(steered, orbit, pilot.controller.vehicle.most)
        if pilot.session.adapter.fixed_wing:
            self._airspeed_alarm = watch_airspeed(self._airspeed_alarm, estimate, orbit)
        engaged = estimate if pilot.mission.phase is Phase.ENGAGED else None
        self._closing_monitor.update(engaged, orbit)
        estimation = pilot.settings.estimation_of(type(pilot.session.adapter))
        # Tolerance of the lap alarm: three standard deviations of the airspeed scale.
        tolerance = max(3 * estimation.scale_sigma, 0.1)
        self._lap_alarm = watch_lap(self._lap_alarm, engaged, tolerance)

    def _law(self, pilot: Pilot, command: TurnCommand | None) -> tuple[str, str]:
        """Return the law that `auto` or `drift` flies now, and the reason, human-readable. Both are
        empty for other laws."""
        relative = LAWS[pilot.controller.law].flies_relative_motion
        if command is not None and (command.flies or not relative):
            return command.flies, command.why
        return ("", "") if self.view is None else (self.view.flown_law, self.view.why)

    def _lost_reports(self, pilot: Pilot, now: float) -> tuple[str, ...]:
        """Return the names of telemetry that is missing or too rare. Unchanged while the vehicle is
        completely silent."""
        session = pilot.session
        if session.heartbeat_age(now) > SILENT:
            self._since_silent.restart(now)
        # 3.0: time, s, after a silence until all telemetry streams are received again.
        if self._since_silent.age(now) <= 3.0:
            return () if self.view is None else self.view.lost_reports
        seldom = ("attitude",) if session.motion.seldom(now) else ()
        return (*seldom, *session.missing(now))


def _not_airborne(pilot: Pilot, now: float) -> str:
    """Return the condition that the flight of an armed vehicle does not meet yet, or an empty
    string."""
    waits = pilot.mission.phase in (Phase.READY, Phase.YIELDED) and pilot.flies
    if not (waits and pilot.session.vehicle.armed):
        return ""
    obstacle = pilot.airborne.obstacle(now)
    return "" if obstacle is None else obstacle.short
