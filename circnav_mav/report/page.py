"""report.html: one page that tells a flight, without network, that prints."""

import re
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from circnav_mav.guidance.types import Orbit
from circnav_mav.pilot import OutputMode, phase_name
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.report import svg
from circnav_mav.report.segments import fresh, known_track
from circnav_mav.report.svg import Chart, Line
from circnav_mav.runlog.atomic_write import write_whole
from circnav_mav.runlog.events import events
from circnav_mav.runlog.metrics import TOLERANCE
from circnav_mav.runlog.run import Run
from circnav_mav.runlog.run_folder import Column, Ticks, Truth

ESTIMATE, MEASURED, TRUE, DESIRED, LIMIT, REJECTED = "#1f5fa8", "#9fb3cc", "#c8501e", "#2e7d32", "#777", "#c62828"
PHASES = {
    "waiting for the link": "#b0bec5", "waiting for ranging": "#90a4ae", "ready": "#ffe082", "engaged": "#66bb6a",
    "holding": "#ffa726", "yielded": "#ba68c8", "leaving": "#4fc3f7", "ended": "#455a64",
}  # fmt: skip
GOOD = "#81c784"
LAWS = {"feedforward": "#64b5f6", "trial": "#ffd54f", "drift": GOOD}
MODES = {
    "GUIDED": GOOD, "OFFBOARD": GOOD, "LOITER": "#64b5f6", "AUTO.LOITER": "#64b5f6", "RTL": "#9575cd",
    "AUTO.RTL": "#9575cd", "LAND": "#4db6ac", "AUTO.LAND": "#4db6ac", "ALTCTL": "#aed581", "unknown": "#b0bec5",
}  # fmt: skip
OTHERS = ("#ffd54f", "#f48fb1", "#a1887f", "#4fc3f7", "#dce775", "#7986cb")
"""Of modes and laws that have no colour of their own, in the order in which they come; none is the red of refusals."""
MOST_EVENTS = 60
PAGE = Path(__file__).with_name("report.template.html")


@dataclass(frozen=True, slots=True)
class ReportFacts:
    """What the report cannot read from the run's files. gate: of the innovations, standard deviations. settings: the
    mission's values as used, by their keys."""

    orbit: Orbit
    gate: float
    verdict: str
    settings: dict[str, str]


def report(run: Run, facts: ReportFacts) -> str:
    """The page of a run with at least two ticks. Raises RunError, OSError."""
    ticks, truth = run.ticks, run.truth
    span = (float(ticks.time[0]), float(ticks.time[-1]))
    names, sent = _phase_names(run), run.voice == OutputMode.FLY.value
    charts = [
        svg.spans_chart(
            "phase",
            ticks.time,
            [names.get(phase, phase) for phase in ticks.phases],
            {names.get(phase, phase): colour for phase, colour in PHASES.items()},
            span,
        ),
        *(chart.draw(span) for chart in _charts(ticks, truth, facts, "commanded" if sent else "would command")),
        svg.bars_chart("ranges", "1/s", _samples(ticks), span),
        svg.spans_chart("vehicle mode", ticks.time, ticks.modes, _colours(ticks.modes, MODES), span),
    ]
    laws = ticks.words.get("law", [])
    if len(set(laws) - {""}) > 1:
        charts.append(svg.spans_chart("law", ticks.time, laws, _colours(laws, LAWS), span))
    parts = {
        "TITLE": escape(run.name),
        "SUBTITLE": escape(_circle(facts.orbit)),
        "VERDICT": "".join(f"<div>{escape(line)}</div>" for line in facts.verdict.splitlines()),
        "TRACK": _track(ticks, truth, facts.orbit),
        "CHARTS": "".join(charts),
        "EVENTS": _events(run),
        "SETTINGS": _rows(facts.settings),
        "VERSIONS": _rows(_versions(run)),
    }
    page = PAGE.read_text(encoding="utf-8")
    return re.sub(f"@({'|'.join(parts)})@", lambda place: parts[place[1]], page)  # at once: parts may look like places


def write_report(run: Run, facts: ReportFacts) -> Path:
    """Write report.html into the run folder, whole or not at all. Raises RunError, OSError."""
    path = run.folder / "report.html"
    write_whole(path, report(run, facts))
    return path


