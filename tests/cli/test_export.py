"""`circnav export --mcap`, read back with mcap's own reader."""

import json

import pytest

from tests.flight.recorded import EPOCH_US, recorded_flight

reader = pytest.importorskip("mcap.reader")


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flown")
    recorded_flight(folder, "quickstart", "limits.duration_s=10").fly(20).recorder.close()
    return folder


def messages(path):
    found = {}
    with path.open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            found.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data), schema))
    return found


def test_ticks_truth_and_events_come_back_at_the_times_of_the_flight(circnav, flown, tmp_path):
    ran = circnav("export", flown, "--mcap", tmp_path / "x.mcap")
    assert (ran.code, ran.err) == (0, "")
    found = messages(tmp_path / "x.mcap")
    assert set(found) == {"/ticks", "/truth", "/events"}
    rows = (flown / "ticks.csv").read_text().splitlines()
    assert len(found["/ticks"]) == len(rows) - 1
    moment, tick, schema = found["/ticks"][-1]
    assert moment == EPOCH_US * 1000 + round(tick["time"] * 1e6) * 1000
    assert tick["phase"] == "ended"
    assert (schema.name, schema.encoding) == ("circnav.Tick", "jsonschema")
    assert set(tick) <= set(json.loads(schema.data)["properties"])
    assert found["/truth"][0][1]["radius"] == pytest.approx(316, abs=2)


def test_a_place_that_cannot_be_written_is_called_by_its_own_name(circnav, flown, tmp_path):
    place = tmp_path / "nowhere" / "x.mcap"
    assert circnav("export", flown, "--mcap", place).line == f"circnav: {place}: No such file or directory"


def test_the_events_are_a_log_that_tells_the_flight(circnav, flown):
    assert circnav("export", flown, "--mcap").code == 0
    log = [(row["name"], row["message"]) for _, row, schema in messages(flown / "flight.mcap")["/events"]]
    assert ("phase", "engaged") in log
    assert ("mode", "GUIDED") in log
    assert ("circnav says", "circnav: engaged, 100 m clockwise") in log


def test_the_mission_and_the_manifest_travel_along(circnav, flown, tmp_path):
    circnav("export", flown, "--mcap", tmp_path / "x.mcap")
    with (tmp_path / "x.mcap").open("rb") as file:
        read = reader.make_reader(file)
        assert [attached.name for attached in read.iter_attachments()] == ["mission.toml"]
        assert json.loads(next(read.iter_metadata()).metadata["epoch_us"]) == EPOCH_US


def test_a_run_without_truth_is_exported_without_it(circnav, tmp_path):
    flight = recorded_flight(tmp_path / "run", "quickstart", "limits.duration_s=3", "sim.truth.rate_hz=0").fly(8)
    flight.recorder.close()
    assert circnav("export", tmp_path / "run", "--mcap", tmp_path / "x.mcap").code == 0
    assert "/truth" not in messages(tmp_path / "x.mcap")


def test_what_cannot_be_exported_is_one_line(circnav, flown, tmp_path):
    assert "no such run folder" in circnav("export", tmp_path / "no", "--mcap").line
    assert "No such file or directory" in circnav("export", flown, "--mcap", tmp_path / "no" / "x.mcap").line
    assert "say what to write" in circnav("export", flown).line
