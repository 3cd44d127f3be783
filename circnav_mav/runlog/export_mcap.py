"""A run as one MCAP file for Foxglove and PlotJuggler: our ticks and truth as JSON, and Foxglove's own messages.

Needs the extra [mcap]. Times are the wall clock's of the flight. A value that is not known is left out of its message.
"""

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from circnav_mav.runlog.atomic_write import atomic_write
from circnav_mav.runlog.run_folder import Run
from circnav_mav.runlog.ticks import Ticks, Truth

Row = tuple[float, dict[str, Any]]
TRUTH_COLUMNS = ("time", "north", "east", "target_north", "target_east", "radius", "turn_rate")


def export_mcap(run: Run, path: Path) -> dict[str, int]:
    """Write the file, whole or not at all; returns the messages per topic. Raises ImportError without the extra,
    RunError, OSError."""
    from mcap.writer import Writer
    from mcap_protobuf.schema import register_schema

    from circnav_mav.runlog.foxglove import foxglove_messages, stamp_ns

    tables = [("/ticks", "circnav.Tick", _schema(run.ticks.numbers, run.ticks.words), _tick_rows(run.ticks))]
    if run.truth is not None:
        tables.append(("/truth", "circnav.Truth", _schema(TRUTH_COLUMNS, ()), _truth_rows(run.truth)))
    counts: Counter[str] = Counter()
    with atomic_write(path.resolve()) as fresh, fresh.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library=f"circnav {run.manifest.get('versions', {}).get('circnav', '')}".strip())

        def add(channel: int, topic: str, time: float, data: bytes) -> None:
            moment = stamp_ns(run, time)
            writer.add_message(channel, moment, data, moment)
            counts[topic] += 1

        for topic, name, schema, rows in tables:
            schema_id = writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
            channel = writer.register_channel(topic, "json", schema_id)
            for time, row in rows:
                add(channel, topic, time, json.dumps(row).encode())
        channels: dict[str, int] = {}
        for topic, time, message in foxglove_messages(run):
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "protobuf", register_schema(writer, type(message)))
            add(channels[topic], topic, time, message.SerializeToString())
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
