"""report.html: one page about a flight. Works offline, in print, and without script (as a
picture)."""

import base64
import html
import re
from datetime import UTC, datetime
from pathlib import Path

from circnav_mav.foreign import printable
from circnav_mav.guidance.types import Orbit
from circnav_mav.pilot import OutputMode, phase_name
from circnav_mav.pilot.mission_state import Phase
from circnav_mav.report.chart_data import alarms, as_script, chart_data, known_track
from circnav_mav.report.charts import with_charts
from circnav_mav.runlog.atomic_write import write_text
from circnav_mav.runlog.events import Event, events
from circnav_mav.runlog.run_folder import Run

MOST_EVENTS = 60
"""Maximum number of events listed on the page (chosen). Of more events, the first half and the last
half of this number are listed."""
LABEL = 13
"""Width of the labels of a verdict, characters."""
OUTCOMES = {"COMPLETED": "good", "INTERRUPTED": "warn", "ENDED": "neutral"}
"""Color class of an outcome. All other outcomes are "bad"."""
PAGE = Path(__file__).with_name("report.template.html")


def write_report(
    run: Run,
    orbit: Orbit,
    circles: str,
    gate: float,
    verdict: str,
    settings: dict[str, str],
    added: str = "",
) -> Path:
    """Write report.html of a run with at least two ticks into its folder, atomically. Raises
    RunError, OSError.

    circles: description of the circles.
    gate: innovation gate, standard deviations.
    verdict: text with the outcome in its first line.
    settings: values by key.
    added: HTML of extras.
    """
    mode = next((mode for mode in OutputMode if mode.value == run.output_mode), OutputMode.FLY)
    happened = events(run)
    # The names differ if no setpoint was sent.
    names = {phase.value: phase_name(phase, mode) for phase in Phase}
    commanded = "commanded" if run.output_mode == OutputMode.FLY.value else "would command"
    data = chart_data(run.ticks, run.truth, orbit, names, gate=gate, commanded=commanded)
    outcome, _, figures = verdict.partition("\n")
    parts = {
        "TITLE": escape(run.name),
        "SUBTITLE": escape(f"{circles}. {_vehicle(run)}"),
        "OUTCOME": escape(outcome),
        "COLOUR": OUTCOMES.get(outcome.partition(":")[0], "bad"),
        "VERDICT": "".join(map(_figure, figures.splitlines())),
        "TRACK": escape(_track_words(run), quote=False),
        "PICTURE": picture(run.folder / "flight.png", "the flight"),  # for browsers without script
        "DATA": as_script(data | {"alarms": alarms(happened)}),
        "ADDED": added,
        "EVENTS": _events(happened, names),
        "SETTINGS": rows(settings),
        "VERSIONS": rows(_versions(run)),
    }
    page = with_charts(PAGE)
    # in one pass, because a part may contain text that looks like a placeholder
    page = re.sub(f"@({'|'.join(parts)})@", lambda place: parts[place[1]], page)
    path = run.folder / "report.html"
    write_text(path, page)
    return path


def escape(text: str, quote: bool = True) -> str:
    """Return text escaped for HTML, so that a browser shows it and never interprets it."""
    return html.escape(printable(text), quote)


def _figure(line: str) -> str:
    """Return a line of the verdict as HTML: its label, and its comma-separated parts, each kept on
    one line if it fits."""
    parts = "".join(f"<span>{escape(part)}</span> " for part in re.split(r"(?<=,) ", line[LABEL:]))
    label = escape(line[:LABEL].strip())
    stands_out = ' class="warning"' if label in ("WARNING", "ERROR") else ""
    return f"<dt{stands_out}>{label}</dt><dd>{parts}</dd>"


def _vehicle(run: Run) -> str:
    """Return date, autopilot and firmware of the flight."""
    autopilot = run.manifest.get("autopilot") or {}
    # The clock of a computer without network and clock battery starts at an earlier time.
    epoch_us = max(run.epoch_us, run.manifest.get("utc_epoch_us") or 0)
    when = datetime.fromtimestamp(epoch_us / 1e6, UTC)
    firmware = autopilot.get("firmware") or run.summary.get("firmware")
    return (
        f"{when:%Y-%m-%d %H:%M} UTC, {autopilot.get('name') or 'vehicle unknown'}, firmware"
        f" {firmware or 'unknown'}"
    )


def _track_words(run: Run) -> str:
    """Return the caption of the track: true, estimated or unknown."""
    track = known_track(run.ticks, run.truth)
    if track is None:
        return (
            "Position unknown: range alone does not determine it, and the run has no truth. See"
            " range over time."
        )
    words = "The simulator's truth, relative to the target. Triangle: start."
    if not track.true:
        first = f"first estimate at {track.time[track.known[0]]:.1f} s (triangle)"
        words = f"Estimated position relative to the target: {first}."
    return f"{words} Cross: target. Dashed: desired circle."


def picture(path: Path, alt: str, style: str = "") -> str:
    """Return a picture embedded as HTML, or "" if the file does not exist."""
    if not path.is_file():
        return ""
    return (
        f'<img{style} alt="{alt}"'
        f' src="data:image/png;base64,{base64.b64encode(path.read_bytes()).decode()}">'
    )


def _events(happened: list[Event], names: dict[str, str]) -> str:
    """Return HTML table rows of the events, without rejected ranges and changes of law. Above
    MOST_EVENTS, only the first and the last events are listed."""
    listed = [event for event in happened if event.kind not in ("rejected", "law")]
    rows = [
        f"<tr><td>{event.time:.1f} s</td><td>{escape(event.kind)}</td>"
        f"<td>{escape(names.get(event.text, event.text))}</td></tr>"
        for event in listed
    ]
    if len(rows) > MOST_EVENTS:
        half = MOST_EVENTS // 2
        left_out = (
            f'<tr><td></td><td></td><td class="none">{len(rows) - MOST_EVENTS} more</td></tr>'
        )
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


def rows(values: dict[str, str]) -> str:
    return "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>"
        for name, value in values.items()
    )
