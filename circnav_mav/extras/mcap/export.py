"""Export of a run as one MCAP file for Foxglove and PlotJuggler.

The file contains ticks and truth as JSON, and Foxglove's own messages (poses, scene, log and fixes
for the 3D, log and map panels). The export needs the optional dependencies [mcap]. Times are
wall-clock times of the flight. Unknown values are left out of messages. Positions are in the frame
"beacon" (of a fleet: "01/beacon"): x east, y north, z up, m. Its origin is the beacon and moves
with the beacon.
"""

import json
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from math import cos, isfinite, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema
from pymavlink.dialects.v20 import all as dialect

from circnav_mav.extras.mcap.layout import frame
from circnav_mav.mav.frames import heading_enu_from_yaw_ned
from circnav_mav.pilot.record import COLUMNS
from circnav_mav.runlog.atomic_write import atomic_write
from circnav_mav.runlog.events import events
from circnav_mav.runlog.run_folder import Run
from circnav_mav.runlog.ticks import Column, Ticks
from circnav_mav.runlog.tlog import read_messages

TRUTH_COLUMNS = ("time", "north", "east", "target_north", "target_east", "radius", "turn_rate")


def export_mcap(runs: Mapping[str, Run], path: Path) -> dict[str, int]:
    """Write the complete file or none. Return the number of messages per topic. Raises RunError,
    OSError.

    runs: runs by the prefix of their topics. The prefix is empty for a single vehicle.
    """
    counts: Counter[str] = Counter()
    with atomic_write(path.resolve()) as fresh, fresh.open("wb") as file:
        writer = Writer(file)
        first = next(iter(runs.values()))
        writer.start(
            profile="",
            library=f"circnav {first.manifest.get('versions', {}).get('circnav', '')}".strip(),
        )
        for prefix, run in runs.items():
            counts += _add_run(writer, prefix, run)
        writer.finish()  # type: ignore[no-untyped-call]
    return counts


def _add_run(writer: Writer, prefix: str, run: Run) -> Counter[str]:
    """Write the messages of one run. Return the number of messages per topic."""
    tables = {("/ticks", "circnav.Tick"): run.ticks}
    if run.truth is not None:
        columns = {name: getattr(run.truth, name) for name in TRUTH_COLUMNS}
        tables["/truth", "circnav.Truth"] = Ticks(columns, {})
    counts: Counter[str] = Counter()

    def add(channel: int, topic: str, moment: int, data: bytes) -> None:
        writer.add_message(channel, moment, data, moment)
        counts[topic] += 1

    for (name, schema_name), table in tables.items():
        topic = f"{prefix}{name}"
        kinds = dict.fromkeys(table.numbers, "number") | dict.fromkeys(table.words, "string")
        properties = {key: {"type": kind} for key, kind in kinds.items()}
        if table is run.ticks:
            for key, column in COLUMNS.items():
                properties[key]["description"] = column.description
        schema = json.dumps({"type": "object", "properties": properties})
        schema_id = writer.register_schema(schema_name, "jsonschema", schema.encode())
        channel = writer.register_channel(topic, "json", schema_id)
        for row in _tick_rows(table):
            add(channel, topic, _ns(run, row["time"]), json.dumps(row).encode())
    channels: dict[str, int] = {}
    for name, time, message in foxglove_messages(run):
        topic = f"{prefix}{name}"
        if topic not in channels:
            channels[topic] = writer.register_channel(
                topic, "protobuf", register_schema(writer, type(message))
            )
        for stamped in getattr(message, "entities", [message]):
            stamped.timestamp.FromNanoseconds(_ns(run, time))
            _name_frame(stamped, prefix)
        add(channels[topic], topic, _ns(run, time), message.SerializeToString())
    writer.add_metadata(
        f"{prefix.lstrip('/')} manifest".strip(),
        {k: json.dumps(v) for k, v in run.manifest.items()},
    )
    writer.add_attachment(
        create_time=run.epoch_us * 1000,
        log_time=run.epoch_us * 1000,
        name=f"{prefix}/mission.toml".lstrip("/"),
        media_type="text/plain",
        data=run.mission_text.encode(),
    )
    return counts


def _name_frame(message: Any, prefix: str) -> None:
    """Prefix the frame of a message with its vehicle. Vehicles share only the frame "map"."""
    field = "child_frame_id" if isinstance(message, FrameTransform) else "frame_id"
    if field in message.DESCRIPTOR.fields_by_name:
        setattr(message, field, frame(prefix, getattr(message, field)))


