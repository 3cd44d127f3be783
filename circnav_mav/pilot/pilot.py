"""The whole application as one object without I/O: bytes and the time in, bytes out.

    pilot.receive(data, now); link.send(pilot.step(now))

A fresh range is answered by the very next step. A tick after it the prediction steers, for a short time; without more
ranges the orbit's own turn rate is held, then given up. The operator always wins: see `authority`.
"""

from collections import Counter
from collections.abc import Hashable
from dataclasses import replace
from math import atan, degrees

from pymavlink.dialects.v20.all import MAV_SEVERITY_NOTICE, MAV_SEVERITY_WARNING

from circnav_mav.guidance.circle_change import CircleRequest
from circnav_mav.guidance.side_slip import SideSlip
from circnav_mav.guidance.types import Orbit, OwnMotion, RangeEstimate, TurnCommand
from circnav_mav.guidance.velocity_loop import CopterMotion
from circnav_mav.guidance.watches import DriftAlarm, breach, watch_drift
from circnav_mav.mav.autopilots.interface import turn_in
from circnav_mav.mav.codec import Message
from circnav_mav.mav.frames import GRAVITY, YawRate
from circnav_mav.mav.identity import Allowance
from circnav_mav.mav.session import LOST_AFTER
from circnav_mav.mav.setpoint_guard import UnsafeSetpointError
from circnav_mav.mav.signing import Signing
from circnav_mav.pilot.authority import SILENT, TAKEN_OVER, Allowed, Authority, unwatched
from circnav_mav.pilot.connection import Connection
from circnav_mav.pilot.controller import Controller
from circnav_mav.pilot.echo_watch import EchoWatch
from circnav_mav.pilot.mission_state import Ending, Event, MissionState, Outcome, Phase
from circnav_mav.pilot.mode_request import ExitAction
from circnav_mav.pilot.range_tracker import HEARD, RangeTracker, TickScheduler
from circnav_mav.pilot.record import StepTaken, TickRecord, plot_values, tick_record
from circnav_mav.pilot.settings import VEHICLE, OutputMode, PilotSettings
from circnav_mav.pilot.status_text import StatusText

ALARMS = frozenset(
    (
        *("drift", "cycle", "follows", "lean limit", "range trouble", "range rate trouble"),
        *("sensor clock", "clock speed", "height", "bounds", "link", "flood", "second controller"),
    )
)
"""Kinds of news that are said as a warning while they are so; charts mark every warning."""
FOLLOWS_NOT, FOLLOWS_AGAIN = "vehicle does not follow turn commands", "vehicle follows turn commands again"
UPLINK_SILENT = 3.0
"""Time without an answer to TIMESYNC, s, after which the vehicle may have received no setpoint, and flies its own."""
RECEIVES_AFTER = 3.0
"""Time, s, after the first answer in which a vehicle that was not reached gets back to what it is commanded."""
FLOODED = 3.0
"""Time, s, since something was last left unread, after which a flood is over."""


