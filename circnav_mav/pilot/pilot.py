"""The whole application as one object without I/O: bytes and the time in, bytes out.

    pilot.receive(data, now); link.send(pilot.step(now))

A fresh range is answered by the very next step. A tick after it the prediction steers, for a short time; without more
ranges the orbit's own turn rate is held, then given up. The operator always wins: see `authority`.
"""

from collections import Counter
from collections.abc import Hashable
from dataclasses import replace

from circnav_mav.guidance.bounds import breach
from circnav_mav.guidance.drift_alarm import DriftAlarm, watch_drift
from circnav_mav.guidance.phases import Event, Phase
from circnav_mav.guidance.types import RangeEstimate, TurnCommand
from circnav_mav.guidance.velocity_loop import CopterMotion
from circnav_mav.mav.autopilots.table import adapters
from circnav_mav.mav.codec import LinkCounts, Message
from circnav_mav.mav.frames import YawRate
from circnav_mav.mav.identity import RADIO_NAME, Allowance, describe_sender
from circnav_mav.mav.ranging import RANGING_MESSAGES
from circnav_mav.mav.sensor_clock import nobody_tells
from circnav_mav.mav.session import HANDLED, HEARTBEAT_PERIOD, LOST_AFTER, Session
from circnav_mav.mav.setpoint_guard import UnsafeSetpointError
from circnav_mav.mav.signing import Signing
from circnav_mav.pilot.authority import Authority
from circnav_mav.pilot.controller import Helm
from circnav_mav.pilot.engagement import Engagement
from circnav_mav.pilot.exit_action import Leaving
from circnav_mav.pilot.listening import decoders, more_streams
from circnav_mav.pilot.progress import Progress
from circnav_mav.pilot.range_tracker import Target
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
from circnav_mav.pilot.tick_scheduler import Beat
from circnav_mav.pilot.timeouts import Waiting

STALL = 0.5
"""Gap between two steps, s, after which everything that came in during it counts as stale."""
CATCH_UP = 0.2
"""Time after it, s, in which what comes in may still be from before."""
SILENT = 1.5
"""Age of the vehicle's last word about its mode, s, above which it may be in other hands."""


