"""The complete application as one object without I/O: bytes and time in, bytes out.

    pilot.receive(data, now); pilot.step(now, send)

A fresh range causes a step that steers by this range. Between ranges, a step at each tick steers by
a prediction. While ranges are missing, the circle's turn rate is commanded. After a time limit
(`Timing.hold`) the flight ends. The operator always has priority: see `authority`.
"""

from collections import Counter
from collections.abc import Callable, Hashable
from dataclasses import replace
from math import atan, inf

from pymavlink.dialects.v20.all import MAV_SEVERITY_NOTICE, MAV_SEVERITY_WARNING

from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.guidance.laws import LAWS
from circnav_mav.guidance.monitors import (
    AirspeedAlarm,
    ClosingMonitor,
    DriftMonitor,
    LapAlarm,
    breach,
    watch_airspeed,
    watch_lap,
)
from circnav_mav.guidance.own_code import StuckCodeError
from circnav_mav.guidance.types import GRAVITY, Orbit, OwnMotion, RangeEstimate, TurnCommand
from circnav_mav.mav.clocks import UNANSWERED
from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import YawRate
from circnav_mav.mav.identity import Allowance
from circnav_mav.mav.parameter_server import REQUESTS, ParameterServer
from circnav_mav.mav.request_server import RequestServer
from circnav_mav.mav.session import LOST_AFTER
from circnav_mav.mav.setpoint_guard import UnsafeSetpointError
from circnav_mav.mav.signing import Signing
from circnav_mav.pilot.air_path import AirPath
from circnav_mav.pilot.airborne import Airborne
from circnav_mav.pilot.authority import SILENT, Allowed, Authority, unwatched
from circnav_mav.pilot.conditions import NOT_FOLLOWING, Conditions
from circnav_mav.pilot.connection import Connection
from circnav_mav.pilot.controller import Controller
from circnav_mav.pilot.gps_loss import GpsLoss
from circnav_mav.pilot.mission_state import NO_FAILURE, Ending, Event, MissionState, Outcome, Phase
from circnav_mav.pilot.mode_request import ExitAction
from circnav_mav.pilot.parameters import flight_parameters
from circnav_mav.pilot.range_tracker import RangeTracker
from circnav_mav.pilot.rates import RateMeter, Rates
from circnav_mav.pilot.record import TickRecord, plot_values, tick_record
from circnav_mav.pilot.second_controller import SecondController
from circnav_mav.pilot.settings import VEHICLE, OutputMode, PilotSettings
from circnav_mav.pilot.status_text import StatusText
from circnav_mav.pilot.step_view import StepView
from circnav_mav.pilot.tick_scheduler import TickScheduler
from circnav_mav.timers import Hysteresis, Since

UNSIGNED = "the link is not signed; to allow changes: link.unsigned_parameters = true"


