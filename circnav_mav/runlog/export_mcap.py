"""A run as one MCAP file for Foxglove and PlotJuggler: our ticks and truth as JSON, and Foxglove's own messages.

Needs the extra [mcap]. Times are the wall clock's of the flight. A value that is not known is left out of its message.
"""

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from circnav_mav.runlog.atomic_write import atomic_write
from circnav_mav.runlog.run_folder import Run
from circnav_mav.runlog.ticks import Ticks

TRUTH_COLUMNS = ("time", "north", "east", "target_north", "target_east", "radius", "turn_rate")


def export_mcap(run: Run, path: Path) -> dict[str, int]:
    """Write the file, whole or not at all; returns the messages per topic. Raises ImportError without the extra,
    RunError, OSError."""
    from mcap.writer import Writer
    from mcap_protobuf.schema import register_schema

    from circnav_mav.runlog.foxglove import foxglove_messages, stamp_ns

    tables = {("/ticks", "circnav.Tick"): run.ticks}
    if run.truth is not None:
        columns = {name: getattr(run.truth, name) for name in TRUTH_COLUMNS}
        tables["/truth", "circnav.Truth"] = Ticks(columns, {})
    counts: Counter[str] = Counter()
    with atomic_write(path.resolve()) as fresh, fresh.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library=f"circnav {run.manifest.get('versions', {}).get('circnav', '')}".strip())

        def add(channel: int, topic: str, time: float, data: bytes) -> None:
            moment = stamp_ns(run, time)
            writer.add_message(channel, moment, data, moment)
            counts[topic] += 1

        for (topic, name), table in tables.items():
            schema_id = writer.register_schema(name, "jsonschema", json.dumps(_schema(table)).encode())
            channel = writer.register_channel(topic, "json", schema_id)
            for row in _tick_rows(table):
                add(channel, topic, row["time"], json.dumps(row).encode())
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


def _schema(table: Ticks) -> dict[str, Any]:
    kinds = ((table.numbers, "number"), (table.words, "string"))
    return {"type": "object", "properties": {name: {"type": kind} for names, kind in kinds for name in names}}


def _tick_rows(table: Ticks) -> Iterator[dict[str, Any]]:
    """What is known at each time."""
    names = [*table.numbers, *table.words]
    columns = [*(column.tolist() for column in table.numbers.values()), *table.words.values()]
    for values in zip(*columns, strict=True):
        yield {name: value for name, value in zip(names, values, strict=True) if value == value}  # not NaN
