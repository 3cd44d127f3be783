"""summary.json: keys that users' scripts read, and figures worked out by hand."""

import dataclasses
import json
import math
from pathlib import Path

import pytest

from circnav_mav.guidance.types import Direction, Orbit
from circnav_mav.runlog.summary import FlightFacts, summarise, write_summary
from circnav_mav.runlog.ticks import NO_TICKS, read_ticks, read_truth
from circnav_mav.runlog.turn_command import NAMES


def facts(epoch_us, direction=Direction.CLOCKWISE):
    return FlightFacts(
        mission="by hand", outcome="completed", reason="flown to its end", orbit=Orbit(100.0, direction, 15.0, 0.35),
        samples_accepted=2800, samples_rejected={"gated": 3}, setpoints_sent=5000, firmware="4.6.3", version="0",
        epoch_us=epoch_us, recording_problem=None,
    )  # fmt: skip


@pytest.fixture
def summary(run_folder, epoch_us):
    def make(**kind):
        folder = run_folder(**kind)
        return summarise(facts(epoch_us), read_ticks(folder), read_truth(folder, epoch_us))

    return make


def test_the_keys_that_scripts_read_are_there(summary):
    made = summary()
    assert {
        "mission", "outcome", "reason", "desired_radius_m", "direction", "settled_s", "radius_mean_m",
        "radius_rms_error_m", "samples_accepted", "samples_rejected", "setpoints_sent", "truth",
    } <= set(made)  # fmt: skip
    assert {"settled_s", "radius_mean_m", "radius_rms_error_m", "direction", "closest_approach_m"} <= set(made["truth"])


def test_the_figures_are_those_of_the_flight_after_engaging(summary):
    """Engaged at 10 s, at 101 m from 100 s on; the band of 5 % is entered then, 90 s after engaging."""
    made = summary()
    assert made["engaged_s"] == 10.0
    assert made["flown_s"] == 290.0
    assert made["settled_s"] == 90.0
    assert made["radius_mean_m"] == pytest.approx(101.0)
    assert made["radius_rms_error_m"] == pytest.approx(1.0)
    assert made["direction"] == made["direction_commanded"] == "clockwise"


def test_the_truth_has_its_own_figures_and_its_own_sense_of_rotation(summary):
    truth = summary()["truth"]
    assert truth["settled_s"] == 90.0
    assert truth["radius_mean_m"] == pytest.approx(101.0, abs=1e-3)
    assert truth["closest_approach_m"] == pytest.approx(101.0, abs=1e-3)
    assert truth["direction"] == "clockwise"


def test_the_wrong_way_round_shows(summary):
    made = summary(clockwise=False)
    assert made["direction"] == "clockwise"
    assert made["direction_commanded"] == "counterclockwise"
    assert made["truth"]["direction"] == "counterclockwise"


def test_the_sense_that_was_commanded_is_that_on_the_circle_and_not_that_on_the_way(run_folder, epoch_us):
    """Left at 1 rad/s for 90 s, then right at 0.15 rad/s for 200 s: clockwise."""
    folder = run_folder()
    rows = (folder / "ticks.csv").read_text().splitlines()
    header = rows[0].split(",")
    for at, row in enumerate(rows[1:], 1):
        cells = row.split(",")
        if 10 <= float(cells[0]) < 100:
            cells[header.index("turn_rate")] = "1.0"
            rows[at] = ",".join(cells)
    (folder / "ticks.csv").write_text("\n".join(rows) + "\n")
    assert summarise(facts(epoch_us), read_ticks(folder), None)["direction_commanded"] == "clockwise"


def test_a_flight_that_never_engaged_has_no_figures(summary):
    made = summary(engaged=False)
    assert made["engaged_s"] is None
    assert made["settled_s"] is None
    assert made["radius_mean_m"] is None
    assert made["radius_rms_error_m"] is None
    assert made["truth"] is None
    assert made["flown_s"] == made["steered_s"] == 0.0
    assert made["direction_commanded"] is None


def test_a_vehicle_of_flesh_and_blood_has_no_truth(summary):
    assert summary(truth=False)["truth"] is None


def test_the_file_is_json_that_comes_back(summary, tmp_path):
    made = summary()
    write_summary(tmp_path, made)
    assert json.loads((tmp_path / "summary.json").read_text(encoding="utf-8")) == made


def test_a_prediction_that_goes_on_through_an_outage_is_not_scored(run_folder, epoch_us):
    """From second 200 on there was no link, and the ticks held what was extrapolated."""
    folder = run_folder()
    rows = (folder / "ticks.csv").read_text().splitlines()
    for at, row in enumerate(rows[1:], 1):
        if float(row.split(",")[0]) >= 200:
            cells = row.split(",")
            rows[at] = ",".join([cells[0], "waiting for the link", cells[2], "20.0", *cells[4:]])
    (folder / "ticks.csv").write_text("\n".join(rows) + "\n")
    made = summarise(facts(epoch_us), read_ticks(folder), None)
    assert made["radius_mean_m"] == pytest.approx(101.0)
    assert made["settled_s"] == 90.0


