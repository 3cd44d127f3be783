"""The whole application as one object without I/O: bytes and the time in, bytes out.

    pilot.receive(data, now); link.send(pilot.step(now))

A fresh range is answered by the very next step; without one a steady tick coasts on the prediction for a short time,
then holds the orbit's own turn rate, then gives up. The operator always wins: see `_watch_vehicle`.
"""

from collections.abc import Hashable
from dataclasses import dataclass
from enum import Enum
from math import isfinite

from circnav_mav.core.estimators.interface import EstimatorSettings, Fused
from circnav_mav.core.estimators.table import ESTIMATORS
from circnav_mav.core.guidance import LawChoice, limit, steering
from circnav_mav.core.phases import STEERING, Event, Phase, advance
from circnav_mav.core.values import Orbit, RangeEstimate, RangeSample, TurnCommand
from circnav_mav.mav.autopilots.table import AUTOPILOTS
from circnav_mav.mav.codec import Decoder, LinkCounts, Message
from circnav_mav.mav.frames import YawRate, yaw_rate_from_turn_rate
from circnav_mav.mav.gate import Limits, SetpointGate, Steer, UnsafeSetpointError
from circnav_mav.mav.ranging import RANGING_MESSAGES, RangeReader, RangingSettings, Reject
from circnav_mav.mav.session import HANDLED, HEARTBEAT_PERIOD, LOST_AFTER, LinkSettings, Session

VEHICLE, RANGING = LINKS = ("vehicle", "ranging")
"""The links: to the vehicle, and to a ranging radio that has an endpoint of its own."""
STALL = 0.5
"""Gap between two steps, s, after which everything that came in during it counts as stale."""
SAFE_SETPOINTS = 3
"""Times that the safe setpoint is sent before silence: a datagram can be lost."""
MODE_PROOF = 3.0
"""Time, s, that an accepted mode request has to show in the vehicle's heartbeat."""
MODE_TRIES = 3


class Ending(Enum):
    """How a flight ended."""

    COMPLETED = "completed"
    INTERRUPTED = "interrupted"
    ABORTED = "aborted"
    NOTHING_HEARD = "nothing heard"


@dataclass(frozen=True, slots=True)
class Outcome:
    """An ending, with the reason for people."""

    ending: Ending
    reason: str


@dataclass(frozen=True, slots=True)
class Timing:
    """All in seconds. duration: of the flight after engaging. wait_link, wait_ranging: patience before the first
    engagement. stale: age of the newest range up to which the prediction steers. hold: how long to hold after that.
    outage: longest silence of the vehicle after which the mission resumes. tick: period without fresh ranges."""

    duration: float
    wait_link: float = 30.0
    wait_ranging: float = 30.0
    stale: float = 0.5
    hold: float = 10.0
    outage: float = 60.0
    tick: float = 0.05


@dataclass(frozen=True, slots=True)
class PilotSettings:
    """A mission, in SI units and radians, as the pilot needs it.

    vehicle: key of the adapter table. request_mode: ask for the guided mode (else wait for the operator to enter it).
    end_on_takeover: whether the operator's leaving the mode ends the mission (else it waits to be given the vehicle
    again). dry_run: compute and log, send no setpoint and request no mode. ranging_apart: ranging comes on a link of
    its own. stream_links: links that are byte streams (TCP, serial), not datagrams.
    """

    orbit: Orbit
    law: LawChoice
    estimator: str
    estimation: EstimatorSettings
    ranging: RangingSettings
    link: LinkSettings
    vehicle: tuple[str, str]
    timing: Timing
    request_mode: bool = False
    end_on_takeover: bool = True
    max_yaw_acceleration: float | None = None
    dry_run: bool = False
    ranging_apart: bool = False
    stream_links: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class TickRecord:
    """One tick, for the log and the display. Rates are the paper's (counter-clockwise positive) except yaw_rate_sent,
    which is MAVLink's. None stands for "not known" or "not sent"."""

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
    range_age: float | None
    link_age: float | None
    mode: str
    accepted: int
    rejected: int


