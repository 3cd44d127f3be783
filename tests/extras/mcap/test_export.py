"""`circnav export --mcap`, read back with mcap's own reader."""

import importlib
import json
import math
import shutil
import struct

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.runtime.recorder import TICK_COLUMNS
from tests.flight.recorded import EPOCH_US, recorded_flight

reader = pytest.importorskip("mcap.reader")
protobuf = pytest.importorskip("mcap_protobuf.decoder")
pytest.importorskip("foxglove_schemas_protobuf")
from google.protobuf.descriptor_pb2 import FileDescriptorSet  # noqa: E402

OURS = {"/ticks", "/truth"}
FOXGLOVE = {
    "/estimate/pose": "PoseInFrame",
    "/truth/pose": "PoseInFrame",
    "/scene": "SceneUpdate",
    "/events": "Log",
    "/tf": "FrameTransform",
    "/fix": "LocationFix",
}


@pytest.fixture
def exported(circnav, run):
    """Return a function that exports the run and reads back each topic: (ns, message, schema)."""

    def exported():
        assert circnav("export", run, "--mcap").done
        found = {}
        proto = protobuf.DecoderFactory()
        with (run / "flight.mcap").open("rb") as file:
            for schema, channel, message in reader.make_reader(file).iter_messages():
                decode = proto.decoder_for(channel.message_encoding, schema) or json.loads
                found.setdefault(channel.topic, []).append(
                    (message.log_time, decode(message.data), schema)
                )
        return found

    return exported


def append_messages(run, *messages):
    """Append messages of the vehicle to the log of the run, 19 s after its beginning."""
    vehicle = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    with (run / "flight.tlog").open("ab") as tlog:
        for at, message in enumerate(messages):
            tlog.write(struct.pack(">Q", EPOCH_US + 19_000_000 + at * 1000) + message.pack(vehicle))


def test_exported_ticks_truth_and_events_have_flight_times(exported, run):
    found = exported()
    assert set(found) == OURS | set(FOXGLOVE)
    assert len(found["/ticks"]) == len((run / "ticks.csv").read_text().splitlines()) - 1
    moment, tick, schema = found["/ticks"][-1]
    assert moment == EPOCH_US * 1000 + round(tick["time"] * 1e6) * 1000
    assert tick["phase"] == "ended"
    assert (schema.name, schema.encoding) == ("circnav.Tick", "jsonschema")
    assert set(tick) <= set(json.loads(schema.data)["properties"])
    assert found["/truth"][0][1]["radius"] == pytest.approx(316, abs=2)
    log = [(row.name, row.message) for _, row, _ in found["/events"]]
    assert {
        ("phase", "engaged"),
        ("mode", "GUIDED"),
        ("circnav message", "engaged, 100 m clockwise"),
    } <= set(log)


def test_fleet_folder_is_exported_to_one_file(circnav, flown, tmp_path):
    for member in ("01", "02"):
        shutil.copytree(flown, tmp_path / "fleet" / member)
    assert circnav("export", tmp_path / "fleet", "--mcap").done
    with (tmp_path / "fleet" / "flight.mcap").open("rb") as file:
        summary = reader.make_reader(file).get_summary()
    topics = {channel.topic for channel in summary.channels.values()}
    assert topics == {
        f"/{member}{topic}" for member in ("01", "02") for topic in OURS | set(FOXGLOVE)
    }


def strings(value):
    """Return all texts in JSON values, keys included."""
    if isinstance(value, dict):
        value = [*value, *value.values()]
    if isinstance(value, list):
        return set().union(*map(strings, value))
    return {value} if isinstance(value, str) else set()


@pytest.mark.parametrize("members", [(), ("01", "02")])
def test_foxglove_layout_uses_only_topics_of_exported_file(circnav, flown, tmp_path, members):
    folder = tmp_path / "run"
    for member in members or ("",):
        shutil.copytree(flown, folder / member)
    assert circnav("export", folder, "--mcap").done
    layout = json.loads((folder / "flight.layout.json").read_text())
    frames = set()
    with (folder / "flight.mcap").open("rb") as file:
        found = reader.make_reader(file)
        topics = {channel.topic for _, channel, _ in found.iter_messages()}
    with (folder / "flight.mcap").open("rb") as file:
        found = reader.make_reader(file, decoder_factories=[protobuf.DecoderFactory()])
        for *_, message in found.iter_decoded_messages(["/tf", "/01/tf", "/02/tf"]):
            frames.add((message.parent_frame_id, message.child_frame_id))
    panels = layout["configById"]
    plotted = {path["value"] for panel in panels.values() for path in panel.get("paths", ())}
    assert {value.partition(".")[0] for value in plotted} <= topics
    assert {value.partition(".")[2] for value in plotted} <= set(TICK_COLUMNS)
    named = set(panels["3D!scene"]["topics"]) | {panels["map!place"]["followTopic"]}
    named |= {panel["topicToRender"] for panel in panels.values() if "topicToRender" in panel}
    assert named <= topics
    assert frames == {("map", f"{one}/beacon".lstrip("/")) for one in members or ("",)}
    assert panels["3D!scene"]["followTf"] in {child for _, child in frames}
    assert set(panels) <= strings(layout["layout"])


def test_exported_file_contains_mission_and_manifest(circnav, flown, tmp_path):
    place = tmp_path / "no" / "x.mcap"
    assert (
        circnav("export", flown, "--mcap", place).refused == f"{place}: No such file or directory"
    )
    assert circnav("export", flown, "--mcap", tmp_path / "x.mcap").done
    with (tmp_path / "x.mcap").open("rb") as file:
        read = reader.make_reader(file)
        assert [attached.name for attached in read.iter_attachments()] == ["mission.toml"]
        assert json.loads(next(read.iter_metadata()).metadata["epoch_us"]) == EPOCH_US


