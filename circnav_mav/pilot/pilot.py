"""The whole application as one object without I/O: bytes and the time in, bytes out.

    pilot.receive(data, now); link.send(pilot.step(now))

A fresh range is answered by the very next step. A tick after it the prediction steers, for a short time; without more
ranges the orbit's own turn rate is held, then given up. The operator always wins: see `_watch_takeover`.
"""

from collections import Counter
from collections.abc import Hashable

from circnav_mav.core.bounds import breach
from circnav_mav.core.estimators.interface import Fused
from circnav_mav.core.estimators.table import ESTIMATORS
from circnav_mav.core.noise_check import NoiseCheck
from circnav_mav.core.phases import STEERING, Event, Phase, advance
from circnav_mav.core.values import SAME_TIME, RangeEstimate, RangeSample, TurnCommand
from circnav_mav.mav.autopilots.table import adapters
from circnav_mav.mav.codec import LinkCounts, Message
from circnav_mav.mav.frames import YawRate
from circnav_mav.mav.gate import UnsafeSetpointError
from circnav_mav.mav.ranging import RANGING_MESSAGES, RangeReader, Reject
from circnav_mav.mav.session import HANDLED, HEARTBEAT_PERIOD, LOST_AFTER, Session
from circnav_mav.mav.signing import Signing
from circnav_mav.pilot.beat import Beat
from circnav_mav.pilot.handover import ModeRequest
from circnav_mav.pilot.helm import Helm
from circnav_mav.pilot.listening import decoders
from circnav_mav.pilot.reasons import why_no_vehicle, why_not_guided, why_not_ready, why_slow, why_withheld
from circnav_mav.pilot.record import plot_values, tick_record
from circnav_mav.pilot.settings import (
    RANGING,
    VEHICLE,
    Ending,
    Outcome,
    PilotSettings,
    TickRecord,
    Voice,
)

STALL = 0.5
"""Gap between two steps, s, after which everything that came in during it counts as stale."""
SAFE_SETPOINTS = 3
"""Times that the safe setpoint is sent before silence: a datagram can be lost."""
LEAVING_PATIENCE = 12.0
"""Time, s, that the exit action may take before we fall silent without it."""
LANDED_PATIENCE = 1.5
"""Time, s, that a vehicle is given to tell whether it flies before the first engagement."""
AUTOPILOT_COMPONENT = 1
STOP_SENDING = "stop"