def _tick_rows(table: Ticks) -> Iterator[dict[str, Any]]:
    """Yield a dictionary for each tick: values by column name, without NaN values."""
    names = [*table.numbers, *table.words]
    columns = [*(column.tolist() for column in table.numbers.values()), *table.words.values()]
    for values in zip(*columns, strict=True):
        yield {
            name: value for name, value in zip(names, values, strict=True) if value == value
        }  # a NaN differs from itself


MAP = "map"
BEACON = "beacon"
POSITION = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
PIECE = 1.0
"""Duration of a piece of the drawn track, and time between two drawn range rings, s."""
CORNERS = 90
"""Corners of a drawn circle, every 4 deg: a chord is within 0.1 % of the radius."""
BLUE = (0.0, 0.45, 0.7, 1.0)
GREEN = (0.0, 0.62, 0.45, 1.0)
GRAY = (0.6, 0.6, 0.6, 0.6)
ORANGE = (0.84, 0.37, 0.0, 1.0)
"""Colors (red, green, blue, opacity) from Okabe and Ito's palette for color-blind readers."""
Entry = tuple[str, float, Any]
"""Topic, run time (s) and message of an entry of the file."""


def _ns(run: Run, time: float) -> int:
    """Return a run time as nanoseconds since 1970."""
    return run.epoch_us * 1000 + round(time * 1e6) * 1000


def foxglove_messages(run: Run) -> Iterator[Entry]:
    """Yield all Foxglove messages, topic by topic. Their timestamps are not set. Raises RunError,
    OSError."""
    ticks = run.ticks
    truth = run.truth
    numbers = run.ticks.numbers
    height = np.nan_to_num(numbers["height"])
    times = ticks.time
    places = np.column_stack([numbers["x"], numbers["y"], height])
    yield from _poses("/estimate/pose", times, places, numbers["heading"])
    if truth is not None:
        height = np.interp(truth.time, ticks.time, height)
        places = np.column_stack(
            [truth.east - truth.target_east, truth.north - truth.target_north, height]
        )
        times = truth.time
        newest = np.maximum(np.searchsorted(ticks.time, truth.time, side="right") - 1, 0)
        yield from _poses("/truth/pose", times, places, numbers["heading"][newest])
    yield from _transforms(run)
    yield from _scene(run, times, places)
    for event in events(run):
        level = Log.ERROR if event.severe else Log.WARNING if event.kind == "rejected" else Log.INFO
        yield "/events", event.time, Log(level=level, name=event.kind, message=event.text)
    yield from _fixes(run)
    yield from _target(run)


def _poses(topic: str, times: Column, places: Column, headings: Column) -> Iterator[Entry]:
    for time, place, heading in zip(
        times.tolist(), places.tolist(), headings.tolist(), strict=True
    ):
        if isfinite(sum(place)) and isfinite(heading):
            turn = heading_enu_from_yaw_ned(heading)
            pose = Pose(
                position=Vector3(**_xyz(place)),
                orientation=Quaternion(z=sin(turn / 2), w=cos(turn / 2)),
            )
            yield topic, time, PoseInFrame(frame_id=BEACON, pose=pose)


def _transforms(run: Run) -> Iterator[Entry]:
    """Yield the transforms from the map to the beacon: the true place once per PIECE seconds, or
    the origin if no truth is recorded."""
    truth = run.truth
    rows = [(float(run.ticks.time[0]), [0.0, 0.0, 0.0])]
    if truth is not None:
        at = _every_piece(truth.time)
        places = zip(truth.target_east[at].tolist(), truth.target_north[at].tolist(), strict=True)
        rows = [
            (time, [*place, 0.0])
            for time, place in zip(truth.time[at].tolist(), places, strict=True)
        ]
    for time, place in rows:
        yield "/tf", time, FrameTransform(
            parent_frame_id=MAP, child_frame_id=BEACON,
            translation=Vector3(**_xyz(place)), rotation=Quaternion(w=1.0),
        )  # fmt: skip


