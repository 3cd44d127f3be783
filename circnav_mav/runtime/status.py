"""What there is to tell of a flight at one moment, the same for the terminal and the live page."""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import takewhile
from math import atan, degrees, hypot, isfinite
from typing import NamedTuple

from circnav_mav.mav.frames import GRAVITY, compass_from_vector
from circnav_mav.mav.ranging.interface import OTHERS
from circnav_mav.pilot import VEHICLE, Ending, OutputMode, Pilot, PilotSettings, TickRecord, phase_name
from circnav_mav.pilot.authority import SILENT
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.pilot.pilot import FLOODED
from circnav_mav.runtime.onlookers import Onlooker, Onlookers

RATE_SPAN = 3.0
"""Time, s, over which rates are taken. Alarms that go by rates wait until so much is known."""
FEW_SETPOINTS = 0.5
"""Share of the setpoints of `limits.tick_hz` below which a steered vehicle gets too few."""
MOST_REJECTED = 0.5
"""Share of the ranges that may be refused before it is worth a warning."""
LOOK, MOST_ALARMS = 1.0, 1000
"""Time, s, between two looks for alarms, and how many are kept for the record."""
SILENCED = {
    OutputMode.DRY_RUN: "DRY RUN: no setpoint and no mode request is sent",
    OutputMode.SHADOW: "SHADOW: no setpoint and no mode request is sent",
}


class Rates(NamedTuple):
    """Frames received, ranges taken, ranges rejected for no reason that is shown otherwise, and setpoints sent, per
    second."""

    frames: float
    taken: float
    refused: float
    setpoints: float


@dataclass(frozen=True, slots=True)
class Status:
    """A tick and what stands round it. time: of the run, s. flown: s since engaging, None before. phase: in words,
    waits: what the vehicle is not steered for, why: why this law flies, target: where it is and what drifts,
    vehicle: what flies and its firmware, believed: who is believed, and from where, alarms: what is wrong, all for
    people. added: lines of onlookers, by their labels. rejected: ranges refused, by reason; others: those of other
    senders, harmless. A range too old to hold is none."""

    time: float
    tick: TickRecord
    flown: float | None
    phase: str
    waits: str
    why: str
    target: str
    believed: str
    alarms: tuple[str, ...]
    rejected: dict[str, int]
    others: int
    rates: Rates | None
    setpoints: int
    added: dict[str, str]
    vehicle: str


class Watch:
    """Looks at a pilot from time to time and remembers enough to tell rates."""

    def __init__(self, pilot: Pilot, onlookers: Onlookers) -> None:
        self._pilot, self._onlookers = pilot, onlookers
        self._seen: deque[tuple[float, Rates]] = deque()
        self._steered_since: float | None = None

    def status(self, tick: TickRecord, now: float, problem: str | None = None) -> Status:
        """The status with this newest tick. problem: what is wrong with the recording."""
        pilot, rates, timing = self._pilot, self._rates(now), self._pilot.settings.timing
        whole = rates if now - self._seen[0][0] >= RATE_SPAN else None
        if not pilot.mission.steering:
            self._steered_since = None
        elif self._steered_since is None:
            self._steered_since = now
        steered = 0.0 if self._steered_since is None else now - self._steered_since
        alarms = _alarms(pilot, tick, now, whole)
        alarms += _few_setpoints(pilot, whole) if steered > RATE_SPAN else []
        alarms += self._onlookers.alarms(now)
        if problem is not None:
            alarms.append(f"NOT RECORDING: {problem}")
        lost = timing.stale if tick.x is None else timing.stale + timing.hold
        if tick.range_age is not None and tick.range_age > lost:
            # A prediction from the range alone flies straight on, and the vehicle does not. By the relative motion it
            # follows the vehicle, for as long as that holds the turn.
            tick = tick._replace(r=None, r_dot=None, r_sigma=None, r_dot_sigma=None)
        return Status(
            time=now,
            tick=tick,
            flown=None if pilot.mission.engaged_at is None else now - pilot.mission.engaged_at,
            phase=phase_name(tick.phase, pilot.settings.output_mode),
            waits=pilot.status.waits_for(now),
            why=pilot.why if tick.law else "",
            target=_target(tick),
            believed=pilot.believed,
            added=self._onlookers.facts(now),
            alarms=tuple(alarms),
            rejected={why: count for why, count in pilot.tracker.ranging.rejected.most_common() if why not in OTHERS},
            others=sum(pilot.tracker.ranging.rejected[why] for why in OTHERS),
            rates=rates,
            setpoints=pilot.setpoints_sent,
            vehicle=_vehicle(pilot),
        )

    def _rates(self, now: float) -> Rates | None:
        pilot, seen = self._pilot, self._seen
        frames, tracker = pilot.connection.counts[VEHICLE].frames, pilot.tracker
        counts = Rates(frames, tracker.accepted, tracker.ranging.unexplained, pilot.setpoints_sent)
        seen.append((now, counts))
        while len(seen) > 2 and now - seen[1][0] >= RATE_SPAN:
            seen.popleft()
        then, before = seen[0]
        span = now - then
        if span <= 0:
            return None
        return Rates(*((count - earlier) / span for count, earlier in zip(counts, before, strict=True)))