def test_a_flight_that_leaves_the_band_in_its_last_third_never_settled(run_folder, epoch_us):
    """106 m for a moment at second 250; the last entry, after 240 s, is no settling time."""
    folder = run_folder()
    rows = (folder / "ticks.csv").read_text().splitlines()
    rows = [row.replace("101.000000", "106.0") if row.startswith("250.0") else row for row in rows]
    (folder / "ticks.csv").write_text("\n".join(rows) + "\n")
    made = summarise(facts(epoch_us), read_ticks(folder), read_truth(folder, epoch_us))
    assert made["settled_s"] is None
    assert made["truth"]["settled_s"] == 90.0


def test_a_flight_is_as_long_as_it_was_flown_and_not_as_it_was_recorded(run_folder, epoch_us):
    """Recorded are 300 s; it went on to second 500."""
    folder = run_folder()
    flown = dataclasses.replace(facts(epoch_us), engaged_s=10.0, until_s=500.0, recording_problem="full")
    made = summarise(flown, read_ticks(folder), read_truth(folder, epoch_us))
    assert made["flown_s"] == 490.0
    assert made["recording_problem"] == ("full; figures are of estimates up to 300 s, truth up to 300 s of 500 s")


def test_the_time_that_the_operator_flew_is_not_steered(run_folder, epoch_us):
    """Taken over from second 100 to 150, and given back in a hurry at 200."""
    folder = run_folder()
    rows = (folder / "ticks.csv").read_text().splitlines()
    for at, row in enumerate(rows[1:], 1):
        time = float(row.split(",")[0])
        if 100 <= time < 150 or time == 200:
            rows[at] = row.replace("engaged", "yielded" if time < 150 else "ready")
        elif 250 <= time < 260:
            rows[at] = row.replace("engaged", "holding")
    (folder / "ticks.csv").write_text("\n".join(rows) + "\n")
    made = summarise(facts(epoch_us), read_ticks(folder), None)
    assert (made["flown_s"], made["steered_s"]) == (290.0, 239.5)
    whole = summarise(facts(epoch_us), read_ticks(run_folder()), None)
    assert whole["steered_s"] == whole["flown_s"] == 290.0


def test_a_flight_of_which_nothing_was_recorded_is_summed_up_all_the_same(epoch_us):
    made = summarise(dataclasses.replace(facts(epoch_us), engaged_s=10.0, until_s=50.0), NO_TICKS, None)
    assert (made["engaged_s"], made["flown_s"], made["radius_mean_m"]) == (10.0, 40.0, None)
    assert made["recording_problem"] == "figures are of estimates up to 0 s of 50 s"


def test_a_summary_that_finds_no_room_leaves_nothing_half_written(tmp_path, monkeypatch):
    write_summary(tmp_path, {"outcome": "completed"})

    def full(path, *arguments, **options):
        path.write_bytes(b"")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OSError, match="No space left"):
        write_summary(tmp_path, {"outcome": "aborted"})
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [
        ("summary.json", '{\n  "outcome": "completed"\n}\n')
    ]


def test_how_quiet_the_stick_was_is_that_of_the_last_third_of_what_was_steered(run_folder, epoch_us):
    """The turn swings by 0.1 rad/s, one tick in four at the limit, from second 200 on; before, and out of the phase
    that steers, nothing of that counts."""
    folder = run_folder()
    header, *rows = ((line.split(",")) for line in (folder / "ticks.csv").read_text().splitlines())
    turn, limit, phase = (header.index(name) for name in ("turn_rate", "saturated", "phase"))
    for at, row in enumerate(rows):
        swings = float(row[0]) >= 200
        row[turn], row[limit] = str(0.1 * (-1) ** at if swings else 3.0), str(int(swings and at % 4 == 0))
        if float(row[0]) > 295:
            row[phase], row[turn] = "holding", "9.0"
    (folder / "ticks.csv").write_text("\n".join(",".join(row) for row in (header, *rows)) + "\n")
    made = summarise(facts(epoch_us), read_ticks(folder), None)
    assert made["turn_std_deg_s"] == pytest.approx(5.73, abs=0.01)
    assert made["turn_at_limit"] == pytest.approx(0.25, abs=0.01)
    assert made["turn_variation_rad_s2"] == pytest.approx(0.2 / 0.5, rel=0.01)


def test_a_flight_that_never_steered_has_no_unrest(epoch_us):
    made = summarise(facts(epoch_us), NO_TICKS, None)
    assert {name: made[name] for name in NAMES} == dict.fromkeys(NAMES)


def test_a_number_that_json_does_not_know_is_unknown(tmp_path):
    write_summary(tmp_path, {"a": math.nan, "b": {"c": [math.inf, 1.5]}, "d": (-math.inf, True), "e": None})
    told = {"a": None, "b": {"c": [None, 1.5]}, "d": [None, True], "e": None}
    assert json.loads((tmp_path / "summary.json").read_text(), parse_constant=pytest.fail) == told
