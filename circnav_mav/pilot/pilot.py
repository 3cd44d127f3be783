"""The complete application as one object without I/O: bytes and time in, bytes out.

    pilot.receive(data, now); pilot.step(now, send)

A fresh range causes a step that steers by this range. Between ranges, a step at each tick steers by
a prediction. While ranges are missing, the circle's turn rate is commanded. After a time limit
(`limits.coast_s`) the flight ends. The operator always has priority: see `authority`.
"""

from collections import Counter
from collections.abc import Callable, Hashable
from dataclasses import replace

from pymavlink.dialects.v20.all import MAV_SEVERITY_NOTICE, MAV_SEVERITY_WARNING

from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.guidance.own_code import StuckCodeError
from circnav_mav.guidance.types import Orbit, OwnMotion, RangeEstimate, TurnCommand
from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import YawRate
from circnav_mav.mav.session import Session
from circnav_mav.mav.setpoint_guard import UnsafeSetpointError
from circnav_mav.mav.signing import Signing
from circnav_mav.mission.mission import VEHICLE, Mission
from circnav_mav.pilot.air_path import AirPath
from circnav_mav.pilot.airborne import Airborne
from circnav_mav.pilot.authority import Allowed, Authority
from circnav_mav.pilot.conditions import Conditions
from circnav_mav.pilot.connection import Connection
from circnav_mav.pilot.controller import Controller
from circnav_mav.pilot.ground_station import READS, GroundStation
from circnav_mav.pilot.method import READS as METHOD_READS
from circnav_mav.pilot.method import MethodMonitor
from circnav_mav.pilot.mission_state import (
    NO_FAILURE,
    Ending,
    Event,
    MissionState,
    Outcome,
    OutputMode,
    Phase,
)
from circnav_mav.pilot.mode_request import ExitAction
from circnav_mav.pilot.monitors import monitors_of
from circnav_mav.pilot.observer import Observer
from circnav_mav.pilot.parameters import flight_parameters
from circnav_mav.pilot.range_tracker import RangeTracker
from circnav_mav.pilot.record import TickRecord, plot_values
from circnav_mav.pilot.second_controller import SecondController
from circnav_mav.pilot.step_view import StepView
from circnav_mav.pilot.tick_scheduler import TickScheduler