class Pilot:
    """The guidance application: ranging and vehicle telemetry in, setpoints out."""

    def __init__(self, settings: PilotSettings, signing: Signing | None = None) -> None:
        """signing: signs what is sent and tells who is believed; None: neither."""
        message = RANGING_MESSAGES[settings.ranging.message]
        from_autopilot = settings.ranging.component == AUTOPILOT_COMPONENT and not settings.ranging_apart
        self.settings = settings
        self.session = Session(
            settings.link,
            adapters(settings.autopilot, settings.kind, settings.facts),
            {message.id: settings.ranging.rate} if from_autopilot else None,
            signing,
        )
        self._noise = NoiseCheck(settings.orbit.speed, settings.orbit.max_turn_rate)
        self.ranging = RangeReader(settings.ranging, self._noise)
        self.estimator = ESTIMATORS[settings.estimator](settings.estimation)
        self.helm = Helm(settings)
        self.phase = Phase.WAIT_LINK
        self.outcome: Outcome | None = None
        self.engaged_at: float | None = None
        self.why = ""
        """Why the law flies that flies, for people."""
        self.setpoints_sent = 0
        self.samples_accepted = 0
        self._decoders = decoders(settings, HANDLED | {message.id}, signing)
        self._ranging_link = RANGING if settings.ranging_apart else VEHICLE
        self._noise_told = False
        self._records: list[TickRecord] = []
        self._frames: list[bytes] = []
        self._newest: RangeSample | None = None
        self._fresh = False
        self._started: float | None = None
        self._stepped: float | None = None
        self._beat = Beat(settings.timing.tick)
        self._next_hello = float("-inf")
        self._phase_since = 0.0
        self._lost_at: float | None = None
        self._consent = True
        self._left_mode = False
        self._reboots = 0
        self._twins = 0
        self._heartbeats_before: int | None = None
        self._engaging = ModeRequest()
        self._leaving = ModeRequest()
        self._safe_left = SAFE_SETPOINTS
        self._law = ""

    # --- in -------------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, now: float, source: Hashable = None, link: str = VEHICLE) -> None:
        """Take in one datagram (or chunk of a stream) that arrived at `now` from `source` on a link."""
        decoder = self._decoders[link]
        for message in decoder.decode(data):
            if link == VEHICLE and self.session.receive(message, now, source):
                self._take_motion(message, now)
            if link == self._ranging_link:
                self._take_range(message, now)
        self._frames += decoder.frames
        if link == VEHICLE and decoder.behind:
            self.session.greet(source)

    def interrupt(self, now: float, reason: str) -> None:
        """End the flight now: the next step sends the safe setpoint."""
        self._finish(Ending.INTERRUPTED, reason, now)
        self._beat.at_once()

    def _take_range(self, message: Message, now: float) -> None:
        sample = self.ranging.read(message, now)
        if self.ranging.restarted:
            self.estimator.restamp()
        if sample is None:
            return
        if self._stalled(now):
            self.ranging.reject(Reject.STALLED)
            return
        self._tell_noise()
        fused = self.estimator.observe(sample)
        if fused is Fused.GATED:
            self.ranging.reject(Reject.GATED)
            return
        self.samples_accepted += 1
        self._newest, self._fresh = sample, True
        self._beat.heard(now)

    def _take_motion(self, message: Message, now: float) -> None:
        """Own motion teaches the turn-rate gain, and estimators that know where the vehicle is heading."""
        if not self.session.motion.receive(message, now):
            return
        own = self.session.motion.own(now, self._airspeed(now))
        if own is not None:
            self.helm.feel(own)
            if self.session.adapter.measures_airspeed or (self.phase in STEERING and self._flies_as_told()):
                self.estimator.move(own)

    def _flies_as_told(self) -> bool:
        """Whether the vehicle has the speed that it is told; whose setpoints are another's is believed to have it."""
        return self.helm.at_speed if self.settings.voice is Voice.FLY else self.helm.followed

    def _airspeed(self, now: float) -> float:
        """As measured; else the speed that the vehicle is told to hold, as it does while it is ours and hears us."""
        measured = self.session.motion.at(now).airspeed if self.session.adapter.measures_airspeed else None
        return self.settings.orbit.speed if measured is None else measured

    # --- out ------------------------------------------------------------------------------------------------------

    @property
    def done(self) -> bool:
        """Whether the mission is over and nothing more will be sent."""
        return self.phase is Phase.ENDED

    @property
    def next_tick(self) -> float:
        """When the next step is due if nothing arrives before."""
        return self._beat.due

    @property
    def reply_to(self) -> Hashable:
        """Where the vehicle link's bytes go: the source of the vehicle's frames, None before it was heard."""
        return self.session.reply_to

    def counts(self, link: str = VEHICLE) -> LinkCounts:
        """What came in on a link."""
        return self._decoders[link].counts

    def frames_refused(self) -> Counter[str]:
        """Frames that were not believed on any link, by what was wrong with their signature."""
        return sum((decoder.counts.refused for decoder in self._decoders.values()), Counter())

    def take_records(self) -> list[TickRecord]:
        """The ticks since the last call."""
        records, self._records = self._records, []
        return records

    def take_frames(self) -> list[bytes]:
        """The whole frames that came in since the last call, on any link."""
        frames, self._frames = self._frames, []
        return frames

    def hello(self, now: float) -> bytes:
        """What goes out on a separate ranging link: a heartbeat, for routers forward only to those who have spoken."""
        if self.done or now < self._next_hello:
            return b""
        self._next_hello = now + HEARTBEAT_PERIOD
        return self.session.encoder.encode(self.session.heartbeat())

    def step(self, now: float) -> bytes:
        """Decide and answer. Acts when a fresh range is waiting or a tick is due; else returns nothing at once."""
        if self._stalled(now):
            self._fresh, self._heartbeats_before = False, self.session.heartbeats
        self._stepped = now
        # the last words are a tick apart, however many ranges come
        answers = self._fresh and self.phase is not Phase.LEAVING
        if self.done or not (answers or now >= self._beat.due):
            return b""
        self._fresh = False
        self._beat.stepped(now)
        self._started = now if self._started is None else self._started
        self._watch_link(now)
        self._watch_takeover(now)
        self._watch_time(now)
        estimate = self.estimator.at(now)
        self._watch_bounds(estimate, now)
        self._watch_ranging(estimate, now)
        self._watch_engagement(now)
        command = self.helm.command(self.phase, estimate, self.session.round_trip.worst)
        self._tell_law(command)
        messages, sent = self._setpoint(command, now)
        self._records.append(
            tick_record(
                now, self.phase, self.session, estimate, command, sent,
                newest=self._newest, nis=self.estimator.nis, turn_gain=self.helm.turn_gain,
                law=self.settings.law.name, accepted=self.samples_accepted,
                rejected=self.ranging.refused,
            )
        )  # fmt: skip
        messages += self._housekeeping(estimate, command, now)
        return b"".join(map(self.session.encode, messages))

    def last_words(self, now: float) -> bytes:
        """The safe setpoint alone, for the shell to send when the pilot itself has failed; empty if not ours to fly."""
        if self.settings.voice is not Voice.FLY or self.phase not in STEERING or not self.session.in_our_mode:
            return b""
        return self.session.encode(self.helm.safe_setpoint(self.session, now))

    def _housekeeping(self, estimate: RangeEstimate | None, command: TurnCommand | None, now: float) -> list[Message]:
        """Heartbeat, commands, streams, texts and plot values; the farewell at the end."""
        plots = self.session.announcer.plots(plot_values(self.settings.orbit, estimate, command), now)
        if self.settings.voice is Voice.SHADOW:
            return self.session.heartbeats_due(now) + plots
        return self.session.poll(now) + plots + (self.session.farewell() if self.done else [])

    # --- what moves the phases --------------------------------------------------------------------------------------

    def _event(self, event: Event, now: float) -> bool:
        """Apply an event; tells whether it changed the phase."""
        before, self.phase = self.phase, advance(self.phase, event)
        if self.phase is before:
            return False
        self._phase_since = now
        return True

    def _finish(self, ending: Ending, reason: str, now: float) -> None:
        if self.outcome is None:
            self.outcome = Outcome(ending, reason)
            self._say("end", f"ended, {reason}")
        self._event(Event.FINISH, now)

    def _watch_link(self, now: float) -> None:
        session = self.session
        if session.up and session.heartbeat_age(now) > LOST_AFTER:
            session.lose()
            if self.phase in STEERING:
                self._lost_at = now
            self._event(Event.LINK_LOST, now)
        elif session.up:
            self._event(Event.LINK_UP, now)

    def _watch_takeover(self, now: float) -> None:
        """The operator always wins: a mode that is not ours, disarming or a reboot ends the stream in this very step.

        The vehicle is ours again only after it was seen outside the guided mode and then in it.
        """
        session = self.session
        rebooted, self._reboots = session.reboots > self._reboots, session.reboots
        if rebooted:
            self.estimator.reset()
        outside = session.up and session.mode is not None and session.mode != session.adapter.guided_mode
        if outside:
            self._left_mode = True
        if self._left_mode and session.in_our_mode:
            self._consent, self._left_mode = True, False
        resuming = self.engaged_at is not None and self.phase in (Phase.WAIT_RANGING, Phase.READY)
        ours = self.phase in STEERING or self.phase is Phase.LEAVING or resuming
        if not ours or self.settings.voice is not Voice.FLY or not session.up:
            return
        if session.in_our_mode and not rebooted:
            return
        self._consent, self._left_mode = False, outside
        self._event(Event.MODE_LEFT, now)
        self.session.drop_mode_requests()
        self.helm.let_go()
        if self.outcome is not None:  # we were leaving: this is the exit action taking effect
            return
        what = reason = "autopilot rebooted" if rebooted else "vehicle disarmed"
        if outside and not rebooted:
            what = f"{session.adapter.mode_names[session.adapter.guided_mode]} left for {session.mode_name}"
            reason = f"{what}: operator or failsafe"
        self._say("yield", what)
        if self.settings.end_on_takeover:
            self._finish(Ending.ABORTED, reason, now)

    def _watch_bounds(self, estimate: RangeEstimate | None, now: float) -> None:
        """The mission's own limits while the vehicle is ours, and a twin of ours at any time."""
        session = self.session
        twins, self._twins = session.ignored["twin"], session.ignored["twin"]
        if twins > 3:
            ids = f"{session.encoder.system}/{self.settings.link.component_id}"
            self._finish(Ending.ABORTED, f"another companion sends as {ids}: give one of us another component_id", now)
        if self.phase not in STEERING:
            return
        broken = breach(
            self.settings.bounds,
            r=estimate.r if estimate and self.phase is Phase.ENGAGED else None,
            altitude=session.motion.at(now).altitude,
            battery=session.battery,
        )
        if broken is not None:
            self._finish(Ending.ABORTED, broken, now)

    def _watch_time(self, now: float) -> None:
        timing = self.settings.timing
        waited = now - self._phase_since
        if self.engaged_at is not None and now - self.engaged_at >= timing.duration:
            if self.phase in STEERING:
                flown = "flown" if self.settings.voice is Voice.FLY else "dry run"
                self._finish(Ending.COMPLETED, f"{flown} to its end", now)
            else:
                self._finish(Ending.ABORTED, f"time ran out while {self.phase.value}{self._what_is_gone(now)}", now)
        elif self.phase is Phase.HOLDING and waited > timing.hold:
            self._finish(Ending.ABORTED, f"no range for {waited:.1f} s", now)
        elif self._lost_at is not None and now - self._lost_at > timing.outage:
            self._finish(Ending.ABORTED, f"vehicle or ranging gone for {timing.outage:.0f} s", now)
        elif self.engaged_at is not None or self._started is None:
            return
        elif self.phase is Phase.WAIT_LINK and now - self._started > timing.wait_link:
            self._finish(Ending.NOTHING_HEARD, f"no vehicle: {why_no_vehicle(self.session, self.counts())}", now)
        elif self.phase is Phase.WAIT_RANGING and waited > timing.wait_ranging:
            self._finish(Ending.NOTHING_HEARD, self._why_not_ready(now), now)

    def _what_is_gone(self, now: float) -> str:
        """Which silence a flight that runs out of time waits in."""
        if self.phase is Phase.WAIT_LINK:
            return f", no heartbeat for {self.session.heartbeat_age(now):.0f} s"
        age = self._range_age(now) if self.phase is Phase.WAIT_RANGING else None
        return "" if age is None else f", no range for {age:.0f} s"

    def _watch_ranging(self, estimate: RangeEstimate | None, now: float) -> None:
        age = self._range_age(now)
        fresh = age is not None and age <= self.settings.timing.stale + SAME_TIME
        good = self.estimator.ready and estimate is not None and fresh
        if self.phase is Phase.WAIT_RANGING and self._missing(now):
            return
        before = self.phase
        if self._event(Event.RANGE_GOOD if good else Event.RANGE_LOST, now) and before in STEERING:
            self._say("range", "range is back" if good else "range lost, holding")

    def _watch_engagement(self, now: float) -> None:
        flying = self.settings.voice is Voice.FLY
        grounded = self._may_be_on_ground(now)
        quick = self._link_quick(now)
        allowed = not flying or (self._consent and self.session.in_our_mode and not grounded and quick)
        if allowed and self.phase is Phase.YIELDED:
            self._event(Event.MODE_OURS, now)
        elif allowed and self.phase is Phase.READY:
            self._engage(now)
        elif self.phase is Phase.READY and quick and self._may_request_mode(grounded):
            adapter = self.session.adapter
            failure = self._engaging.ask(self.session, adapter.guided_mode, now)
            if failure is not None:
                name = adapter.mode_names[adapter.guided_mode]
                self._finish(Ending.ABORTED, f"mode {name} {failure}", now)

    def _may_be_on_ground(self, now: float) -> bool:
        """An aircraft is not steered before it flies; one that does not say whether it does is given a moment to."""
        session = self.session
        if not session.adapter.flies or self.engaged_at is not None:
            return False
        if session.on_ground is None:
            return now - session.pinned_at < LANDED_PATIENCE
        return session.on_ground

    def _link_quick(self, now: float) -> bool:
        """Whether question and answer are within the mission's bound; asked before the first engagement only."""
        trip = self.session.round_trip
        if self.engaged_at is not None:
            return True
        return trip.settled(now) and (trip.typical or 0.0) <= self.settings.timing.round_trip

    def _may_request_mode(self, grounded: bool) -> bool:
        """Only where the mission says so, in the air, and never again once the flight has begun."""
        return (
            self.settings.request_mode and self.settings.voice is Voice.FLY and self.engaged_at is None and not grounded
        )

    def _engage(self, now: float) -> None:
        self._event(Event.MODE_OURS, now)
        self.session.drop_mode_requests()
        self._lost_at = None
        self.engaged_at = now if self.engaged_at is None else self.engaged_at
        orbit = self.settings.orbit
        doing = "engaged" if self.settings.voice is Voice.FLY else "dry run"
        self._say("engage", f"{doing}, {orbit.radius:g} m {orbit.direction.value}")

    # --- the setpoint -------------------------------------------------------------------------------------------------

    def _setpoint(self, command: TurnCommand | None, now: float) -> tuple[list[Message], YawRate | None]:
        """The setpoint message of this step, if any, and the yaw rate in it."""
        if self._heartbeats_before is not None and self.session.heartbeats > self._heartbeats_before:
            self._heartbeats_before = None
        silent = self.settings.voice is not Voice.FLY or self._heartbeats_before is not None
        try:
            if self.phase is Phase.LEAVING:
                return self._leave(now, silent=silent), None
            if silent:
                return [], None
            if command is None:
                return self._stream_before_engaging(now), None
            message, yaw_rate = self.helm.setpoint(command, self.session, now)
        except UnsafeSetpointError as error:
            self._finish(Ending.ABORTED, f"internal error, unsafe setpoint held back: {error}", now)
            return [], None
        self.setpoints_sent += 1
        return [message], yaw_rate

    def _leave(self, now: float, *, silent: bool) -> list[Message]:
        """The safe setpoint until the exit action shows in the vehicle's mode, or some times over; then silence."""
        action = self._exit_action()
        failure = None
        if silent:
            self._event(Event.SAFE_SENT, now)
            return []
        if action is not None:
            failure = self._leaving.ask(self.session, self.session.adapter.exits[action], now)
            if failure is None and now - self._phase_since > LEAVING_PATIENCE:
                failure = "without effect"
        self._safe_left -= 1
        if failure is not None and self.outcome is not None:
            self.outcome = Outcome(self.outcome.ending, f"{self.outcome.reason}; exit action {action} {failure}")
        if failure is not None or (action is None and self._safe_left <= 0):
            self._event(Event.SAFE_SENT, now)
        self.setpoints_sent += 1
        return [self.helm.safe_setpoint(self.session, now)]

    def _exit_action(self) -> str | None:
        """The mission's exit action, or the autopilot's default; None: stop sending."""
        action = self.settings.exit or self.session.adapter.default_exit
        return None if action == STOP_SENDING else action

    def _stream_before_engaging(self, now: float) -> list[Message]:
        """PX4 enters OFFBOARD only while setpoints flow; before that it does not fly them. Never after a takeover."""
        if self.phase is not Phase.READY or not self.session.adapter.needs_setpoints_first or not self._consent:
            return []
        if not self._link_quick(now) and not self.session.in_our_mode:  # then let PX4 refuse the mode
            return []
        self.setpoints_sent += 1
        return [self.helm.safe_setpoint(self.session, now, engaged=False)]

    # --- what is told -------------------------------------------------------------------------------------------------

    def waits_for(self, now: float) -> str:
        """What the vehicle is not steered for now, for people; empty where nothing is missing."""
        if self.phase is Phase.WAIT_LINK:
            return why_no_vehicle(self.session, self.counts())
        if self.phase is Phase.WAIT_RANGING:
            return self._why_not_ready(now)
        return self._why_not_engaged(now) if self.phase in (Phase.READY, Phase.YIELDED) else ""

    def _why_not_ready(self, now: float) -> str:
        missing = self._missing(now) if self.estimator.ready else []
        return why_not_ready(
            self.session, RANGING_MESSAGES[self.settings.ranging.message], self.ranging.rejected,
            missing=missing, counts=self.counts(self._ranging_link),
        )  # fmt: skip

    def _why_not_engaged(self, now: float) -> str:
        if not self._consent:
            return why_withheld(self.session, left_mode=self._left_mode)
        if not self._link_quick(now):
            return why_slow(self.session.round_trip.typical, self.settings.timing.round_trip)
        if self._may_be_on_ground(now):
            return (
                "the vehicle is on the ground" if self.session.on_ground else "whether the vehicle flies is not known"
            )
        return why_not_guided(self.session, request_mode=self.settings.request_mode)

    def _missing(self, now: float) -> list[str]:
        """What the vehicle must tell before it can be flown, and does not."""
        motion = self.session.motion.at(now)
        return sorted(name for name in self.session.adapter.needs if getattr(motion, name) is None)

    def _stalled(self, now: float) -> bool:
        return self._stepped is not None and now - self._stepped > STALL

    def _range_age(self, now: float) -> float | None:
        return None if self._newest is None else now - self._newest.time

    def _say(self, kind: str, text: str) -> None:
        self.session.announcer.say(kind, text)

    def _tell_noise(self) -> None:
        """Say, once, that ranges scatter more than they say."""
        if self._noise.found is not None and not self._noise_told:
            self._noise_told = True
            self._say("noise", "ranges scatter {1:.2g} m, not {0:.2g} as told".format(*self._noise.found))

    def _tell_law(self, command: TurnCommand | None) -> None:
        """Say when another law takes over, and why."""
        if command is not None and command.flies and command.flies != self._law:
            self._law, self.why = command.flies, command.why
            if self.settings.voice is Voice.FLY:
                self._say("law", command.why)