def _scene(run: Run, times: Column, places: Column) -> Iterator[Entry]:
    """Yield the drawn scene: beacon and desired circle once, then the track and the range ring once
    per PIECE seconds."""
    ticks = run.ticks
    begins = float(run.ticks.time[0])
    height = np.nan_to_num(ticks.numbers["height"])
    entities = [
        SceneEntity(
            id="beacon",
            spheres=[
                SpherePrimitive(
                    pose=_here(), size=Vector3(x=5.0, y=5.0, z=5.0), color=_color(ORANGE)
                )
            ],
        )
    ]
    if rings := [_ring(radius, float(np.median(height)), GREEN) for radius in _desired_radii(run)]:
        entities.append(SceneEntity(id="desired circle", lines=rings))
    yield _update(begins, entities)
    at = _every_piece(times)
    for number, (first, last) in enumerate(zip(at, [*at[1:], len(times) - 1], strict=True)):
        piece = [place for place in places[first : last + 1].tolist() if isfinite(sum(place))]
        if len(piece) > 1:
            yield _update(
                float(times[last]), [SceneEntity(id=f"track {number}", lines=[_line(piece, BLUE)])]
            )
    for tick in _every_piece(ticks.time):
        if isfinite(r := float(ticks.numbers["r"][tick])):
            ring = SceneEntity(id="estimated range", lines=[_ring(r, float(height[tick]), GRAY)])
            yield _update(float(ticks.time[tick]), [ring])


def _desired_radii(run: Run) -> list[float]:
    """Return the desired radii from the mission, which every run folder has, even one without a
    summary."""
    try:
        given = tomllib.loads(run.mission_text)["orbit"]["radius_m"]
        return [float(radius) for radius in (given if isinstance(given, list) else [given])]
    except (ValueError, KeyError, TypeError):
        return []


def _fixes(run: Run) -> Iterator[Entry]:
    """Yield the positions that the vehicle reports (GLOBAL_POSITION_INT), for the map panel.
    Guidance does not use these positions."""
    system = (run.manifest.get("autopilot") or {}).get("system") or None
    for stamp, message in read_messages(run.folder / "flight.tlog", {POSITION}):
        if system in (None, message.get_srcSystem()) and (message.lat or message.lon):
            time = (stamp - run.epoch_us) / 1e6
            yield "/fix", time, LocationFix(
                frame_id="vehicle", latitude=message.lat / 1e7, longitude=message.lon / 1e7,
                altitude=message.alt / 1000,
            )  # fmt: skip


def _target(run: Run) -> Iterator[Entry]:
    """Yield the estimated position of the target from the summary."""
    if not (place := run.summary.get("place")):
        return
    variance = place["sigma_m"] ** 2
    yield (
        "/target",
        place["time_s"],
        LocationFix(
            frame_id=BEACON,
            latitude=place["latitude_deg"],
            longitude=place["longitude_deg"],
            altitude=place["altitude_m"] or 0.0,
            position_covariance=[variance, 0, 0, 0, variance, 0, 0, 0, 0],
            position_covariance_type=LocationFix.APPROXIMATED,
        ),
    )


def _every_piece(times: Column) -> list[int]:
    """Return the index of the first of `times` in each interval of PIECE seconds."""
    return [int(at) for at in np.unique(np.floor(times / PIECE), return_index=True)[1]]


def _update(time: float, entities: Sequence[SceneEntity]) -> Entry:
    for entity in entities:
        entity.frame_id = BEACON
    return "/scene", time, SceneUpdate(entities=entities)


def _ring(radius: float, height: float, color: Sequence[float]) -> LinePrimitive:
    turns = (2 * pi * corner / CORNERS for corner in range(CORNERS + 1))
    return _line([(radius * cos(turn), radius * sin(turn), height) for turn in turns], color)


def _line(places: Sequence[Sequence[float]], color: Sequence[float]) -> LinePrimitive:
    """Return a line of 2 pixels through places."""
    return LinePrimitive(
        type=LinePrimitive.LINE_STRIP, pose=_here(), thickness=2.0, scale_invariant=True,
        points=[Point3(**_xyz(place)) for place in places], color=_color(color),
    )  # fmt: skip


def _here() -> Pose:
    return Pose(position=Vector3(), orientation=Quaternion(w=1.0))


def _color(rgba: Sequence[float]) -> Color:
    return Color(**dict(zip("rgba", rgba, strict=True)))


def _xyz(place: Sequence[float]) -> dict[str, float]:
    return dict(zip("xyz", place, strict=True))