class Pilot:
    """The guidance application: ranging and vehicle telemetry in, setpoints out."""

    def __init__(
        self,
        settings: Mission,
        signing: Signing | None = None,
        output_mode: OutputMode = OutputMode.FLY,
    ) -> None:
        """signing: signs sent frames and authenticates received ones, or None."""
        self.settings = settings
        self.output_mode = output_mode
        self.connection = Connection(settings, signing, also=METHOD_READS)
        session = self.connection.session
        tracker = RangeTracker(settings, session)
        self.tracker = tracker
        self.controller = Controller(settings)
        self.mission = MissionState(settings.file.limits.coast_s)
        self.airborne = Airborne(settings, session)
        self.authority = Authority(settings, session, self.mission, self.airborne, flies=self.flies)
        self.exit_action = ExitAction(settings.file.exit.action)
        signed = signing is not None and VEHICLE not in settings.unsigned_links
        self.ground_station = GroundStation(
            flight_parameters(self.controller, tracker, self.exit_action, session, self.mission),
            session,
            self.mission,
            may_set=signed or settings.file.link.unsigned_parameters,
        )
        self.scheduler = TickScheduler(settings.file.limits.tick)
        self.second_controller = SecondController(session, self.mission)
        self.path = AirPath(session, tracker, self.controller, self.mission, flies=self.flies)
        self.method = MethodMonitor()
        self.conditions = Conditions(session.announcer)
        self.observer = Observer()
        listeners = (self.path, self.method, self.second_controller)
        self._listeners = {
            kind: [one.receive for one in listeners if kind in one.reads]
            for kind in frozenset().union(*(one.reads for one in listeners))
        }
        """Receivers of the vehicle's messages, by message type."""
        self._monitors = monitors_of(self.method)

    # --- input: received messages

    def receive(
        self, data: bytes, now: float, source: Hashable = None, link: str = VEHICLE
    ) -> None:
        """Process a datagram (or chunk of a stream) that arrived at `now` from `source` on a
        link."""
        radio = self.tracker.ranging.trusted
        if not self.connection.admits(len(data), now, source, link, radio):
            return
        if self.authority.may_be_backlog(now):
            # The vehicle flew on without commands, and its reports waited for this computer. These
            # reports show neither the delay of the link nor the response to commands.
            self.session.timesync.forget_requests()
            self.controller.vehicle.reset()
        for message, of_vehicle, of_ranging in self.connection.receive(data, now, source, link):
            if of_vehicle:
                for receive in self._listeners.get(message.get_type(), ()):
                    receive(message, now)
            # Answers are sent to the vehicle's address. So answer only requests that arrived from
            # this address.
            behind = link == VEHICLE and source == self.session.reply_to
            if behind and message.get_msgId() in READS:
                self.ground_station.receive(message, now, of_vehicle=of_vehicle)
            if of_ranging:
                self._take_range(message, now, source)

    def interrupt(self, now: float, reason: str) -> None:
        """End the flight now: the next step sends the safe setpoint."""
        self._finish(Outcome(Ending.INTERRUPTED, reason), now)
        self.scheduler.at_once()

    def request_circle(self, request: CircleRequest, now: float) -> str:
        """Fly another circle, if the vehicle can fly it and the limits of circle changes permit it.
        Return the reason for a refusal, else an empty string."""
        why = self.controller.change_circle(request, now)
        self.ground_station.report_circle(request, why)
        return why

    def abandon(self, reason: str) -> None:
        """End the flight as aborted because of an internal error, even if the mission already has
        another outcome."""
        self.mission.outcome = Outcome(Ending.ABORTED, reason)

    def _take_range(self, message: Message, now: float, source: Hashable) -> None:
        mission = self.mission
        stalled = self.authority.may_be_backlog(now)
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
        if self.authority.stepped(now):
            self.tracker.fresh = False
        # In LEAVING, safe setpoints are sent at ticks only, not at ranges.
        answers = self.tracker.fresh and self.mission.phase is not Phase.LEAVING
        if self.done or not (answers or now >= self.scheduler.due):
            return
        self.tracker.fresh = False
        self.mission.started = now if self.mission.started is None else self.mission.started
        for monitor in self._monitors:
            for found in monitor(self, now):
                self._apply(found, now)
        circle = self.controller.circle
        command = self._command(now)
        sent = self._steer(command, send, now)
        self.scheduler.stepped(now)
        self.conditions.update(self.observer.step(self, circle, command, sent, now))
        if rest := b"".join(map(self.session.encode, self._housekeeping(command, now))):
            send(rest)

    # --- changes of phase

    def _apply(self, found: Event | Outcome, now: float) -> None:
        """Apply a finding of a monitor."""
        if isinstance(found, Event):
            self.mission.happened(found, now)
        else:
            self._finish(found, now)

    def _finish(self, outcome: Outcome, now: float) -> None:
        if self.mission.finish(outcome, now, ours=self.authority.may_be_ours(now)):
            self.session.drop_mode_requests()
            severity = MAV_SEVERITY_NOTICE if outcome.ending in NO_FAILURE else MAV_SEVERITY_WARNING
            self.session.announcer.say("end", f"ended, {outcome.reason}", severity=severity)

    # --- the setpoint

    def _command(self, now: float) -> TurnCommand | None:
        """Return the turn command of this step, or None."""
        phase = self.mission.phase
        round_trip = self.session.timesync.worst
        try:
            return self.controller.command(phase, self.tracker.estimate, round_trip, now)
        except StuckCodeError as error:
            self._finish(Outcome(Ending.ABORTED, str(error)), now)
            return None

    def _steer(
        self, command: TurnCommand | None, send: Callable[[bytes], bool], now: float
    ) -> YawRate | None:
        """Send the setpoint of this step, if one may be sent. Return the yaw rate that was sent."""
        message, yaw_rate = self._setpoint(command, now)
        if message is None or not send(self.session.encode(message)):
            return None
        self.observer.setpoints_sent += 1
        self.second_controller.sent(message, now)
        if yaw_rate is not None:
            self.controller.commanded(yaw_rate, now)
        return yaw_rate

    def _setpoint(
        self, command: TurnCommand | None, now: float
    ) -> tuple[Message | None, YawRate | None]:
        """Return the setpoint message of this step, or None, and its yaw rate if it steers, or
        None."""
        allowed = self.authority.allowed(now)
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
        exit_action = self.exit_action
        if allowed is Allowed.NOTHING:
            ours = self.flies and self.authority.may_be_ours(now)
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
        if not self.authority.may_send_last_frames():
            return b""
        words = [self.controller.safe_setpoint(self.session, now)]
        if self.authority.may_request_exit(now):
            words += self.exit_action.at_once(self.session)
        return b"".join(map(self.session.encode, words))

    # --- other frames sent

    def _housekeeping(self, command: TurnCommand | None, now: float) -> list[Message]:
        """Return the due heartbeat, commands, stream requests, texts and plot values. At the end of
        the mission, add the farewell."""
        plots = self.session.announcer.plots(
            plot_values(self.controller.circle, self.tracker.estimate, command), now
        )
        if self.output_mode is OutputMode.SHADOW:
            return self.session.heartbeats_due(now) + plots
        if self.done:
            self.session.drop_mode_requests()
        plots += self.ground_station.replies()
        return self.session.poll(now) + plots + (self.session.farewell() if self.done else [])

    def hello(self, now: float) -> bytes:
        """Return the frames for a separate ranging link."""
        return b"" if self.done else self.connection.hello(now)

    # --- state for display and recording

    @property
    def session(self) -> Session:
        """Session with the vehicle."""
        return self.connection.session

    @property
    def flies(self) -> bool:
        """True if setpoints are sent."""
        return self.output_mode is OutputMode.FLY

    @property
    def view(self) -> StepView | None:
        """Newest step, None before the first step."""
        return self.observer.view

    @property
    def estimate(self) -> RangeEstimate | None:
        """Estimate used by the newest step."""
        return self.tracker.estimate

    @property
    def setpoints_sent(self) -> int:
        """Number of sent setpoints."""
        return self.observer.setpoints_sent

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
        return self.path.own

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
        records = self.observer.records
        self.observer.records = []
        return records

    def take_frames(self) -> list[bytes]:
        """Return the complete frames received on all links since the last call."""
        return self.connection.take_frames()