class Pilot:
    """The guidance application: ranging and vehicle telemetry in, setpoints out."""

    def __init__(self, settings: PilotSettings, signing: Signing | None = None) -> None:
        """signing: signs sent frames and authenticates received ones, or None."""
        self.settings = settings
        self.flies = settings.output_mode is OutputMode.FLY
        self.connection = Connection(settings, signing)
        self.session = self.connection.session
        session = self.session
        self._say = session.announcer.say
        self.tracker = RangeTracker(settings, session)
        self.controller = Controller(settings)
        self.mission = MissionState(settings.timing.hold)
        self.airborne = Airborne(settings, session)
        self._authority = Authority(settings, session, self.mission, self.airborne)
        self._exit_action = ExitAction(settings.exit)
        self._requests = RequestServer()
        self.parameters = ParameterServer(
            flight_parameters(
                self.controller, self.tracker, self._exit_action, session, self.mission
            )
        )
        """Parameters that a ground station may read and set."""
        self._signed = signing is not None and VEHICLE not in settings.unsigned_links
        self.scheduler = TickScheduler(settings.timing.tick)
        self.status = StatusText(
            settings, self.connection, self.mission, self._authority, self.tracker
        )
        self._law = ""
        self._why = ""
        """Reason for the law that `auto` or `drift` flies now, human-readable. Empty for other
        laws."""
        self._drift_monitor = DriftMonitor()
        self._airspeed_alarm = AirspeedAlarm()
        self._closing_monitor = ClosingMonitor()
        self._lap_alarm = LapAlarm()
        self._rates = RateMeter()
        self._unchecked = Hysteresis(raise_after=settings.timing.hold)
        """State of bounds that cannot be checked: as long as ranges, they may be missing."""
        self.allowance = Allowance()
        self.second_controller = SecondController(session, self.mission)
        self._since_unanswered = Since()
        """Since the newest step in which answers to TIMESYNC were missing."""
        self._since_circling = Since()
        """Since the newest step in which the vehicle kept its circle (`_keeps_circle`)."""
        self._since_silent = Since()
        """Since the newest step in which the vehicle's last mode report was older than SILENT."""
        self._lost_reports: tuple[str, ...] = ()
        """Names of telemetry that is missing or too rare. Unchanged while the vehicle is completely
        silent."""
        self.setpoints_sent = 0
        self._records: list[TickRecord] = []
        self._frames: list[bytes] = []
        self._path = AirPath(session, self.tracker, self.controller)
        self.gps_loss = GpsLoss(settings, session, self.tracker, self.controller, self._path)
        self.conditions = Conditions(session.announcer)
        self.view: StepView | None = None
        """Newest step, None before the first step."""
        self.estimate: RangeEstimate | None = None
        """Estimate used by the newest step."""
        self._spacing_refused = ""

    # --- input: received messages

    def receive(
        self, data: bytes, now: float, source: Hashable = None, link: str = VEHICLE
    ) -> None:
        """Process a datagram (or chunk of a stream) that arrived at `now` from `source` on a
        link."""
        if not self._worth_reading(source, len(data), now, link):
            return
        if self._authority.may_be_backlog(now):
            # The vehicle flew on without commands, and its reports waited for this computer. These
            # reports show neither the delay of the link nor the response to commands.
            self.session.timesync.forget_requests()
            self.controller.vehicle.reset()
        for message, of_vehicle, of_ranging in self.connection.receive(data, now, source, link):
            if of_vehicle:
                self._path.receive(message, now, steering=self.mission.steering, flies=self.flies)
                self.gps_loss.receive(message, now)
                self.second_controller.receive(message, now)
            if link == VEHICLE and source == self.session.reply_to:
                # Answers reach only the senders behind the vehicle's address.
                self._requests.receive(message, self.session.us, now)
                if not of_vehicle and message.get_msgId() in REQUESTS:
                    self._take_parameter_request(message, now)
            if of_ranging:
                self._take_range(message, now, source)
        self._frames += self.connection.decoders[link].frames

    def interrupt(self, now: float, reason: str) -> None:
        """End the flight now: the next step sends the safe setpoint."""
        self._finish(Outcome(Ending.INTERRUPTED, reason), now)
        self.scheduler.at_once()

    def request_circle(self, request: CircleRequest, now: float) -> str:
        """Fly another circle, if the vehicle can fly it and the limits of circle changes permit it.
        Return the reason for a refusal, else an empty string."""
        why = self.controller.change_circle(request, now)
        # A fleet requests spacing twice a second: report the same refusal only once.
        if why and not (request.spaces and why == self._spacing_refused):
            self._say("circle refused", why, severity=MAV_SEVERITY_WARNING)
        self._spacing_refused = why if request.spaces else self._spacing_refused
        return why

    def abandon(self, reason: str) -> None:
        """End the flight as aborted because of an internal error, even if the mission already has
        another outcome."""
        self.mission.outcome = Outcome(Ending.ABORTED, reason)

    def _worth_reading(self, source: Hashable, size: int, now: float, link: str) -> bool:
        """True if a datagram must be read. Data of the vehicle and the ranging radio are always
        read, data of other senders up to an allowance."""
        peer = self.session.peer
        radio = self.tracker.ranging.trusted
        unknown = peer is None if link == VEHICLE else radio is None
        trusted = link == VEHICLE and peer is not None and source == peer.source
        trusted |= (
            link == self.connection.ranging_link and radio is not None and source == radio.source
        )
        return unknown or trusted or self.allowance.take(size, now)

    def _take_parameter_request(self, message: Message, now: float) -> None:
        """Answer a ground station."""
        refusal = "" if self._signed or self.settings.unsigned_parameters else UNSIGNED
        refusal = "the flight is over" if self.mission.outcome is not None else refusal
        if why := self.parameters.receive(message, self.session.us, refusal, now):
            name = why.partition(" ")[0]
            self._say(f"parameter {name}", why, severity=MAV_SEVERITY_WARNING)

    def _take_range(self, message: Message, now: float, source: Hashable) -> None:
        mission = self.mission
        stalled = self._authority.may_be_backlog(now)
        self.tracker.ranging.moving = mission.steering and self.flies
        if self.tracker.receive(message, now, source, stalled=stalled, begun=mission.begun):
            self.scheduler.received(now)

    # --- output: one step

    def step(self, now: float, send: Callable[[bytes], bool]) -> None:
        """Run a step if a fresh range is waiting or a tick is due: first send the setpoint, then
        everything else.

        send: sends frames to the vehicle and returns True on success. A setpoint that was not sent
        is not recorded, and not used to learn the vehicle's response.
        """
        if self._authority.stepped(now):
            self.tracker.fresh = False
        # In LEAVING, safe setpoints are sent at ticks only, not at ranges.
        answers = self.tracker.fresh and self.mission.phase is not Phase.LEAVING
        if self.done or not (answers or now >= self.scheduler.due):
            return
        self.tracker.fresh = False
        self.mission.started = now if self.mission.started is None else self.mission.started
        self._watch_link(now)
        self._watch_takeover(now)
        self._watch_gps(now)
        if (outcome := self.status.overdue(now)) is not None:
            self._finish(outcome, now)
        estimate = self.tracker.estimator.at(now)
        self._watch_ground(now)
        self._watch_bounds(estimate, now)
        self._watch_following(estimate, now)
        self._watch_ranging(estimate, now)
        self._watch_engagement(now)
        circle = self.controller.circle
        self.estimate = estimate
        self.tracker.estimate = estimate
        command = None
        try:
            command = self.controller.command(
                self.mission.phase, estimate, self.session.timesync.worst, now
            )
        except StuckCodeError as error:
            self._finish(Outcome(Ending.ABORTED, str(error)), now)
        message, yaw_rate = self._setpoint(command, now)
        phase = self.mission.phase
        was_sent = False
        if message is not None and (was_sent := send(self.session.encode(message))):
            self.setpoints_sent += 1
            self.second_controller.sent(message, now)
            if yaw_rate is not None:
                self.controller.commanded(yaw_rate, now)
        self.scheduler.stepped(now)
        self._take_counts(estimate, command, now)
        record = tick_record(
            now,
            phase,
            estimate,
            command,
            yaw_rate if was_sent else None,
            circle=circle,
            session=self.session,
            tracker=self.tracker,
            controller=self.controller,
            law=self.controller.law,
        )
        self.view = self._view(record, now)
        self.conditions.update(self.view)
        if rest := b"".join(map(self.session.encode, self._housekeeping(estimate, command, now))):
            send(rest)
        self._records.append(record)

    # --- changes of phase

    def _watch_link(self, now: float) -> None:
        """Change the phase when the link is established or lost."""
        # While the vehicle's identity is unconfirmed, treat the link as lost. In LEAVING, keep
        # waiting so that the exit action can still be sent.
        session = self.session
        mission = self.mission
        if not session.up:
            return
        if session.heartbeat_age(now) > LOST_AFTER:
            session.lose()
            mission.lose(now)
        elif not session.vehicle.unproven:
            mission.happened(Event.LINK_UP, now)
        elif mission.phase is not Phase.LEAVING:
            mission.lose(now)

    def _watch_takeover(self, now: float) -> None:
        """Stop sending setpoints in the same step in which a takeover is detected."""
        takeover = self._authority.watch_takeover(now)
        if self._authority.rebooted:
            self.tracker.estimator.reset()
        if takeover is None:
            return
        self.mission.lost_at = None  # the time limit of a lost link no longer applies
        self.mission.happened(Event.MODE_LEFT, now)
        self.session.drop_mode_requests()
        self.controller.disengage()
        self.tracker.ranging.sender_stays = False
        if (
            self.mission.outcome is not None
        ):  # in LEAVING, the change of mode is the exit action taking effect
            return
        what, outcome = takeover
        self._say("yield", what, severity=MAV_SEVERITY_WARNING)
        if self.settings.end_on_takeover:
            self._finish(outcome, now)

    def _watch_gps(self, now: float) -> None:
        """Continue by attitude setpoints if a steered copter has lost its GPS."""
        if not (self.flies and self.mission.steering):
            return
        if text := self.gps_loss.step(now):
            self.second_controller = SecondController(self.session, self.mission)
            self._say("gps", text, severity=MAV_SEVERITY_WARNING)

    def _watch_ground(self, now: float) -> None:
        """End the flight if a steered aircraft lands or flies too low."""
        if self.airborne.step(now):
            # On the ground and in the take-off a plane does not fly along its nose at its measured
            # airspeed. The estimator had learned an airspeed scale of 0.87 from this motion.
            self.tracker.estimator.reset()
        if self.mission.steering and self.flies and (why := self.airborne.grounded(now)):
            self._exit_action.low = True
            self._finish(Outcome(Ending.ABORTED, why), now)

    def _watch_bounds(self, estimate: RangeEstimate | None, now: float) -> None:
        """End the flight if a bound is violated while steering, or if another companion uses our
        MAVLink ids. A bound that is violated before the engagement prevents it."""
        session = self.session
        if session.doubled:
            ids = f"{session.encoder.system}/{self.settings.link.component_id}"
            reason = (
                f"another companion sends with our ids {ids}: change link.component_id on one of"
                " the two companions"
            )
            self._finish(Outcome(Ending.ABORTED, reason), now)
        broken = breach(
            self.settings.bounds,
            r=estimate.r if estimate and self.mission.phase is not Phase.COASTING else None,
            altitude=session.motion.at(now).altitude,
            battery=session.vehicle.battery(now),
        )
        self._authority.broken_bound = broken
        unchecked = unwatched(self.settings, session, now)
        if self._unchecked.update(bool(unchecked), now) and broken is None:
            broken = f"bound not checked for {self.mission.coast:g} s: {unchecked}"
        if broken is not None and self.mission.steering:
            self._finish(Outcome(Ending.ABORTED, broken), now)

    def _watch_following(self, estimate: RangeEstimate | None, now: float) -> None:
        """End the flight if the vehicle has not followed turn commands for too long, unless it
        keeps its circle. A vehicle with badly tuned steering may follow commands poorly and still
        keep its circle."""
        session = self.session
        vehicle = self.controller.vehicle
        command_following = vehicle.command_following
        most = self.settings.timing.not_following
        # A vehicle that does not receive setpoints cannot follow them. Such an outage of the uplink
        # must not end the flight: while answers to TIMESYNC are missing, do not judge the turns.
        # After the outage start the judgment again, because a plane that flies straight back to the
        # circle needs time to show that it follows.
        if session.timesync.silent(now, UNANSWERED):
            self._since_unanswered.restart(now)
        # 3.0: time, s, from the first TIMESYNC answer after an outage of the uplink until the turns
        # are judged again.
        if self._since_unanswered.age(now) < 3.0:
            vehicle.judge_again()
            self.conditions.forget(NOT_FOLLOWING)
        if self._keeps_circle(estimate):
            self._since_circling.restart(now)
        not_following = min(now - command_following.since, self._since_circling.age(now))
        if self.mission.steering and not command_following.follows and not_following > most:
            self._finish(
                Outcome(
                    Ending.ABORTED,
                    "vehicle did not follow turn commands, and did not turn along its circle for"
                    f" {most:g} s: check steering and compass",
                ),
                now,
            )

    def _keeps_circle(self, estimate: RangeEstimate | None) -> bool:
        """True if the vehicle is near its circle, and turns in the circle's direction at more than
        a third of the circle's turn rate. In wind, the turn rate varies along the circle."""
        circle = self.controller.orbit
        if estimate is None or abs(estimate.r - circle.radius) > 0.1 * circle.radius:
            return False
        turn = circle.direction.turn_sign * self.controller.vehicle.command_gain.rate
        return turn > circle.speed / circle.radius / 3

    def _watch_ranging(self, estimate: RangeEstimate | None, now: float) -> None:
        good = self.tracker.good(estimate, now, coasting=self.mission.phase is Phase.COASTING)
        if self.mission.phase is Phase.WAIT_RANGING and self.session.missing(now):
            return
        self.mission.happened(Event.RANGE_GOOD if good else Event.RANGE_LOST, now)

    def _watch_engagement(self, now: float) -> None:
        if (
            self.mission.steering
            or self.mission.phase is Phase.LEAVING
            or not self._authority.certain
        ):
            return
        # A dry run always engages. While the vehicle is steered, obstacles are not checked: a slow
        # link or a landing does not end the flight.
        engages = not self.flies or not self._authority.obstacle(now)
        if engages and self.mission.phase is Phase.YIELDED:
            self.mission.happened(Event.MODE_OURS, now)
        elif engages and self.mission.phase is Phase.READY:
            self._engage(now)
        elif (failure := self._authority.ask_for_mode(now)) is not None:
            self._finish(Outcome(Ending.ABORTED, failure), now)

    def _engage(self, now: float) -> None:
        self.mission.engage(now)
        self.tracker.ranging.sender_stays = self.flies
        self.session.identity.stays |= self.flies
        if self.flies:  # a dry run may begin on the ground, far from the mission's height
            self.tracker.height.engage()
        self.session.drop_mode_requests()
        self._say(
            "engage", f"{'engaged' if self.flies else 'dry run'}, {self.controller.circle.label}"
        )

    def _finish(self, outcome: Outcome, now: float) -> None:
        if self.mission.finish(outcome, now, ours=self._authority.may_be_ours(now)):
            self.session.drop_mode_requests()
            severity = MAV_SEVERITY_NOTICE if outcome.ending in NO_FAILURE else MAV_SEVERITY_WARNING
            self._say("end", f"ended, {outcome.reason}", severity=severity)

    # --- the setpoint

    def _setpoint(
        self, command: TurnCommand | None, now: float
    ) -> tuple[Message | None, YawRate | None]:
        """Return the setpoint message of this step, or None, and its yaw rate if it steers, or
        None."""
        allowed = self._authority.allowed(now)
        try:
            if self.mission.phase is Phase.LEAVING:
                return self._leave(allowed, now), None
            if allowed is Allowed.STEER and command is not None:
                return self.controller.setpoint(command, self.session, now)
            if allowed is Allowed.SAFE:
                return self.controller.safe_setpoint(self.session, now, engaged=False), None
        except UnsafeSetpointError as error:
            reason = f"unsafe setpoint of law {self.controller.law} not sent: {error}"
            self._finish(Outcome(Ending.ABORTED, reason), now)
        return None, None

    def _leave(self, allowed: Allowed, now: float) -> Message | None:
        """Return the safe setpoint until the exit action is confirmed or has failed, then None."""
        mission = self.mission
        exit_action = self._exit_action
        if allowed is Allowed.NOTHING:
            ours = self.flies and self._authority.may_be_ours(now)
            over = not ours or exit_action.wait_to_send(mission.since, now)
        else:
            over = exit_action.go_on(self.session, mission.since, now)
        if over:
            mission.happened(Event.SAFE_SENT, now)
        if exit_action.failure is not None and mission.outcome is not None:
            mission.outcome = replace(
                mission.outcome, reason=f"{mission.outcome.reason}; {exit_action.failure}"
            )
        return (
            None if allowed is Allowed.NOTHING else self.controller.safe_setpoint(self.session, now)
        )

    def last_frames(self, now: float) -> bytes:
        """Return the safe setpoint and a request of the exit action, to be sent after an internal
        error of `Pilot`. Return no bytes if the vehicle is not under our control."""
        if not self._authority.may_send_last_frames():
            return b""
        words = [self.controller.safe_setpoint(self.session, now)]
        if self._authority.may_request_exit(now):
            words += self._exit_action.at_once(self.session)
        return b"".join(map(self.session.encode, words))

    # --- other frames sent

    def _housekeeping(
        self, estimate: RangeEstimate | None, command: TurnCommand | None, now: float
    ) -> list[Message]:
        """Return the due heartbeat, commands, stream requests, texts and plot values. At the end of
        the mission, add the farewell."""
        plots = self.session.announcer.plots(
            plot_values(self.controller.circle, estimate, command), now
        )
        if self.settings.output_mode is OutputMode.SHADOW:
            return self.session.heartbeats_due(now) + plots
        if self.done:
            self.session.drop_mode_requests()
        plots += self.parameters.replies() + self._requests.replies()
        return self.session.poll(now) + plots + (self.session.farewell() if self.done else [])

    def hello(self, now: float) -> bytes:
        """Return the frames for a separate ranging link."""
        return b"" if self.done else self.connection.hello(now)

    def _take_counts(
        self, estimate: RangeEstimate | None, command: TurnCommand | None, now: float
    ) -> None:
        """Update the state that exists only for conditions and display."""
        tracker = self.tracker
        controller = self.controller
        steered = estimate if self.mission.steering else None
        self._drift_monitor.update(steered, controller.orbit, controller.vehicle.most)
        engaged = self.mission.phase is Phase.ENGAGED
        if self.session.adapter.measures_airspeed:
            self._airspeed_alarm = watch_airspeed(self._airspeed_alarm, estimate, controller.orbit)
        self._closing_monitor.update(estimate if engaged else None, controller.orbit)
        estimation = self.settings.tuning.estimation
        if self.gps_loss.changed_at is not None:
            estimation = self.settings.estimation_without_gps
        # Tolerance of the lap alarm: three standard deviations of the airspeed scale.
        tolerance = max(3 * estimation.scale_sigma, 0.1)
        self._lap_alarm = watch_lap(self._lap_alarm, estimate if engaged else None, tolerance)
        if command is not None and (
            command.flies or not LAWS[controller.law].flies_relative_motion
        ):
            self._law = command.flies
            self._why = command.why
        if self.session.heartbeat_age(now) > SILENT:
            self._since_silent.restart(now)
        # 3.0: time, s, after a silence until all telemetry streams are received again.
        if self._since_silent.age(now) > 3.0:
            seldom = ("attitude",) if self.session.motion.seldom(now) else ()
            self._lost_reports = (*seldom, *self.session.missing(now))
        frames = self.connection.counts[VEHICLE].frames
        counts = Rates(frames, tracker.accepted, tracker.ranging.unexplained, self.setpoints_sent)
        self._rates.take(now, counts, steering=self.mission.steering)

    def _view(self, tick: TickRecord, now: float) -> StepView:
        """Return the view of a step. tick: its record."""
        session = self.session
        tracker = self.tracker
        ranging = tracker.ranging
        height = tracker.height
        mission = self.mission
        controller = self.controller
        vehicle = session.adapter.name if session.up else "no vehicle yet"
        lateral = controller.vehicle.bank_limit.bank * (self.own.airspeed if self.own else inf)
        # uplink_silent, 2.0: time without an answer to TIMESYNC, s, after which an alarm is raised.
        # Requests are sent once a second and repeated if lost.
        return StepView(
            tick=tick,
            settings=self.settings,
            engaged_at=mission.engaged_at,
            outcome=mission.outcome,
            coast=mission.coast,
            waits=self.status.waits_for(now),
            not_airborne=self._not_airborne(now),
            exit_name=self._exit_action.named(session),
            vehicle=f"{vehicle}, firmware {session.vehicle.firmware or 'unknown'}",
            trusted=self.trusted,
            second_senders=tuple(session.identity.second_senders.recent(now)),
            second_controller=self.second_controller.evidence(now),
            flood=self.allowance.dropped / 1000 if self.allowance.flooded(now) else 0.0,
            uplink_silent=session.timesync.silent(now, 2.0),
            stalled=self._authority.stalled(now),
            clock_speed=session.clock_speed.found,
            setpoints=self.setpoints_sent,
            rejected=dict(ranging.rejected.most_common()),
            rates=None if self.done else self._rates.newest,
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
            lost_reports=self._lost_reports,
            failed_imu=session.motion.accelerations.failed,
            used_imu=session.motion.accelerations.used,
            heading_jump=session.motion.jumped,
            height_held=height.is_held(now),
            altitude_jump=height.jump,
            implausible_airspeed=self._path.implausible_airspeed,
            unchecked_bound=unwatched(self.settings, session, now),
            gps_lost=None if self.gps_loss.changed_at is None else self.gps_loss.failure,
            drift_alarm=self._drift_monitor.alarm,
            airspeed_alarm=self._airspeed_alarm,
            closing_alarm=self._closing_monitor.alarm,
            lap_alarm=self._lap_alarm,
            circle=controller.circle,
            law=self._law,
            why=self._why,
            follows=controller.vehicle.command_following.follows,
            speed=controller.speed,
            lean_share=controller.vehicle.lean_limit.share,
            lean_limit=atan(controller.vehicle.lean_limit.found / GRAVITY),
            bank_limit=atan(lateral / GRAVITY) if lateral < inf else None,
        )

    # --- state for display and recording

    def _not_airborne(self, now: float) -> str:
        """Return the condition that the flight of an armed vehicle does not meet yet, or an empty
        string."""
        waits = self.mission.phase in (Phase.READY, Phase.YIELDED) and self.flies
        if not (waits and self.session.vehicle.armed):
            return ""
        obstacle = self.airborne.obstacle(now)
        return "" if obstacle is None else obstacle.short

    @property
    def done(self) -> bool:
        """True if the mission is over and nothing more will be sent."""
        return self.mission.phase is Phase.ENDED

    @property
    def orbit(self) -> Orbit:
        """The circle flown now, including the spacing in a fleet."""
        return self.controller.orbit

    def height(self, now: float) -> float | None:
        """Return the height above the target, m, or None if it is unknown."""
        return self.tracker.height.at(now)

    @property
    def own(self) -> OwnMotion | None:
        """Newest motion through the air, or None before an attitude was received."""
        return self._path.own

    @property
    def trusted(self) -> str:
        """Trusted senders (vehicle and radio) with their addresses, human-readable, or an empty
        string."""
        peer = self.session.peer
        radio = self.tracker.ranging.trusted
        if peer is None or radio is None:
            return str(peer or "")
        apart = radio.source != peer.source
        return f"{peer}, ranges of {radio if apart else f'{radio.system}/{radio.component}'}"

    def frames_refused(self) -> Counter[str]:
        """Return the number of frames rejected on all links, by the fault of their signature."""
        return sum((counts.refused for counts in self.connection.counts.values()), Counter())

    def take_records(self) -> list[TickRecord]:
        """Return the records of the steps since the last call."""
        records = self._records
        self._records = []
        return records

    def take_frames(self) -> list[bytes]:
        """Return the complete frames received on all links since the last call."""
        frames = self._frames
        self._frames = []
        return frames
