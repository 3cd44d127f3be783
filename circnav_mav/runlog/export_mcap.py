"""A run as one MCAP file with JSON messages, for Foxglove and PlotJuggler: /ticks, /truth and /events.

Needs the package `mcap` (extra [mcap]). Times are the wall clock's of the flight. A value that is not known is left out
of its message.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from circnav_mav.runlog.atomic_write import atomic_write
from circnav_mav.runlog.events import Event, events
from circnav_mav.runlog.run_folder import Run
from circnav_mav.runlog.ticks import Ticks, Truth

Row = tuple[float, dict[str, Any]]
TRUTH_COLUMNS = ("time", "north", "east", "target_north", "target_east", "radius", "turn_rate")
LOG_SCHEMA = {
    "type": "object",
    "properties": {
        "timestamp": {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}},
        "level": {"type": "integer"},
        "name": {"type": "string"},
        "message": {"type": "string"},
        "file": {"type": "string"},
        "line": {"type": "integer"},
    },
}
"""foxglove.Log: the log panel shows it."""
LOG_INFO, LOG_WARNING = 2, 3


def export_mcap(run: Run, path: Path) -> dict[str, int]:
    """Write the file, whole or not at all; returns the messages per topic. Raises ImportError without mcap, RunError,
    OSError."""
    from mcap.writer import Writer

    topics: list[tuple[str, str, dict[str, Any], Iterator[Row]]] = [
        ("/ticks", "circnav.Tick", _schema(run.ticks.numbers, run.ticks.words), _tick_rows(run.ticks)),
        ("/events", "foxglove.Log", LOG_SCHEMA, _event_rows(events(run), run.epoch_us)),
    ]
    if run.truth is not None:
        topics.append(("/truth", "circnav.Truth", _schema(TRUTH_COLUMNS, ()), _truth_rows(run.truth)))
    counts = {}
    with atomic_write(path.resolve()) as fresh, fresh.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library=f"circnav {run.manifest.get('versions', {}).get('circnav', '')}".strip())
        for topic, name, schema, rows in topics:
            schema_id = writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
            channel = writer.register_channel(topic, "json", schema_id)
            counts[topic] = 0
            for time, row in rows:
                moment = run.epoch_us * 1000 + round(time * 1e6) * 1000
                writer.add_message(channel, moment, json.dumps(row).encode(), moment)
                counts[topic] += 1
        writer.add_metadata("manifest", {key: json.dumps(value) for key, value in run.manifest.items()})
        writer.add_attachment(
            create_time=run.epoch_us * 1000, log_time=run.epoch_us * 1000, name="mission.toml",
            media_type="text/plain", data=run.mission_text.encode(),
        )  # fmt: skip
        writer.finish()  # type: ignore[no-untyped-call]
    return counts


def _schema(numbers: Any, words: Any) -> dict[str, Any]:
    properties = {name: {"type": "number"} for name in numbers} | {name: {"type": "string"} for name in words}
    return {"type": "object", "properties": properties}


def _tick_rows(ticks: Ticks) -> Iterator[Row]:
    names = list(ticks.numbers)
    table = np.column_stack([ticks.numbers[name] for name in names])
    words = zip(*ticks.words.values(), strict=True)
    for values, said in zip(table.tolist(), words, strict=True):
        known = {name: value for name, value in zip(names, values, strict=True) if value == value}
        yield known["time"], known | dict(zip(ticks.words, said, strict=True))


def _truth_rows(truth: Truth) -> Iterator[Row]:
    table = np.column_stack([getattr(truth, name) for name in TRUTH_COLUMNS])
    for values in table.tolist():
        yield values[0], dict(zip(TRUTH_COLUMNS, values, strict=True))


def _event_rows(happened: list[Event], epoch_us: int) -> Iterator[Row]:
    for event in happened:
        stamp = epoch_us + round(event.time * 1e6)
        yield (
            event.time,
            {
                "timestamp": {"sec": stamp // 1_000_000, "nsec": stamp % 1_000_000 * 1000},
                "level": LOG_WARNING if event.kind == "rejected" else LOG_INFO,
                "name": event.kind,
                "message": event.text,
                "file": "",
                "line": 0,
            },
        )