def test_run_without_truth_is_exported(exported, run):
    shutil.rmtree(run)
    recorded_flight(run, "quickstart", "limits.duration_s=3", "sim.truth.rate_hz=0").fly(
        8
    ).recorder.close()
    found = exported()
    assert not {"/truth", "/truth/pose"} & set(found)
    assert len(found["/tf"]) == 1


def test_foxglove_topics_use_published_schemas(exported):
    """The fixture decodes messages by the schema in the file. This schema must be equal to the
    schema of the foxglove package."""
    found = exported()
    for topic in set(found) - OURS:
        schema = found[topic][0][2]
        assert (schema.name, schema.encoding) == (f"foxglove.{FOXGLOVE[topic]}", "protobuf")
        theirs = importlib.import_module(
            f"foxglove_schemas_protobuf.{FOXGLOVE[topic]}_pb2"
        ).DESCRIPTOR
        files = {file.name: file for file in FileDescriptorSet.FromString(schema.data).file}
        assert files[theirs.name].SerializeToString() == theirs.serialized_pb
        stamped = [
            (at, message) for at, message, _ in found[topic] if hasattr(message, "timestamp")
        ]
        assert all(message.timestamp.ToNanoseconds() == at for at, message in stamped)


def test_exported_scene_is_relative_to_beacon(exported):
    found = exported()
    truth = [row for _, row, _ in found["/truth"]]
    poses = [pose.pose for _, pose, _ in found["/truth/pose"]]
    first = poses[0].position
    row = truth[len(truth) - len(poses)]
    assert (first.x, first.y) == pytest.approx(
        (row["east"] - row["target_east"], row["north"] - row["target_north"])
    )
    # a copter's heading is its course, except for some degrees of lag
    before = poses[-40]
    after = poses[-20]
    flies = math.atan2(after.position.y - before.position.y, after.position.x - before.position.x)
    points = 2 * math.atan2(after.orientation.z, after.orientation.w)
    assert abs(math.remainder(flies - points, math.tau)) < 0.5
    entities = {one.id: one for _, update, _ in found["/scene"] for one in update.entities}
    circle = entities["desired circle"].lines[0].points
    assert {round(math.hypot(point.x, point.y), 6) for point in circle} == {100.0}
    assert {"beacon", "track 0", "track 5", "estimated range"} <= set(entities)
    assert {one.frame_id for one in entities.values()} == {"beacon"}


def test_export_joins_long_texts_and_converts_positions(exported, run):
    whole = "EKF3 lane switch 1, " * 6
    parts = [whole[50 * chunk : 50 * chunk + 50].encode() for chunk in range(3)]
    here = mavlink.MAVLink_global_position_int_message(
        1000, 473977420, 85455940, 488000, 0, 0, 0, 0, 0
    )
    append_messages(
        run,
        here,
        *(mavlink.MAVLink_statustext_message(3, text, 7, at) for at, text in enumerate(parts)),
    )
    found = exported()
    texts = [
        row
        for _, row, _ in found["/events"]
        if row.name == "vehicle message" and "EKF3" in row.message
    ]
    assert [(row.message, row.level) for row in texts] == [(whole, 4)]  # foxglove.Log level ERROR
    ((at, fix, _),) = (one for one in found["/fix"] if abs(one[1].altitude - 488.0) < 1e-6)
    assert (fix.latitude, fix.longitude, fix.altitude) == pytest.approx(
        (47.3977420, 8.5455940, 488.0)
    )
    assert at == (EPOCH_US + 19_000_000) * 1000


PLACE = {
    "latitude_deg": -35.3632621,
    "longitude_deg": 149.1652374,
    "altitude_m": None,
    "sigma_m": 1.5,
    "time_s": 18,
    "moves": False,
    "speed_mps": 0.0,
    "course_deg": None,
}


def test_located_target_is_exported_as_location_fix(exported, run):
    (run / "summary.json").write_text(json.dumps({"place": PLACE}))
    ((at, fix, schema),) = exported()["/target"]
    assert schema.name == "foxglove.LocationFix"
    assert (fix.latitude, fix.longitude) == (-35.3632621, 149.1652374)
    assert list(fix.position_covariance) == [2.25, 0, 0, 0, 2.25, 0, 0, 0, 0]
    assert at == (EPOCH_US + 18_000_000) * 1000


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_export_overwrites_only_earlier_exports(circnav, run, monkeypatch):
    before = contents(run)
    line = circnav("export", run, "--mcap", run / "mission.toml").refused
    assert line == f"--mcap {run / 'mission.toml'}: exists and is not an MCAP file: name another"
    assert "exists and is not a file" in circnav("export", run, "--mcap", "/dev/null").refused
    assert contents(run) == before
    for _ in range(2):
        assert circnav("export", run, "--mcap").done
    before = contents(run)

    def full(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("circnav_mav.extras.mcap.export._tick_rows", full)
    assert "No space left on device" in circnav("export", run, "--mcap").refused
    assert contents(run) == before


def test_wrong_usage_of_export_prints_one_error_line(circnav):
    assert circnav("export", "nowhere", "--mcap").refused.startswith("nowhere: no such run folder")
    assert circnav("export", "nowhere").refused.startswith("export: name the output format: --mcap")


# --- damaged runs