class Pilot:
    """The guidance application: ranging and vehicle telemetry in, setpoints out."""

    def __init__(self, settings: PilotSettings, signing: Signing | None = None) -> None:
        """signing: signs what is sent and tells who is believed; None: neither."""
        self.settings = settings
        self._flies = settings.output_mode is OutputMode.FLY
        self.connection = Connection(settings, signing)
        self.session = session = self.connection.session
        self._say = session.announcer.say
        self._said: dict[str, Hashable] = {"circle": id(settings.orbit)}
        """What was said last of each kind of news. The circle by its identity: the same radius may come twice."""
        self.tracker = RangeTracker(settings, session, self._say_news)
        self.controller = Controller(settings)
        self.mission = MissionState()
        self._authority = Authority(settings, session, self.mission)
        self._exit_action = ExitAction(settings.exit)
        self.scheduler = TickScheduler(settings.timing.tick)
        self.status = StatusText(settings, self.connection, self.mission, self._authority, self.tracker)
        self.why = ""
        """Why the law flies that flies, for people."""
        self.drift_alarm = DriftAlarm()
        self.unwatched = ""
        """What a bound goes by and the vehicle does not report, for people."""
        self.allowance = Allowance()
        self._echo = EchoWatch()
        self._rivals: set[str] = set()
        self._unanswered_at = float("-inf")
        """When the vehicle last seemed not to receive us, s."""
        self.setpoints_sent = 0
        self._records: list[TickRecord] = []
        self._taken: StepTaken | None = None
        """The newest step, until all is said that follows it."""
        self._frames: list[bytes] = []
        self._copter_motion, self._side_slip = CopterMotion(), SideSlip()
        self.own: OwnMotion | None = None
        """The newest motion through the air, as the estimators have it; None before an attitude was heard."""
        self.estimate: RangeEstimate | None = None
        """The estimate that the newest step steered by."""

    # --- in: every message that arrives -----------------------------------------------------------------------------

    def receive(self, data: bytes, now: float, source: Hashable = None, link: str = VEHICLE) -> None:
        """Take in one datagram (or chunk of a stream) that arrived at `now` from `source` on a link."""
        if not self._worth_reading(source, len(data), now, link):
            return
        for message, of_vehicle, of_ranging in self.connection.receive(data, now, source, link):
            if of_vehicle:
                self._take_motion(message, now)
                self._take_echo(message, now)
            if of_ranging:
                self._take_range(message, now, source)
        self._frames += self.connection.decoders[link].frames

    def interrupt(self, now: float, reason: str) -> None:
        """End the flight now: the next step sends the safe setpoint."""
        self._finish(Outcome(Ending.INTERRUPTED, reason), now)
        self.scheduler.at_once()

    def request_circle(self, request: CircleRequest, now: float) -> str:
        """Fly another circle, if vehicle, bounds and rate of change allow it. Return why not, empty if it is flown."""
        why = self.controller.change_circle(request, now)
        # Spacing is asked for twice a second: a refusal is said once, not each time.
        if why and request.offset is None:
            self._say("circle refused", why, severity=MAV_SEVERITY_WARNING)
        elif request.offset is not None:
            self._say_news("spacing refused", bool(why), why or "spacing accepted again")
        return why

    def abandon(self, reason: str) -> None:
        """An error of ours has ended the flight, whatever it had come to."""
        self.mission.outcome = Outcome(Ending.ABORTED, reason)

    def _worth_reading(self, source: Hashable, size: int, now: float, link: str) -> bool:
        """Whether a datagram is read: all of the vehicle and of the ranging radio, of others within an allowance."""
        peer, radio = self.session.peer, self.tracker.ranging.trusted
        unknown = peer is None if link == VEHICLE else radio is None
        trusted = link == VEHICLE and peer is not None and source == peer.source
        trusted |= link == self.connection.ranging_link and radio is not None and source == radio.source
        return unknown or trusted or self.allowance.take(size, now)

    def _take_range(self, message: Message, now: float, source: Hashable) -> None:
        mission, stalled = self.mission, self._authority.may_be_backlog(now)
        self.tracker.ranging.moving = mission.steering and self._flies
        if self.tracker.receive(message, now, source, stalled=stalled, begun=mission.begun):
            self.scheduler.heard(now)

    def _take_echo(self, message: Message, now: float) -> None:
        """Compare the setpoint that the vehicle reports with ours. While it answers no TIMESYNC it may not receive us,
        and flies a setpoint of its own."""
        adapter, timesync = self.session.adapter, self.session.timesync
        if message.get_msgId() == adapter.echo and not timesync.silent(now, UPLINK_SILENT):
            self._echo.reported(turn_in(message), now, timesync.worst or 0.0, limited=adapter.banks)

    def _take_motion(self, message: Message, now: float) -> None:
        """Own motion teaches the height, the turn-rate gain, and estimators that know where the vehicle is heading."""
        adapter, motion, height = self.session.adapter, self.session.motion, self.tracker.height
        is_attitude = motion.receive(message, now)
        if message.get_type() in HEARD:
            height.hear(message, motion.at(now).altitude, now)
        if not is_attitude:
            return
        own = nose = motion.own(now, self._airspeed(now), banks=adapter.measures_airspeed)
        if own is None or nose is None:
            return
        if not adapter.flies:  # its tilt is the ground's, and pushes nothing
            own = own._replace(push=None)
        if adapter.velocity_loop is not None and self.mission.steering:
            self._copter_motion, own = self._copter_motion.follow(own, adapter.velocity_loop)
            self.controller.drag = self._copter_motion.drag
        else:
            self._copter_motion = self._copter_motion.stand()
            self._side_slip, own = self._side_slip.follow(own)
        self.own = own
        self.controller.on_motion(own, nose)
        # a vehicle whose airspeed nobody measures has the commanded one while it flies as commanded; whose setpoints
        # are another's (a dry run) is taken to do so while it turns as we would command
        follows = self.controller.at_speed if self._flies else self.controller.followed
        if adapter.measures_airspeed or (self.mission.steering and follows):
            self.tracker.estimator.move(own)

    def _airspeed(self, now: float) -> float:
        """True; as measured, where that can be; else the commanded speed, which the vehicle has while it is ours."""
        adapter, motion = self.session.adapter, self.session.motion.at(now)
        measured = motion.airspeed if adapter.measures_airspeed else None
        believed = adapter.airspeed(measured)
        # on the ground it is no wonder
        if measured is not None and measured != believed and self.mission.steering:
            self._say_news("airspeed", True, f"airspeed {measured:.1f} m/s implausible, ignored")
        return motion.true_airspeed(believed) if adapter.measures_airspeed else self.controller.speed

    # --- out: one step ----------------------------------------------------------------------------------------------

    def step(self, now: float) -> bytes:
        """Decide and speak: `answer` and `follow_up` in one."""
        return self.answer(now) + self.follow_up(now)

    def answer(self, now: float) -> bytes:
        """The setpoint of this step, if any. Acts when a fresh range is waiting or a tick is due; else returns nothing
        at once."""
        if self._authority.stepped(now):
            self.tracker.fresh = False
        if not self._due(now):
            return b""
        self.tracker.fresh = False
        self.mission.step(now)
        self._watch_link(now)
        self._watch_takeover(now)
        if (outcome := self.status.overdue(now)) is not None:
            self._finish(outcome, now)
        estimate = self.tracker.estimator.at(now)
        self._watch_bounds(estimate, now)
        self._watch_following(now)
        self._watch_ranging(estimate, now)
        self._watch_engagement(now)
        desired, self.estimate = self.controller.circle.radius, estimate
        command = self.controller.command(self.mission.phase, estimate, self.session.timesync.worst, now)
        message, sent = self._setpoint(command, now)
        if message is not None and (turn := turn_in(message)) is not None:
            self._echo.sent(turn, now)
        self._taken = StepTaken(now, self.mission.phase, estimate, command, message is not None, sent, desired)
        return b"" if message is None else self.session.encode(message)

    def follow_up(self, now: float) -> bytes:
        """All else that the step of `answer` has to say, once its setpoint is on its way; nothing if it did not act."""
        if self._taken is None:
            return b""
        step, self._taken = self._taken, None
        self.setpoints_sent += step.spoke
        self.scheduler.stepped(now)
        if step.sent is not None:
            self.controller.commanded(step.sent, now)
        self._say_what_is_new(step.estimate, step.command, now)
        said = b"".join(map(self.session.encode, self._housekeeping(step.estimate, step.command, now)))
        record = tick_record(step, self.session, self.tracker, self.controller, self.settings.law.name)
        self._records.append(record)
        return said

    def _due(self, now: float) -> bool:
        """Whether this step acts. The safe setpoints of the end are a tick apart, however many ranges come."""
        answers = self.tracker.fresh and self.mission.phase is not Phase.LEAVING
        return not self.done and (answers or now >= self.scheduler.due)

    # --- what moves the phases

    def _watch_link(self, now: float) -> None:
        """A vehicle that is not proven to be the one of before counts as lost; last words wait for it a while."""
        session, mission = self.session, self.mission
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
        """The operator's word ends the stream in this very step."""
        takeover = self._authority.watch_takeover()
        if self._authority.rebooted:
            self.tracker.estimator.reset()
        if takeover is None:
            return
        self.mission.yield_to_operator(now)
        self.session.drop_mode_requests()
        self.controller.disengage()
        self.tracker.ranging.sender_stays = False
        if self.mission.outcome is not None:  # we were leaving: this is the exit action taking effect
            return
        what, reason = takeover
        self._say("yield", what, severity=MAV_SEVERITY_WARNING)
        if self.settings.end_on_takeover:
            self._finish(Outcome(Ending.ABORTED, reason), now)

    def _watch_bounds(self, estimate: RangeEstimate | None, now: float) -> None:
        """The mission's own limits while we steer, and another companion of our ids at any time."""
        session = self.session
        if session.doubled:
            ids = f"{session.encoder.system}/{self.settings.link.component_id}"
            reason = f"another companion sends as {ids}: give one of us another component_id"
            self._finish(Outcome(Ending.ABORTED, reason), now)
        if not self.mission.steering:
            return
        broken = breach(
            self.settings.bounds,
            r=estimate.r if estimate and self.mission.phase is Phase.ENGAGED else None,
            altitude=session.motion.at(now).altitude,
            battery=session.vehicle.battery(now),
        )
        if broken is not None:
            self._finish(Outcome(Ending.ABORTED, broken), now)

    def _watch_following(self, now: float) -> None:
        """End the flight of a vehicle that does not follow turn commands for too long."""
        session, turns, most = self.session, self.controller.turns, self.settings.timing.unfollowed
        # A vehicle that does not receive us cannot follow, and goes on by its own time-out: that is an outage of the
        # link, which the flight survives. Without answers to TIMESYNC nothing is judged, and all begins anew after it:
        # a plane that flies straight back from where it was carried would show for long that it follows again.
        if not session.timesync.answered(now):
            self._unanswered_at = now
        if now - self._unanswered_at < RECEIVES_AFTER:
            turns.reset()
            self._said["follows"] = False
        if self.mission.steering and not turns.follows and now - turns.since > most:
            self._finish(Outcome(Ending.ABORTED, f"vehicle did not follow turn commands for {most:g} s"), now)

    def _watch_ranging(self, estimate: RangeEstimate | None, now: float) -> None:
        good = self.tracker.good(estimate, now, holding=self.mission.phase is Phase.HOLDING)
        if self.mission.phase is Phase.WAIT_RANGING and self.session.missing(now):
            return
        steering = self.mission.steering
        if self.mission.happened(Event.RANGE_GOOD if good else Event.RANGE_LOST, now) and steering:
            severity = MAV_SEVERITY_NOTICE if good else MAV_SEVERITY_WARNING
            self._say("range", "range regained" if good else "range lost, holding", severity=severity)

    def _watch_engagement(self, now: float) -> None:
        if self.mission.steering or self.mission.phase is Phase.LEAVING or not self._authority.certain:
            return
        engages = self._authority.may_engage(now)
        if engages and self.mission.phase is Phase.YIELDED:
            self.mission.happened(Event.MODE_OURS, now)
        elif engages and self.mission.phase is Phase.READY:
            self._engage(now)
        elif (failure := self._authority.ask_for_mode(now)) is not None:
            self._finish(Outcome(Ending.ABORTED, failure), now)

    def _engage(self, now: float) -> None:
        self.mission.engage(now)
        self.tracker.ranging.sender_stays = self._flies
        self.session.identity.stays |= self._flies
        if self._flies:  # a dry run may begin on the ground, far from the height that is told
            self.tracker.height.engage()
        self.session.drop_mode_requests()
        self._say("engage", f"{'engaged' if self._flies else 'dry run'}, {_circle(self.controller.circle)}")

    def _finish(self, outcome: Outcome, now: float) -> None:
        if self.mission.finish(outcome, now, ours=self._authority.may_be_ours(now)):
            self.session.drop_mode_requests()
            told = outcome.ending is Ending.COMPLETED or outcome.reason.startswith(TAKEN_OVER)
            severity = MAV_SEVERITY_NOTICE if told else MAV_SEVERITY_WARNING
            self._say("end", f"ended, {outcome.reason}", severity=severity)

    # --- the setpoint

    def _setpoint(self, command: TurnCommand | None, now: float) -> tuple[Message | None, YawRate | None]:
        """The setpoint message of this step, if any, and the yaw rate in it where it steers."""
        allowed = self._authority.allowed(now)
        try:
            if self.mission.phase is Phase.LEAVING:
                return self._leave(allowed, now), None
            if allowed is Allowed.STEER and command is not None:
                return self.controller.setpoint(command, self.session, now)
            if allowed is Allowed.SAFE:
                return self.controller.safe_setpoint(self.session, now, engaged=False), None
        except UnsafeSetpointError as error:
            reason = f"internal error, unsafe setpoint held back: {error}"
            self._finish(Outcome(Ending.ABORTED, reason), now)
        return None, None

    def _leave(self, allowed: Allowed, now: float) -> Message | None:
        """The safe setpoint until the exit action shows in the vehicle's mode, or some times over; then silence."""
        mission, exit_action = self.mission, self._exit_action
        if allowed is Allowed.NOTHING:
            ours = self._flies and self._authority.may_be_ours(now)
            over = not ours or exit_action.wait_to_speak(mission.since, now)
        else:
            over = exit_action.go_on(self.session, mission.since, now)
        if over:
            mission.happened(Event.SAFE_SENT, now)
        if exit_action.failure is not None and mission.outcome is not None:
            mission.outcome = replace(mission.outcome, reason=f"{mission.outcome.reason}; {exit_action.failure}")
        return None if allowed is Allowed.NOTHING else self.controller.safe_setpoint(self.session, now)

    def hold_back(self) -> None:
        """The newest setpoint was not sent: the shell had stood still for too long."""
        self._taken = self._taken and self._taken._replace(spoke=False, sent=None)

    def last_words(self, now: float) -> bytes:
        """The safe setpoint, and the exit action asked for once, for the shell to send when the pilot itself has
        failed; empty if not ours to fly."""
        if not self._authority.may_say_last_words():
            return b""
        words = [self.controller.safe_setpoint(self.session, now)]
        if self._authority.may_ask_for_exit(now):
            words += self._exit_action.at_once(self.session)
        return b"".join(map(self.session.encode, words))

    # --- everything else that is sent

    def _housekeeping(self, estimate: RangeEstimate | None, command: TurnCommand | None, now: float) -> list[Message]:
        """Heartbeat, commands, streams, texts and plot values; the farewell at the end."""
        plots = self.session.announcer.plots(plot_values(self.controller.circle, estimate, command), now)
        if self.settings.output_mode is OutputMode.SHADOW:
            return self.session.heartbeats_due(now) + plots
        if self.done:
            self.session.drop_mode_requests()
        return self.session.poll(now) + plots + (self.session.farewell() if self.done else [])

    def hello(self, now: float) -> bytes:
        """What goes out on a separate ranging link."""
        return b"" if self.done else self.connection.hello(now)

    def _say_what_is_new(self, estimate: RangeEstimate | None, command: TurnCommand | None, now: float) -> None:
        """Say once each time it begins: that somebody else uses the vehicle's name, ours or the radio's; that the drift
        is more than the circle allows (and that it no longer is); the next circle; another law, and why; that the gains
        were lowered, for the command swings; and how far the vehicle banks, where that is less than commanded."""
        controller = self.controller
        rivals = {line.partition(" has ")[0] for line in self.session.identity.rivals.recent(now)}
        for name in sorted(rivals - self._rivals):
            self._say(f"rival of {name}", f"{name}: second sender rejected", severity=MAV_SEVERITY_WARNING)
        self._rivals = rivals
        self.drift_alarm = alarm = watch_drift(self.drift_alarm, estimate, controller.orbit, controller.most_turn)
        self._say_news("drift", alarm.on, alarm.text)
        self._say_news("circle", id(controller.circle), f"next circle, {_circle(controller.circle)}")
        if command is not None and command.flies:
            self.why = command.why
            if self._flies:
                self._say_news("law", command.flies, command.why)
        cut = f"limit cycle, gains reduced to {100 * controller.turns.share:.0f} %"
        self._say_news("cycle", controller.turns.cycles, cut)
        limit, own = controller.bank_limit, self.own
        if limit is not None and own is not None:
            bank = degrees(atan(limit * own.airspeed / GRAVITY))
            self._say_news("bank limit", True, f"vehicle banks {bank:.0f} deg at most")
        if (lean := controller.lean).share < 1:
            angle = degrees(atan(lean.found / GRAVITY))
            self._say_news("lean limit", lean.share, f"leans {angle:.0f} deg at most, speed {controller.speed:.1f} m/s")
        follows = controller.turns.follows
        self._say_news("follows", not follows, FOLLOWS_AGAIN if follows else FOLLOWS_NOT)
        self._say_trouble(now)

    def _say_trouble(self, now: float) -> None:
        """Say what is wrong with what is heard, and that it no longer is."""
        if self.session.up:
            silent = self.session.heartbeat_age(now) > SILENT
            self._say_news("link", silent, "vehicle silent" if silent else "vehicle heard again")
        stepped = self.tracker.ranging.clock.doubted
        self._say_news("sensor clock", stepped, f"sensor clock {'stepped' if stepped else 'runs steadily again'}")
        speed = self.session.clock_speed.found or 1.0
        self._say_news("clock speed", speed != 1.0, f"autopilot clock runs {speed:.2g} times as fast as ours")
        height = self.tracker.height.trouble(now).partition(":")[0].lower()
        self._say_news("height", height or False, height or "altitude counts again")
        flooded = now - self.allowance.dropped_at < FLOODED
        if self.mission.steering and self.session.up:
            self.unwatched = lost = unwatched(self.settings, self.session, now)
            self._say_news("bounds", lost or False, lost.partition(":")[0] or "bounds watched again")
        second = bool(self.second_controller(now))
        self._say_news(
            "second controller", second, "another program steers, too" if second else "another program no longer steers"
        )
        self._say_news("flood", flooded, "flood, others are not read" if flooded else "flood over")

    def _say_news(self, kind: str, news: Hashable, text: str) -> None:
        """Say what has changed since it was said last, or is so for the first time."""
        if news != self._said.get(kind, False):
            self._said[kind] = news
            alarming = bool(news) and kind in ALARMS
            self._say(kind, text, severity=MAV_SEVERITY_WARNING if alarming else MAV_SEVERITY_NOTICE)

    # --- what is known of it ----------------------------------------------------------------------------------------

    @property
    def done(self) -> bool:
        """Whether the mission is over and nothing more will be sent."""
        return self.mission.phase is Phase.ENDED

    @property
    def believed(self) -> str:
        """Who is believed to be the vehicle and its radio, and from where, for people; empty while nobody is."""
        peer, radio = self.session.peer, self.tracker.ranging.trusted
        if peer is None or radio is None:
            return str(peer or "")
        apart = radio.source != peer.source
        return f"{peer}, ranges of {radio if apart else f'{radio.system}/{radio.component}'}"

    def second_controller(self, now: float) -> str:
        """Return how it shows that another program steers the vehicle, human-readable; empty if nothing shows it."""
        if self.session.commands.answered_unasked(now):
            return "the vehicle answers commands in our name that we did not send"
        if not self.mission.steering or (turns := self._echo.other(now)) is None:
            return ""
        unit = "deg of bank" if self.session.adapter.banks else "deg/s"
        reported, sent = turns
        flown = "another kind of setpoint" if reported is None else f"{degrees(reported):+.0f} {unit}"
        return f"the vehicle flies {flown}, commanded {degrees(sent):+.0f} {unit}"

    def frames_refused(self) -> Counter[str]:
        """Frames that were not believed on any link, by what was wrong with their signature."""
        return sum((counts.refused for counts in self.connection.counts.values()), Counter())

    def take_records(self) -> list[TickRecord]:
        """Return the ticks since the last call."""
        records, self._records = self._records, []
        return records

    def take_frames(self) -> list[bytes]:
        """The whole frames that came in since the last call, on any link."""
        frames, self._frames = self._frames, []
        return frames


def _circle(orbit: Orbit) -> str:
    """Short enough for a STATUSTEXT."""
    return f"{orbit.radius:g} m {orbit.direction.value}"