class Pilot:
    """The guidance application: ranging and vehicle telemetry in, setpoints out."""

    def __init__(self, settings: PilotSettings) -> None:
        orbit = settings.orbit
        self.settings = settings
        self.adapter = AUTOPILOTS[settings.vehicle]()
        self.session = Session(settings.link, self.adapter)
        self.ranging = RangeReader(settings.ranging)
        self.estimator = ESTIMATORS[settings.estimator](settings.estimation)
        self.phase = Phase.WAIT_LINK
        self.outcome: Outcome | None = None
        self.engaged_at: float | None = None
        self.setpoints_sent = 0
        self.samples_accepted = 0
        self._steer = steering(orbit, settings.law)
        self._gate = SetpointGate(Limits(orbit.max_turn_rate, orbit.speed, settings.max_yaw_acceleration))
        wanted = HANDLED | self.adapter.streams.keys() | {RANGING_MESSAGES[settings.ranging.message].id}
        self._decoders = {link: Decoder(stream=link in settings.stream_links, wanted=wanted) for link in LINKS}
        self._ranging_link = RANGING if settings.ranging_apart else VEHICLE
        self._records: list[TickRecord] = []
        self._frames: list[bytes] = []
        self._newest: RangeSample | None = None
        self._fresh = False
        self._started: float | None = None
        self._stepped: float | None = None
        self._next_tick = float("-inf")
        self._next_hello = float("-inf")
        self._setpoint_at = float("-inf")
        self._phase_since = 0.0
        self._lost_at: float | None = None
        self._consent = True
        self._left_mode = False
        self._reboots = 0
        self._heartbeats_before: int | None = None
        self._mode_tries = 0
        self._mode_due = float("-inf")
        self._safe_left = SAFE_SETPOINTS

    # --- in -------------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, now: float, source: Hashable = None, link: str = VEHICLE) -> None:
        """Take in one datagram (or chunk of a stream) that arrived at `now` from `source` on a link."""
        decoder = self._decoders[link]
        for message in decoder.decode(data):
            if link == VEHICLE:
                self.session.receive(message, now, source)
            if link == self._ranging_link:
                self._take_range(message, now)
        self._frames += decoder.frames

    def interrupt(self, now: float, reason: str) -> None:
        """End the flight now: the next step sends the safe setpoint."""
        self._finish(Ending.INTERRUPTED, reason, now)
        self._next_tick = float("-inf")

    def _take_range(self, message: Message, now: float) -> None:
        sample = self.ranging.read(message, now)
        if self.ranging.restarted:
            self.estimator.reset()
        if sample is None:
            return
        if self._stalled(now):
            self.ranging.reject(Reject.STALLED)
            return
        fused = self.estimator.observe(sample)
        if fused is Fused.GATED:
            self.ranging.reject(Reject.GATED)
            return
        self.samples_accepted += 1
        self._newest, self._fresh = sample, True

    # --- out ------------------------------------------------------------------------------------------------------

    @property
    def done(self) -> bool:
        """Whether the mission is over and nothing more will be sent."""
        return self.phase is Phase.ENDED

    @property
    def next_tick(self) -> float:
        """When the next step is due if nothing arrives before."""
        return self._next_tick

    @property
    def reply_to(self) -> Hashable:
        """Where the vehicle link's bytes go: the source of the vehicle's frames, None before it was heard."""
        return self.session.reply_to

    def counts(self, link: str = VEHICLE) -> LinkCounts:
        """What came in on a link."""
        return self._decoders[link].counts

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
        fresh, due = self._fresh, now >= self._next_tick
        if self.done or not (fresh or due):
            return b""
        self._fresh = False
        self._started = now if self._started is None else self._started
        self._watch_link(now)
        self._watch_takeover(now)
        self._watch_time(now)
        self._watch_ranging(now)
        self._watch_engagement(now)
        estimate = self.estimator.at(now)
        command = self._command(estimate)
        quiet = now - self._setpoint_at < self.settings.timing.tick / 2
        messages, sent = ([], None) if quiet and not fresh else self._setpoint(command, now)
        self._record(estimate, command, sent, now)
        if due or self.done:  # the rest can wait for the tick: a fresh range is answered at once
            self._next_tick = now + self.settings.timing.tick
            messages += self.session.poll(now) + self.session.announcer.plots(self._plots(estimate, command), now)
        if self.done:
            messages += self.session.farewell()
        return b"".join(map(self.session.encoder.encode, messages))

    def last_words(self, now: float) -> bytes:
        """The safe setpoint alone, for the shell to send when the pilot itself has failed; empty if not ours to fly."""
        if self.settings.dry_run or self.phase not in STEERING or not self.session.in_our_mode:
            return b""
        message = self.adapter.safe_setpoint(self.session.vehicle, now)
        return self.session.encoder.encode(self._gate.check_message(message, self.adapter.shapes))

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
        outside = session.up and session.mode is not None and session.mode != self.adapter.guided_mode
        if outside:
            self._left_mode = True
        if self._left_mode and session.in_our_mode:
            self._consent, self._left_mode = True, False
        ours = self.phase in STEERING or self.phase is Phase.LEAVING
        if not ours or self.settings.dry_run or not session.up or (session.in_our_mode and not rebooted):
            return
        self._consent, self._left_mode = False, outside
        reason = (
            "autopilot rebooted"
            if rebooted
            else "vehicle disarmed"
            if not outside
            else (f"operator took over, mode {session.mode_name}")
        )
        self._event(Event.MODE_LEFT, now)
        self._gate.reset()
        self._say("yield", reason)
        if self.settings.end_on_takeover:
            self._finish(Ending.ABORTED, reason, now)

    def _watch_time(self, now: float) -> None:
        timing = self.settings.timing
        waited = now - self._phase_since
        if self.engaged_at is not None and now - self.engaged_at >= timing.duration:
            self._finish(Ending.COMPLETED, "flown to its end", now)
        elif self.phase is Phase.HOLDING and waited > timing.hold:
            self._finish(Ending.ABORTED, f"no range for {waited:.1f} s", now)
        elif self._lost_at is not None and now - self._lost_at > timing.outage:
            self._finish(Ending.ABORTED, f"vehicle or ranging gone for {timing.outage:.0f} s", now)
        elif self.engaged_at is not None or self._started is None:
            return
        elif self.phase is Phase.WAIT_LINK and now - self._started > timing.wait_link:
            self._finish(Ending.NOTHING_HEARD, f"no vehicle: {self._why_no_vehicle()}", now)
        elif self.phase is Phase.WAIT_RANGING and waited > timing.wait_ranging:
            self._finish(Ending.NOTHING_HEARD, f"no ranging: {self._why_no_ranging()}", now)

    def _watch_ranging(self, now: float) -> None:
        age = self._range_age(now)
        good = self.estimator.ready and age is not None and age <= self.settings.timing.stale
        before = self.phase
        if self._event(Event.RANGE_GOOD if good else Event.RANGE_LOST, now) and before in STEERING:
            self._say("range", "range is back" if good else "range lost, holding")

    def _watch_engagement(self, now: float) -> None:
        allowed = self.settings.dry_run or (self._consent and self.session.in_our_mode)
        if allowed and self.phase is Phase.YIELDED:
            self._event(Event.MODE_OURS, now)
        elif allowed and self.phase is Phase.READY:
            self._event(Event.MODE_OURS, now)
            self._lost_at = None
            if self.engaged_at is None:
                self.engaged_at = now
            orbit = self.settings.orbit
            self._say("engage", f"engaged, {orbit.radius:g} m {orbit.direction.value}")
        elif self.phase is Phase.READY and self.settings.request_mode and not self.settings.dry_run:
            self._ask_for_mode(now)

    def _ask_for_mode(self, now: float) -> None:
        """Request the guided mode; believe it from the heartbeat only."""
        for result in self.session.take_results():
            if not result.accepted:
                said = f", vehicle says: {self.session.texts[-1]}" if self.session.texts else ""
                self._finish(Ending.ABORTED, f"guided mode refused: {result.said}{said}", now)
                return
        if now < self._mode_due or self.session.mode == self.adapter.guided_mode:
            return
        if self._mode_tries == MODE_TRIES:
            self._finish(
                Ending.ABORTED, f"guided mode was acknowledged but the vehicle is in {self.session.mode_name}", now
            )
            return
        self._mode_tries, self._mode_due = self._mode_tries + 1, now + MODE_PROOF
        self.session.commands.send(self.adapter.request_mode(self.adapter.guided_mode))

    # --- the setpoint -------------------------------------------------------------------------------------------------

    def _command(self, estimate: RangeEstimate | None) -> TurnCommand | None:
        """The turn of this step: the law's while engaged, the orbit's own while holding."""
        if self.phase is Phase.ENGAGED and estimate is not None:
            return self._steer(estimate)
        if self.phase is Phase.HOLDING:
            return limit(self.settings.orbit.steady_turn_rate, self.settings.orbit.max_turn_rate)
        return None

    def _setpoint(self, command: TurnCommand | None, now: float) -> tuple[list[Message], YawRate | None]:
        """The setpoint message of this step, if any, and the yaw rate in it."""
        if self._heartbeats_before is not None and self.session.heartbeats > self._heartbeats_before:
            self._heartbeats_before = None
        if self.settings.dry_run or self._heartbeats_before is not None:
            return self._no_setpoint(now), None
        if self.phase is Phase.LEAVING:
            return self._safe_setpoint(now), None
        if command is None:
            return [], None
        try:
            wanted = Steer(yaw_rate_from_turn_rate(command.turn_rate), self.settings.orbit.speed)
            steer = self._gate.admit(wanted, now)
            message = self._gate.check_message(
                self.adapter.setpoint(steer, self.session.vehicle, now), self.adapter.shapes
            )
        except UnsafeSetpointError as error:
            self._finish(Ending.ABORTED, f"internal error, unsafe setpoint held back: {error}", now)
            return self._safe_setpoint(now), None
        self.setpoints_sent += 1
        self._setpoint_at = now
        return [message], steer.yaw_rate

    def _safe_setpoint(self, now: float) -> list[Message]:
        """The vehicle's safe setpoint, some times over, then silence."""
        message = self._gate.check_message(self.adapter.safe_setpoint(self.session.vehicle, now), self.adapter.shapes)
        self._safe_left -= 1
        self.setpoints_sent += 1
        if self._safe_left <= 0:
            self._event(Event.SAFE_SENT, now)
        return [message]

    def _no_setpoint(self, now: float) -> list[Message]:
        """Nothing may be sent; a mission that is leaving has then left."""
        if self.phase is Phase.LEAVING:
            self._event(Event.SAFE_SENT, now)
        return []

    # --- what is told -------------------------------------------------------------------------------------------------

    def _stalled(self, now: float) -> bool:
        return self._stepped is not None and now - self._stepped > STALL

    def _range_age(self, now: float) -> float | None:
        return None if self._newest is None else now - self._newest.time

    def _say(self, kind: str, text: str) -> None:
        self.session.announcer.say(kind, text)

    def _plots(self, estimate: RangeEstimate | None, command: TurnCommand | None) -> dict[str, float]:
        """NAMED_VALUE_FLOAT names and values: range, range rate, error, yaw rate (clockwise positive)."""
        if estimate is None:
            return {}
        yaw_rate = yaw_rate_from_turn_rate(command.turn_rate) if command else 0.0
        error = estimate.r - self.settings.orbit.radius
        return {"CN_RNG": estimate.r, "CN_RRATE": estimate.r_dot, "CN_ERR": error, "CN_YRATE": yaw_rate}

    def _record(
        self, estimate: RangeEstimate | None, command: TurnCommand | None, sent: YawRate | None, now: float
    ) -> None:
        link_age = self.session.heartbeat_age(now)
        self._records.append(
            TickRecord(
                time=now,
                phase=self.phase,
                measured=self._newest.r if self._newest else None,
                r=estimate.r if estimate else None,
                r_dot=estimate.r_dot if estimate else None,
                r_sigma=estimate.r_sigma if estimate else None,
                r_dot_sigma=estimate.r_dot_sigma if estimate else None,
                nis=self.estimator.nis,
                demanded=command.demanded if command else None,
                turn_rate=command.turn_rate if command else None,
                saturated=command.saturated if command else False,
                yaw_rate_sent=sent,
                range_age=self._range_age(now),
                link_age=link_age if isfinite(link_age) else None,
                mode=self.session.mode_name,
                accepted=self.samples_accepted,
                rejected=self.ranging.rejected.total(),
            )
        )

    def _why_no_vehicle(self) -> str:
        if self.session.misfits:
            return "; ".join(self.session.misfits.values())
        return f"no autopilot heartbeat, {self.counts().describe()}"

    def _why_no_ranging(self) -> str:
        settings = self.settings.ranging
        refused = ", ".join(f"{count} {reason}" for reason, count in self.ranging.rejected.items()) or "none"
        return (
            f"no usable {RANGING_MESSAGES[settings.message].type}, samples rejected: {refused}; "
            f"{self.counts(self._ranging_link).describe()}"
        )
