"""What there is to tell of a flight at one moment, the same for the terminal and the live page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from math import degrees, hypot, isfinite

from circnav_mav.mav.frames import compass_from_vector
from circnav_mav.mav.ranging.interface import OTHERS
from circnav_mav.pilot import OutputMode, Pilot, PilotSettings, TickRecord, phase_name
from circnav_mav.pilot.conditions import NOT_RECORDING
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.pilot.rates import Rates
from circnav_mav.runtime.onlookers import Onlooker, Onlookers

LOOK, MOST_ALARMS = 1.0, 1000
"""Time, s, between two looks for alarms, and how many are kept for the record."""
SILENCED = {
    OutputMode.DRY_RUN: "DRY RUN: no setpoint and no mode request is sent",
    OutputMode.SHADOW: "SHADOW: no setpoint and no mode request is sent",
}


@dataclass(frozen=True, slots=True)
class Status:
    """A tick and what stands round it. time: of the run, s. flown: s since engaging, None before. phase: in words,
    waits: what the vehicle is not steered for, why: why this law flies, target: where it is and what drifts,
    vehicle: what flies and its firmware, believed: who is believed, and from where, conditions: alarms by the names of
    `pilot.conditions`, all human-readable. added: lines of onlookers, by their labels. rejected: ranges rejected, by
    reason; others: those of other senders, harmless. A range too old to hold is none."""

    time: float
    tick: TickRecord
    flown: float | None
    phase: str
    waits: str
    why: str
    target: str
    believed: str
    conditions: dict[str, str]
    rejected: dict[str, int]
    others: int
    rates: Rates | None
    setpoints: int
    added: dict[str, str]
    vehicle: str

    @property
    def alarms(self) -> tuple[str, ...]:
        """The texts of the alarms, the worst first."""
        return tuple(self.conditions.values())


class Watch:
    """Makes the statuses of a pilot and its onlookers."""

    def __init__(self, pilot: Pilot, onlookers: Onlookers) -> None:
        self._pilot, self._onlookers = pilot, onlookers

    def status(self, tick: TickRecord, now: float, problem: str | None = None) -> Status:
        """The status with this newest tick. problem: what is wrong with the recording."""
        pilot, timing = self._pilot, self._pilot.settings.timing
        conditions = pilot.conditions.alarms | self._onlookers.alarms(now)
        if problem is not None:
            conditions |= NOT_RECORDING.alarm(problem=problem)
        lost = timing.stale if tick.x is None else timing.stale + pilot.mission.hold
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
            conditions=conditions,
            rejected={why: count for why, count in pilot.tracker.ranging.rejected.most_common() if why not in OTHERS},
            others=sum(pilot.tracker.ranging.rejected[why] for why in OTHERS),
            rates=None if pilot.done else pilot.rates.newest,
            setpoints=pilot.setpoints_sent,
            vehicle=_vehicle(pilot),
        )


class Begun:
    """Finds alarms that are new. One of which only numbers change goes on."""

    def __init__(self) -> None:
        self._standing: set[str] = set()

    def of(self, alarms: Mapping[str, str]) -> dict[str, str]:
        """Return the alarms, by name, that were not there the last time."""
        begun = {name: text for name, text in alarms.items() if kind(text) not in self._standing}
        self._standing = set(map(kind, alarms.values()))
        return begun


class AlarmLog(Onlooker):
    """The alarms of a flight for its record, each once as it begins."""

    name = "alarms"

    def __init__(self, pilot: Pilot, onlookers: Onlookers) -> None:
        self.begun: list[dict[str, float | str]] = []
        """As in summary.json."""
        self._watch, self._news, self._due = Watch(pilot, onlookers), Begun(), 0.0

    def on_step(self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None) -> Sequence[bytes]:
        """Look for new ones when it is time."""
        now = step.time
        if newest is not None and now >= self._due:
            self._due = now + LOOK
            begun = self._news.of(self._watch.status(newest, now, recording_problem).conditions)
            for name, text in list(begun.items())[: MOST_ALARMS - len(self.begun)]:
                self.begun.append({"time_s": round(now, 1), "name": name, "text": text})
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