def _charts(ticks: Ticks, truth: Truth | None, facts: ReportFacts, commanded: str) -> list[Chart]:
    orbit, numbers, time = facts.orbit, ticks.numbers, ticks.time
    band = TOLERANCE * orbit.radius
    true_range = [Line("true", truth.time, truth.radius, TRUE)] if truth else []
    true_error = [Line("true", truth.time, truth.radius - orbit.radius, TRUE)] if truth else []
    limit = float(np.degrees(orbit.max_turn_rate))
    turned = [Line("true", truth.time, -np.degrees(truth.turn_rate), TRUE)] if truth else []
    new = fresh(ticks)
    measured, innovation = numbers["measured"][new], np.sqrt(numbers["nis"][new])
    return [
        Chart("range", "m", [Line("measured", time[new], measured, MEASURED, dots=True),
                             Line("estimated", time, numbers["r"], ESTIMATE), *true_range],
              levels=[("desired", orbit.radius, DESIRED)]),
        Chart("error, range - radius", f"m, band +-{100 * TOLERANCE:.0f} %, shown up to +-{3 * band:g} m",
              [Line("estimated", time, numbers["r"] - orbit.radius, ESTIMATE), *true_error],
              band=(-band, band), shown=(-3 * band, 3 * band)),
        Chart("range rate", "m/s", [_other_rate(ticks, truth), Line("estimated", time, numbers["r_dot"], ESTIMATE)]),
        Chart("turn rate, left positive", "deg/s",
              [*turned, Line(commanded, time, np.degrees(numbers["turn_rate"]), ESTIMATE)],
              levels=[("limit", limit, LIMIT), ("", -limit, LIMIT),
                      ("steady circle", float(np.degrees(orbit.steady_turn_rate)), DESIRED)]),
        Chart("innovation", "standard deviations",
              [Line("of each new range", time[new], innovation, ESTIMATE, dots=True)],
              levels=[("gate", facts.gate, REJECTED)], shown=(0.0, 1.6 * facts.gate), height=130),
    ]  # fmt: skip


def _other_rate(ticks: Ticks, truth: Truth | None) -> Line:
    """What the estimate is compared with: the truth's rate, or the measured ranges differenced over about a second."""
    if truth is not None:
        rising = np.diff(truth.sim_time, prepend=-np.inf) > 0
        if rising.sum() > 1:
            rate = np.gradient(truth.radius[rising], truth.sim_time[rising])
            return Line("true", truth.time[rising], rate, TRUE)
    fresh = np.flatnonzero(np.diff(ticks.numbers["measured"], prepend=np.nan) != 0)
    time, measured = ticks.time[fresh], ticks.numbers["measured"][fresh]
    before = np.searchsorted(time, time - 1.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        rate = (measured - measured[before]) / (time - time[before])
    return Line("differenced over 1 s", time, np.where(np.isfinite(rate), rate, np.nan), MEASURED)


def _samples(ticks: Ticks) -> list[tuple[str, Column, str]]:
    """Moments at which ranges were taken and refused."""

    def moments(column: str) -> Column:
        steps = np.diff(ticks.numbers[column], prepend=0.0)
        return np.repeat(ticks.time, np.clip(np.nan_to_num(steps), 0, 1000).astype(int))

    return [("taken", moments("accepted"), MEASURED), ("rejected", moments("rejected"), REJECTED)]


def _track(ticks: Ticks, truth: Truth | None, orbit: Orbit) -> str:
    """Where it flew round the target, as far as anybody knows."""
    track = known_track(ticks, truth)
    if track is None:
        return (
            '<p class="none">Range alone does not tell where it flew, and there is no truth: see range over time.</p>'
        )
    if track.true:
        words, colour = "The simulator's truth, relative to the target. Triangle: start.", TRUE
    else:
        first = f"first believed at {track.time[track.known[0]]:.1f} s (triangle)"
        words, colour = f"Estimated position relative to the target, where it was known: {first}.", ESTIMATE
    drawn = svg.track(track.east, track.north, orbit.radius, colour, whole=track.true)
    return f"{drawn}<p>{words} Cross: target. Dashed: desired circle.</p>"


def _phase_names(run: Run) -> dict[str, str]:
    """The phases as they are called where nothing was sent, too."""
    mode = next((mode for mode in OutputMode if mode.value == run.voice), OutputMode.FLY)
    return {phase.value: phase_name(phase, mode) for phase in Phase}


def _events(run: Run) -> str:
    """What happened, refused ranges left to their chart; of very much the beginning and the end."""
    names = _phase_names(run)
    told = [event for event in events(run) if event.kind not in ("rejected", "law")]
    rows = [
        f"<tr><td>{event.time:.1f} s</td><td>{escape(event.kind)}</td>"
        f"<td>{escape(names.get(event.text, event.text))}</td></tr>"
        for event in told
    ]
    if len(rows) > MOST_EVENTS:
        half = MOST_EVENTS // 2
        left_out = f'<tr><td></td><td></td><td class="none">{len(rows) - MOST_EVENTS} more</td></tr>'
        rows = [*rows[:half], left_out, *rows[-half:]]
    return "".join(rows)


def _versions(run: Run) -> dict[str, str]:
    manifest = run.manifest
    found = {name: str(number) for name, number in (manifest.get("versions") or {}).items()}
    autopilot = manifest.get("autopilot") or {}
    found |= {f"autopilot {name}": str(value) for name, value in autopilot.items()}
    found |= {f"seed {name}": str(value) for name, value in (manifest.get("seeds") or {}).items()}
    ended = manifest.get("exit")
    return found | {"exit code": "none, the process was killed" if ended is None else str(ended)}


def _rows(values: dict[str, str]) -> str:
    return "".join(f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>" for name, value in values.items())


def _colours(words: list[str], own: dict[str, str]) -> dict[str, str]:
    """A colour for each word, the same in every report for those that have one of their own."""
    rest = [word for word in dict.fromkeys(words) if word and word not in own]
    return own | {word: OTHERS[at % len(OTHERS)] for at, word in enumerate(rest)} | {"": "#eee"}


def _circle(orbit: Orbit) -> str:
    return f"{orbit.radius:g} m {orbit.direction.value} at {orbit.speed:g} m/s"