class Begun:
    """Which alarms are new each time; one whose numbers change goes on."""

    def __init__(self) -> None:
        self._standing: set[str] = set()

    def of(self, alarms: Iterable[str]) -> list[str]:
        """Those of these that did not stand the last time."""
        kinds = {kind(alarm): alarm for alarm in alarms}
        begun = [alarm for name, alarm in kinds.items() if name not in self._standing]
        self._standing = set(kinds)
        return begun


class AlarmLog(Onlooker):
    """The alarms of a flight for its record, each once as it begins."""

    name = "alarms"

    def __init__(self, pilot: Pilot, onlookers: Onlookers) -> None:
        self.begun: list[tuple[float, str]] = []
        """Time of the run, s, and words."""
        self._watch, self._news, self._due = Watch(pilot, onlookers), Begun(), 0.0

    def on_step(self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None) -> Sequence[bytes]:
        """Look for new ones when it is time."""
        now = step.time
        if newest is not None and now >= self._due:
            self._due = now + LOOK
            begun = self._news.of(self._watch.status(newest, now, recording_problem).alarms)
            self.begun += [(now, alarm) for alarm in begun[: MOST_ALARMS - len(self.begun)]]
        return ()


def kind(text: str) -> str:
    """What a text is about: its words without its numbers, which change all the time."""
    return "".join(takewhile(lambda letter: not letter.isdecimal(), text))


def shown(value: float | None, form: str) -> str:
    """A number in a form such as "{:.2f} m", "-" for none."""
    return "-" if value is None else form.format(value)


def told(status: Status, settings: PilotSettings, most_reasons: int | None = None) -> dict[str, str]:
    """The facts of a status in words, by what they are called; "-" where nothing is known. flown: empty before it
    engages. most_reasons: how many of the reasons for which ranges were rejected are named; None: all."""
    tick, timing, orbit = status.tick, settings.timing, settings.orbit
    frames, accepted, _, setpoints = (shown(rate, "{:.1f}/s") for rate in status.rates or (None,) * 4)
    range_age, link_age = (shown(age, "{:.2f} s") for age in (tick.range_age, tick.link_age))
    duration = f" of {timing.duration:.0f} s" if isfinite(timing.duration) else ""
    desired = tick.desired or orbit.radius
    measured = "" if tick.measured_rate is None else f"   measured {tick.measured_rate:+.2f} m/s"
    turn = shown(None if tick.turn_rate is None else degrees(tick.turn_rate), "{:+.1f}")
    at_limit = "   AT ITS LIMIT" if tick.saturated else ""
    refused = sum(status.rejected.values())
    reasons = [f"{count} {reason}" for reason, count in status.rejected.items()]
    more = ", ..." if len(reasons[:most_reasons]) < len(reasons) else ""
    why = f": {', '.join(reasons[:most_reasons])}{more}" if reasons else ""
    others = f"; {status.others} of other senders" if status.others else ""
    return {
        "vehicle": status.vehicle,
        "flown": "" if status.flown is None else f"flown {status.flown:.0f} s{duration}",
        "range": f"{_with_sigma(tick.r, tick.r_sigma, '.2f', 'm')} horizontal   desired {desired:.1f} m",
        "error": shown(None if tick.r is None else tick.r - desired, "{:+.2f} m"),
        "range rate": _with_sigma(tick.r_dot, tick.r_dot_sigma, "+.2f", "m/s") + measured,
        "turn rate": f"commanded {turn} deg/s (limit {degrees(orbit.max_turn_rate):.1f}), "
        f"gain {tick.turn_gain:.2f}, delay {tick.turn_delay:.2f} s{at_limit}",
        "heading": shown(None if tick.heading is None else degrees(tick.heading) % 360, "{:03.0f} deg"),
        "law": status.why or tick.law or "-",
        "waiting": status.waits or "-",
        "target": status.target,
        **status.added,
        "ranging": f"{accepted} accepted, newest {range_age} old, stale at {timing.stale:.2f} s",
        "rejected": f"{refused} of {refused + tick.accepted}{why}{others}",
        "link": f"{frames} frames, heartbeat {link_age} old  {status.believed}",
        "setpoints": f"{setpoints}, {status.setpoints} total",
    }


def _with_sigma(value: float | None, sigma: float | None, form: str, unit: str) -> str:
    if value is None:
        return "-"
    return f"{value:{form}} {unit}" if sigma is None else f"{value:{form}} {unit} ± {sigma:.2f} {unit}"