class Pilot:
    """The guidance application: ranging and vehicle telemetry in, setpoints out."""

    def __init__(self, settings: PilotSettings, signing: Signing | None = None) -> None:
        """signing: signs what is sent and tells who is believed; None: neither."""
        message = RANGING_MESSAGES[settings.ranging.message]
        streams = more_streams(settings)
        self.settings = settings
        self.session = Session(
            settings.link,
            adapters(settings.autopilot, settings.kind, settings.facts),
            streams,
            signing,
        )
        self._say = self.session.announcer.say
        self.target = Target(
            settings, self._say, nobody_tells if settings.ranging_apart else self.session.round_trip.slower
        )
        self.helm = Helm(settings)
        self.why = ""
        """Why the law flies that flies, for people."""
        self.drift_alarm = DriftAlarm()
        self.allowance = Allowance()
        self.setpoints_sent = 0
        self._gave_setpoint = False
        self._progress = Progress(self._say, self._in_our_hands)
        self._authority = Authority()
        self._engagement = Engagement(settings, self.session, self._authority, self._progress)
        self._leaving = Leaving(settings.exit)
        self._beat = Beat(settings.timing.tick)
        self._decoders = decoders(settings, HANDLED | {message.id, *streams}, signing)
        self._waiting = Waiting(settings, self.session, self.target, self._progress, self._decoders)
        self._ranging_link = RANGING if settings.ranging_apart else VEHICLE
        self._records: list[TickRecord] = []
        self._frames: list[bytes] = []
        self._stepped: float | None = None
        self._caught_up = float("-inf")
        self._next_hello = float("-inf")
        self._reboots = 0
        self._heartbeats_before: int | None = None
        self._rivals: set[str] = set()
        self._law = ""
        self._cycles = 0
        self._airspeed_told = False
        self._copter_motion = CopterMotion()

    # --- in -------------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, now: float, source: Hashable = None, link: str = VEHICLE) -> None:
        """Take in one datagram (or chunk of a stream) that arrived at `now` from `source` on a link."""
        if not self._worth_reading(source, len(data), now, link):
            return
        decoder = self._decoders[link]
        for message in decoder.decode(data):
            if link == VEHICLE and self.session.receive(message, now, source):
                self._take_motion(message, now)
            if link == self._ranging_link:
                self._take_range(message, now, source)
        self._frames += decoder.frames
        if link == VEHICLE and decoder.behind:
            self.session.pinning.greet(source)

    def interrupt(self, now: float, reason: str) -> None:
        """End the flight now: the next step sends the safe setpoint."""
        self._progress.finish(Ending.INTERRUPTED, reason, now)
        self._beat.at_once()

    def abandon(self, reason: str) -> None:
        """An error of ours has ended the flight, whatever it had come to."""
        self._progress.outcome = Outcome(Ending.ABORTED, reason)

    def _worth_reading(self, source: Hashable, size: int, now: float, link: str) -> bool:
        """Whether a datagram is read: all of the vehicle and of the ranging radio, of others within an allowance."""
        peer, radio = self.session.peer, self.target.ranging.trusted
        unknown = peer is None if link == VEHICLE else radio is None
        trusted = link == VEHICLE and peer is not None and source == peer.source
        trusted |= link == self._ranging_link and radio is not None and source == radio[2]
        return unknown or trusted or self.allowance.take(size, now)

    def _take_range(self, message: Message, now: float, source: Hashable) -> None:
        session, apart = self.session, self.settings.ranging_apart
        heard = self.target.hear(
            message, now, stalled=self._stalled(now), one_way=self._one_way(),
            strangers=() if apart else session.pinning.strangers,
            source=source, vehicle=session.peer.source if session.peer and not apart else None,
        )  # fmt: skip
        ranging = self.target.ranging
        if ranging.rival is not None and ranging.trusted is not None:
            session.pinning.rivals.heard(RADIO_NAME, ranging.rival, ranging.trusted, now)
        if heard:
            self._beat.heard(now)

    def _one_way(self) -> float:
        """Least delay of the ranges, s, as far as the vehicle's answers tell; before the engagement a slow link has its
        own bound, and is waited for."""
        if self.settings.ranging_apart or self.engaged_at is None:
            return 0.0
        return self.session.round_trip.one_way

    def _take_motion(self, message: Message, now: float) -> None:
        """Own motion teaches the height, the turn-rate gain, and estimators that know where the vehicle is heading."""
        is_attitude, height = self.session.motion.receive(message, now), self.target.height
        if height.hear(message, self.session.motion.at(now).altitude, now):
            self._say("altitude", f"altitude jumped, {height.jumped:+.0f} m not counted")
        if not is_attitude:
            return
        adapter = self.session.adapter
        own = self.session.motion.own(now, self._airspeed(now), banks=adapter.measures_airspeed)
        if own is not None:
            if adapter.velocity_loop is not None:
                self._copter_motion, own = self._copter_motion.follow(own, adapter.velocity_loop)
            self.helm.feel(own)
            if self.session.adapter.measures_airspeed or (self._progress.steering and self._flies_as_told()):
                self.target.move(own)

    def _flies_as_told(self) -> bool:
        """Whether the vehicle has the speed that it is told; whose setpoints are another's is believed to have it."""
        return self.helm.at_speed if self.settings.voice is Voice.FLY else self.helm.followed

    def _airspeed(self, now: float) -> float:
        """As measured, where that can be; else the speed that the vehicle is told to hold, as it does while it is ours
        and hears us."""
        adapter = self.session.adapter
        measured = self.session.motion.at(now).airspeed if adapter.measures_airspeed else None
        believed = adapter.airspeed(measured)
        doubted = measured is not None and measured != believed
        if doubted and self._progress.steering and not self._airspeed_told:  # on the ground it is no wonder
            self._airspeed_told = True
            self._say("airspeed", f"airspeed {measured:.1f} m/s not believed")
        return believed

    def _stalled(self, now: float) -> bool:
        """Whether what comes in now may have waited while we stood still; it takes a few turns to read it all."""
        return now < self._caught_up or self._stood_still(now)

    @property
    def _doubtful(self) -> bool:
        """Whether the vehicle may be in other hands since we stalled, for no heartbeat has told its mode yet; or may be
        another one since it was silent, for its time has not."""
        return self._heartbeats_before is not None or self.session.told.unproven

    def _stood_still(self, now: float) -> bool:
        return self._stepped is not None and now - self._stepped > STALL

    # --- what is known of it ----------------------------------------------------------------------------------------

    @property
    def phase(self) -> Phase:
        """Where the mission stands."""
        return self._progress.phase

    @property
    def outcome(self) -> Outcome | None:
        """How the mission ended; None while it goes on."""
        return self._progress.outcome

    @property
    def engaged_at(self) -> float | None:
        """The first engagement, s."""
        return self._progress.engaged_at

    @property
    def done(self) -> bool:
        """Whether the mission is over and nothing more will be sent."""
        return self._progress.phase is Phase.ENDED

    @property
    def next_tick(self) -> float:
        """When the next step is due if nothing arrives before."""
        return self._beat.due

    @property
    def reply_to(self) -> Hashable:
        """Where the vehicle link's bytes go: the source of the vehicle's frames, None before it was heard."""
        return self.session.reply_to

    @property
    def believed(self) -> str:
        """Who is believed to be the vehicle and its radio, and from where, for people; empty while nobody is."""
        peer, radio = self.session.peer, self.target.ranging.trusted
        if peer is None:
            return ""
        ranges = "" if radio is None else f", ranges of {radio[0]}/{radio[1]}"
        if radio is not None and radio[2] != peer.source:
            ranges = f", ranges of {describe_sender(radio)}"
        return f"{describe_sender(peer.sender)}{ranges}"

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

    def waits_for(self, now: float) -> str:
        """What the vehicle is not steered for now, for people; empty where nothing is missing."""
        if self.phase is Phase.WAIT_LINK:
            return self._waiting.why_no_vehicle()
        if self.phase is Phase.WAIT_RANGING:
            return self._waiting.why_not_ready(now)
        return self._engagement.why_not(now) if self.phase in (Phase.READY, Phase.YIELDED) else ""

    # --- out ------------------------------------------------------------------------------------------------------

    def hello(self, now: float) -> bytes:
        """What goes out on a separate ranging link: a heartbeat, for routers forward only to those who have spoken."""
        if self.done or now < self._next_hello:
            return b""
        self._next_hello = now + HEARTBEAT_PERIOD
        return self.session.encode(self.session.heartbeat())

    def step(self, now: float) -> bytes:
        """Decide and answer. Acts when a fresh range is waiting or a tick is due; else returns nothing at once."""
        self._gave_setpoint = False
        if self._stood_still(now):
            self._caught_up = now + CATCH_UP
        if self._stalled(now):
            self.target.fresh, self._heartbeats_before = False, self.session.told.heartbeats
            self.session.drop_mode_requests()
        elif self._heartbeats_before is not None and self.session.told.heartbeats > self._heartbeats_before:
            self._heartbeats_before = None
        self._stepped = now
        # the last words are a tick apart, however many ranges come
        answers = self.target.fresh and self.phase is not Phase.LEAVING
        if self.done or not (answers or now >= self._beat.due):
            return b""
        self.target.fresh = False
        self._beat.stepped(now)
        self._progress.step(now)
        self._watch_link(now)
        self._watch_takeover(now)
        self._waiting.watch(now)
        self._tell_rivals(now)
        estimate = self.target.at(now)
        self._watch_bounds(estimate, now)
        self._watch_ranging(estimate, now)
        self._watch_drift(estimate)
        self._watch_engagement(now)
        command = self.helm.command(self.phase, estimate, self.session.round_trip.worst, now)
        self._tell_law(command)
        self._tell_cycle()
        messages, sent = self._setpoint(command, now)
        self._records.append(
            tick_record(
                now, self.phase, self.session, estimate, command, sent,
                newest=self.target.newest, height=self.target.height.at(now), nis=self.target.estimator.nis,
                turn_gain=self.helm.turn_gain, turn_delay=self.helm.response.delay, gain_share=self.helm.gain_share,
                law=self.settings.law.name, accepted=self.target.accepted,
                rejected=self.target.ranging.refused,
            )
        )  # fmt: skip
        messages += self._housekeeping(estimate, command, now)
        return b"".join(map(self.session.encode, messages))

    def hold_back(self) -> None:
        """What the newest step gave out was not sent: the shell had stood still in it for too long."""
        if self._gave_setpoint:
            self.setpoints_sent -= 1
            self._records[-1] = replace(self._records[-1], yaw_rate_sent=None)

    def last_words(self, now: float) -> bytes:
        """The safe setpoint, and the exit action asked for once, for the shell to send when the pilot itself has
        failed; empty if not ours to fly."""
        begun = self._progress.steering or self._progress.resuming or self.phase is Phase.LEAVING
        if not begun or not self._in_our_hands() or self.session.told.unproven:
            return b""
        words = [self.helm.safe_setpoint(self.session, now)]
        sure = not (self._stalled(now) or self._doubtful) and self.session.heartbeat_age(now) < SILENT
        if sure:  # a mode is obeyed whoever has the vehicle
            words += self._leaving.at_once(self.session)
        return b"".join(map(self.session.encode, words))

    def _in_our_hands(self) -> bool:
        """Whether the vehicle obeys us, and may."""
        return self.settings.voice is Voice.FLY and self._authority.consent and self.session.in_our_mode

    def _housekeeping(self, estimate: RangeEstimate | None, command: TurnCommand | None, now: float) -> list[Message]:
        """Heartbeat, commands, streams, texts and plot values; the farewell at the end."""
        plots = self.session.announcer.plots(plot_values(self.settings.orbit, estimate, command), now)
        if self.settings.voice is Voice.SHADOW:
            return self.session.heartbeats_due(now) + plots
        if self.done:
            self.session.drop_mode_requests()
        return self.session.poll(now) + plots + (self.session.farewell() if self.done else [])

    # --- what moves the phases --------------------------------------------------------------------------------------

    def _watch_link(self, now: float) -> None:
        """A vehicle that is not proven to be the one of before counts as lost; last words wait for it a while."""
        session = self.session
        if session.up and session.heartbeat_age(now) > LOST_AFTER:
            session.lose()
            self._progress.lose(now)
        elif session.up and session.told.unproven:
            if self.phase is not Phase.LEAVING:
                self._progress.lose(now)
        elif session.up:
            self._progress.happened(Event.LINK_UP, now)

    def _watch_takeover(self, now: float) -> None:
        """The operator's word ends the stream in this very step."""
        session, progress = self.session, self._progress
        rebooted, self._reboots = session.reboots > self._reboots, session.reboots
        if rebooted:
            self.target.estimator.reset()
        # with consent it is ours also where it was lost, or was given back and cannot be steered yet
        ours = self._authority.consent or progress.phase not in (Phase.WAIT_LINK, Phase.YIELDED)
        begun = self.engaged_at is not None and self.settings.voice is Voice.FLY
        takeover = self._authority.watch(session, ours=ours and begun, rebooted=rebooted)
        if takeover is None:
            return
        progress.yield_to_operator(now)
        session.drop_mode_requests()
        self.helm.let_go()
        self.target.ranging.sender_stays = False
        if progress.outcome is not None:  # we were leaving: this is the exit action taking effect
            return
        self._say("yield", takeover.what)
        if self.settings.end_on_takeover:
            progress.finish(Ending.ABORTED, takeover.reason, now)

    def _watch_bounds(self, estimate: RangeEstimate | None, now: float) -> None:
        """The mission's own limits while the vehicle is ours, and a twin of ours at any time."""
        session, progress = self.session, self._progress
        if session.doubled:
            ids = f"{session.encoder.system}/{self.settings.link.component_id}"
            reason = f"another companion sends as {ids}: give one of us another component_id"
            progress.finish(Ending.ABORTED, reason, now)
        if not progress.steering:
            return
        broken = breach(
            self.settings.bounds,
            r=estimate.r if estimate and progress.phase is Phase.ENGAGED else None,
            altitude=session.motion.at(now).altitude,
            battery=session.told.battery,
        )
        if broken is not None:
            progress.finish(Ending.ABORTED, broken, now)

    def _watch_ranging(self, estimate: RangeEstimate | None, now: float) -> None:
        progress = self._progress
        good = self.target.good(estimate, now, holding=progress.phase is Phase.HOLDING)
        if progress.phase is Phase.WAIT_RANGING and self.session.missing(now):
            return
        steering = progress.steering
        if progress.happened(Event.RANGE_GOOD if good else Event.RANGE_LOST, now) and steering:
            self._say("range", "range is back" if good else "range lost, holding")

    def _watch_drift(self, estimate: RangeEstimate | None) -> None:
        """Say once that the drift is more than the circle allows, and once that it no longer is."""
        before = self.drift_alarm
        self.drift_alarm = after = watch_drift(before, estimate, self.settings.orbit, self.helm.turn_gain)
        if after.on != before.on:
            self._say("drift", after.text)

    def _watch_engagement(self, now: float) -> None:
        progress, engagement = self._progress, self._engagement
        if progress.phase is Phase.LEAVING or (self._doubtful and self.settings.voice is Voice.FLY):
            return
        allowed = engagement.allowed(now)
        if allowed and progress.phase is Phase.YIELDED:
            progress.happened(Event.MODE_OURS, now)
        elif allowed and progress.phase is Phase.READY:
            self._engage(now)
        elif (failure := engagement.request(now)) is not None:
            progress.finish(Ending.ABORTED, failure, now)

    def _engage(self, now: float) -> None:
        self._progress.engage(now)
        self.target.ranging.sender_stays = self.settings.voice is Voice.FLY
        if self.settings.voice is Voice.FLY:  # a dry run may begin on the ground, far from the height that is told
            self.target.height.engage()
        self.session.drop_mode_requests()
        orbit = self.settings.orbit
        doing = "engaged" if self.settings.voice is Voice.FLY else "dry run"
        self._say("engage", f"{doing}, {orbit.radius:g} m {orbit.direction.value}")

    # --- the setpoint -------------------------------------------------------------------------------------------------

    def _setpoint(self, command: TurnCommand | None, now: float) -> tuple[list[Message], YawRate | None]:
        """The setpoint message of this step, if any, and the yaw rate in it."""
        silent = self.settings.voice is not Voice.FLY or self._doubtful
        yaw_rate = None
        try:
            if self.phase is Phase.LEAVING:
                message = self._leave(now, silent=silent)
            elif silent:
                message = None
            elif command is not None:
                message, yaw_rate = self.helm.setpoint(command, self.session, now)
            elif self._engagement.streams_first(now):
                message = self.helm.safe_setpoint(self.session, now, engaged=False)
            else:
                message = None
        except UnsafeSetpointError as error:
            self._progress.finish(Ending.ABORTED, f"internal error, unsafe setpoint held back: {error}", now)
            return [], None
        if message is None:
            return [], None
        self.setpoints_sent += 1
        self._gave_setpoint = True
        return [message], yaw_rate

    def _leave(self, now: float, *, silent: bool) -> Message | None:
        """The safe setpoint until the exit action shows in the vehicle's mode, or some times over; then silence."""
        progress = self._progress
        if self.settings.voice is not Voice.FLY:
            progress.happened(Event.SAFE_SENT, now)
            return None
        if silent:
            over = self._leaving.wait_to_speak(progress.since, now)
        else:
            over = self._leaving.go_on(self.session, progress.since, now)
        if over:
            progress.happened(Event.SAFE_SENT, now)
        if self._leaving.failure is not None and progress.outcome is not None:
            progress.outcome = Outcome(progress.outcome.ending, f"{progress.outcome.reason}; {self._leaving.failure}")
        return None if silent else self.helm.safe_setpoint(self.session, now)

    def _tell_rivals(self, now: float) -> None:
        """Say that somebody else uses the vehicle's name, ours or the radio's, once each time it begins."""
        rivals = {line.partition(" has ")[0] for line in self.session.pinning.rivals.recent(now)}
        for name in sorted(rivals - self._rivals):
            self._say(f"rival of {name}", f"{name}: second sender rejected")
        self._rivals = rivals

    def _tell_cycle(self) -> None:
        """Say that the turn command swings from limit to limit, and what is done about it."""
        if self.helm.cycles > self._cycles:
            self._cycles = self.helm.cycles
            self._say("cycle", f"turn command swings, gains now {100 * self.helm.gain_share:.0f} %")

    def _tell_law(self, command: TurnCommand | None) -> None:
        """Say when another law takes over, and why."""
        if command is not None and command.flies and command.flies != self._law:
            self._law, self.why = command.flies, command.why
            if self.settings.voice is Voice.FLY:
                self._say("law", command.why)
