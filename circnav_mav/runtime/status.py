"""Status of a flight at one moment, shared by the terminal and the live page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from math import degrees, hypot, isfinite

from circnav_mav.mav.frames import compass_from_vector
from circnav_mav.mav.ranging.interface import OTHERS
from circnav_mav.pilot import OutputMode, Pilot, TickRecord, phase_name
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.pilot.step_view import StepView
from circnav_mav.runtime.listeners import Listener, Listeners
from circnav_mav.timers import Every

LOOK = 1.0
"""Interval of the check for new alarms, s."""
MOST_ALARMS = 1000
"""Largest number of recorded alarms."""
SILENCED = {
    OutputMode.DRY_RUN: "DRY RUN: no setpoint and no mode request is sent",
    OutputMode.SHADOW: "SHADOW: no setpoint and no mode request is sent",
}


@dataclass(frozen=True, slots=True)
class Status:
    """Newest step and the state around it. Texts are human-readable.

    time: run time, s.
    view: newest step.
    tick: record of this step, with None as range if the newest range is too old for coasting.
    flown: time since the first engagement, s, None before it.
    phase: name of the phase.
    why: reason for the active law.
    target: bearing of the target, and drift.
    conditions: alarms by name of condition.
    rejected: rejected ranges by reason.
    others: number of ignored ranges of other sensors.
    added: lines of listeners, by label.
    """

    time: float
    view: StepView
    tick: TickRecord
    flown: float | None
    phase: str
    why: str
    target: str
    conditions: dict[str, str]
    rejected: dict[str, int]
    others: int
    added: dict[str, str]

    @property
    def alarms(self) -> tuple[str, ...]:
        """Texts of the alarms, the worst first."""
        return tuple(self.conditions.values())


class StatusSource:
    """Source of statuses of `Pilot` and its listeners."""

    def __init__(self, pilot: Pilot, listeners: Listeners) -> None:
        self._pilot = pilot
        self._listeners = listeners

    def status(self, tick: TickRecord, now: float, problem: str | None = None) -> Status:
        """Return the status.

        tick: newest tick.
        now: run time, s.
        problem: recording problem, or None.
        """
        view = self._pilot.view
        assert view is not None, "no step yet, and so no tick"
        conditions = self._pilot.conditions.alarms | self._listeners.alarms(now)
        if problem is not None:
            conditions["not_recording"] = f"NOT RECORDING: {problem}"
        stale = view.settings.stale
        lost = stale if tick.x is None else stale + view.coast
        if tick.range_age is not None and tick.range_age > lost:
            # Without an estimate of the relative motion, the predicted range continues linearly
            # while the vehicle turns: show no range. With this estimate, the prediction follows the
            # vehicle during COASTING.
            tick = replace(tick, r=None, r_dot=None, r_sigma=None, r_dot_sigma=None)
        return Status(
            time=now,
            view=view,
            tick=tick,
            flown=None if view.engaged_at is None else now - view.engaged_at,
            phase=phase_name(tick.phase, view.output_mode),
            why=view.why if tick.law else "",
            target=_target(tick),
            conditions=conditions,
            rejected={why: count for why, count in view.rejected_by.items() if why not in OTHERS},
            others=sum(count for why, count in view.rejected_by.items() if why in OTHERS),
            added=self._listeners.facts(now),
        )


class NewAlarms:
    """Filter for new alarms. An alarm in which only numbers have changed is not new."""

    def __init__(self) -> None:
        self._standing: set[str] = set()

    def of(self, alarms: Mapping[str, str]) -> dict[str, str]:
        """Return the alarms, by name, that were not active at the last call."""
        begun = {name: text for name, text in alarms.items() if kind(text) not in self._standing}
        self._standing = set(map(kind, alarms.values()))
        return begun


class AlarmLog(Listener):
    """Records each alarm of a flight once, when it begins."""

    name = "alarms"

    def __init__(self, pilot: Pilot, listeners: Listeners) -> None:
        self.begun: list[dict[str, float | str]] = []
        """Alarms as stored in summary.json."""
        self._watch = StatusSource(pilot, listeners)
        self._news = NewAlarms()
        self._check_timer = Every(LOOK)

    def on_step(
        self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None
    ) -> Sequence[bytes]:
        """Record new alarms if a check is due."""
        now = step.time
        if newest is not None and self._check_timer.due(now):
            begun = self._news.of(self._watch.status(newest, now, recording_problem).conditions)
            for name, text in list(begun.items())[: MOST_ALARMS - len(self.begun)]:
                self.begun.append({"time_s": round(now, 1), "name": name, "text": text})
        return ()


def kind(text: str) -> str:
    """Return a text up to its first digit. Texts that differ only in numbers are of the same
    kind."""
    return "".join(takewhile(lambda letter: not letter.isdecimal(), text))


def shown(value: float | None, form: str, unknown: str = "-") -> str:
    """Return the text of a number, or `unknown` for None.

    form: text with a place for the number, for example "range {:.2f} m".
    """
    return unknown if value is None else form.format(value)


def in_degrees(angle: float | None) -> float | None:
    """Return an angle in degrees, None for None."""
    return None if angle is None else degrees(angle)


def status_facts(status: Status, most_reasons: int | None = None) -> dict[str, str]:
    """Return the facts of a status as texts, by label. Unknown values are "-". A text that does not
    apply is empty: `flown` before engaging, `waiting` while the vehicle is steered.
    most_reasons: maximum number of rejection reasons listed, None for all."""
    tick = status.tick
    view = status.view
    flight_time = view.settings.file.limits.duration_s
    orbit = view.settings.orbit
    # After the flight there are no rates. The texts then omit them.
    frames, accepted, _, setpoints = view.rates or (None,) * 4
    duration = f" of {flight_time:.0f} s" if isfinite(flight_time) else ""
    measured = shown(tick.measured_rate, ", measured {:+.2f} m/s", "")
    turn = shown(in_degrees(tick.turn_rate), "commanded {:+.1f} deg/s", "none commanded")
    heading = in_degrees(tick.heading)
    limit = (
        "AT LIMIT" if tick.saturated else "limit"
    )  # near the front, so that a narrow terminal shows it
    return {
        "vehicle": view.vehicle,
        "flown": shown(status.flown, f"flown {{:.0f}} s{duration}", ""),
        "range": _with_sigma(tick.r, tick.r_sigma, ".2f", "m")
        + f" horizontal, desired {tick.desired:.1f} m",
        "error": shown(None if tick.r is None else tick.r - tick.desired, "{:+.2f} m"),
        "range rate": _with_sigma(tick.r_dot, tick.r_dot_sigma, "+.2f", "m/s") + measured,
        "turn rate": (
            f"{turn} ({limit} {degrees(orbit.max_turn_rate):.1f}), "
            f"gain {tick.turn_gain:.2f}, delay {tick.turn_delay:.2f} s"
        ),
        "heading": shown(None if heading is None else heading % 360, "{:03.0f} deg"),
        "law": status.why or tick.law or "none",
        "waiting": view.waits,
        "target": status.target,
        **status.added,
        "ranging": _listed(
            shown(accepted, "{:.1f}/s accepted", ""),
            shown(tick.range_age, "newest {:.2f} s old", "no range yet"),
            f"stale at {view.settings.stale:.2f} s",
        ),
        "rejected": _rejections(status, most_reasons),
        "link": _listed(
            shown(frames, "{:.1f}/s frames", ""),
            shown(tick.link_age, "heartbeat {:.2f} s old", "no heartbeat yet"),
        ),
        "senders": view.trusted,
        "setpoints": _listed(shown(setpoints, "{:.1f}/s", ""), f"{view.setpoints} total"),
    }


def _rejections(status: Status, most_reasons: int | None) -> str:
    """Return the number of rejected ranges, with the reasons."""
    refused = sum(status.rejected.values())
    reasons = [f"{count} {reason}" for reason, count in status.rejected.items()]
    more = ", ..." if len(reasons[:most_reasons]) < len(reasons) else ""
    why = f": {', '.join(reasons[:most_reasons])}{more}" if reasons else ""
    others = f"; {status.others} of other senders" if status.others else ""
    return f"{refused} of {refused + status.tick.accepted}{why}{others}"


def _listed(*parts: str) -> str:
    return ", ".join(filter(None, parts))


def _with_sigma(value: float | None, sigma: float | None, form: str, unit: str) -> str:
    if value is None:
        return "-"
    return (
        f"{value:{form}} {unit}" if sigma is None else f"{value:{form}} {unit} ± {sigma:.2f} {unit}"
    )


def _target(tick: TickRecord) -> str:
    """Return the bearing of the target and the direction of the drift, both clockwise from north,
    if they are estimated."""
    if tick.x is None or tick.y is None or tick.drift_x is None or tick.drift_y is None:
        return "bearing unknown"
    bearing = degrees(compass_from_vector(-tick.x, -tick.y))
    towards = degrees(compass_from_vector(tick.drift_x, tick.drift_y))
    drift = hypot(tick.drift_x, tick.drift_y)
    source = (
        ", by accelerometer"
        if tick.acceleration_weight is not None and tick.acceleration_weight > 0.5
        else ""
    )
    return f"bearing {bearing:03.0f} deg, drift {drift:.1f} m/s towards {towards:03.0f} deg{source}"