def _alarms(pilot: Pilot, tick: TickRecord, now: float, rates: Rates | None) -> list[str]:
    """What is wrong now, the worst first."""
    timing, found = pilot.settings.timing, pilot.session.identity.rivals.recent(now)
    if now - pilot.allowance.dropped_at < FLOODED:
        found.append(f"FLOOD: what others send is not read, {pilot.allowance.dropped / 1000:.0f} kB so far")
    if second := pilot.second_controller(now):
        found.append(f"SECOND CONTROLLER: {second}: stop the other program")
    if pilot.mission.outcome is not None and pilot.mission.outcome.ending is not Ending.COMPLETED:
        found.append(f"{pilot.mission.outcome.ending.value.upper()}: {pilot.mission.outcome.reason}")
    elif tick.phase is Phase.YIELDED:
        found.append(f"OPERATOR HAS THE VEHICLE, mode {tick.mode}")
    if tick.phase is not Phase.ENDED:
        if tick.link_age is not None and tick.link_age > SILENT:
            found.append(f"LINK SILENT for {tick.link_age:.1f} s")
        if tick.range_age is not None and tick.range_age > timing.stale:
            flows = "" if rates is None else f" by {rates.setpoints:.0f} setpoints per second"
            patience = f": holding the circle's turn rate{flows}, ends at {timing.stale + timing.hold:g} s"
            found.append(f"RANGE STALE {tick.range_age:.1f} s{patience if tick.phase is Phase.HOLDING else ''}")
        if frozen := pilot.tracker.noise.repeated:
            found.append(f"RANGE FROZEN: the same number for {frozen:.0f} s, ranges are rejected until it changes")
        if wrong := pilot.tracker.rates.trouble:
            found.append(f"RANGE RATE DROPPED: {wrong}")
        if not pilot.controller.turns.follows and pilot.mission.steering:
            found.append(f"VEHICLE DOES NOT FOLLOW turn commands: ends after {timing.unfollowed:g} s")
        if tick.gain_share < 1:
            found.append(f"LIMIT CYCLE: the turn swings, gains reduced to {100 * tick.gain_share:.0f} %")
        if (lean := pilot.controller.lean).share < 1:
            angle, V = degrees(atan(lean.found / GRAVITY)), pilot.settings.orbit.speed
            words = f"the copter leans {angle:.0f} deg at most, too little for {V:g} m/s in this wind"
            found.append(f"LEAN LIMIT: {words}: speed {pilot.controller.speed:.1f} m/s")
        if pilot.drift_alarm.on:
            found.append(f"DRIFT TOO STRONG: {pilot.drift_alarm.text}")
        if pilot.unwatched:
            found.append(f"BOUND NOT WATCHED: {pilot.unwatched}")
        if rates is not None and rates.refused > MOST_REJECTED * (rates.taken + rates.refused):
            found.append(f"MOST RANGES REJECTED: {rates.refused:.1f} of {rates.taken + rates.refused:.1f} per second")
        if pilot.tracker.ranging.clock.doubted:
            found.append("SENSOR CLOCK stepped: ranges are rejected until it runs steadily again")
        if (speed := pilot.session.clock_speed.found) is not None:
            cure = 'for a simulator set link.clock = "autopilot"'
            found.append(f"CLOCK: autopilot time runs {speed:.2g} times as fast as ours: {cure}")
        if trouble := pilot.tracker.height.trouble(now):
            found.append(trouble)
    return found


def _few_setpoints(pilot: Pilot, rates: Rates | None) -> list[str]:
    """The alarm of a vehicle that is steered by fewer setpoints than it should get: an overloaded computer."""
    wanted = 1 / pilot.settings.timing.tick
    if rates is None or pilot.settings.output_mode is not OutputMode.FLY or rates.setpoints >= FEW_SETPOINTS * wanted:
        return []
    cure = "the computer is overloaded, stop other programs or lower limits.tick_hz"
    return [f"FEW SETPOINTS: {rates.setpoints:.1f} of {wanted:.0f} per second are sent: {cure}"]


def _vehicle(pilot: Pilot) -> str:
    """What flies, as far as it has said."""
    session = pilot.session
    name = session.adapter.name if session.up else "vehicle not known"
    return f"{name}, firmware {session.vehicle.firmware or 'not known'}"


def _target(tick: TickRecord) -> str:
    """Where the target is, seen from the vehicle, and the drift: clockwise from north, where they are known."""
    if tick.x is None or tick.y is None or tick.drift_x is None or tick.drift_y is None:
        return "bearing not known"
    bearing = degrees(compass_from_vector(-tick.x, -tick.y))
    towards = degrees(compass_from_vector(tick.drift_x, tick.drift_y))
    drift = hypot(tick.drift_x, tick.drift_y)
    felt = ", by accelerations" if tick.felt is not None and tick.felt > 0.5 else ""
    return f"bearing {bearing:03.0f} deg, drift {drift:.1f} m/s towards {towards:03.0f} deg{felt}"
