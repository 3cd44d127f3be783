"""Whole campaigns: any number of processes gives the same table, and no row is lost."""

import json
import re
import shlex
from itertools import pairwise

import pytest
from circnav_sim.config import parse_vehicle
from circnav_sim.vehicle import Vehicle

from circnav_mav.cli.bundled import bundled
from circnav_mav.extras.campaign.fly import fly_run
from circnav_mav.extras.campaign.plan import START, load_campaign, prepare
from circnav_mav.extras.campaign.store import Store
from circnav_mav.mission.load import load_mission
from circnav_mav.runtime import jobs
from tests.extras.campaign.conftest import CONFIG

SHORT = '"limits.duration_s" = [3.0]\n"guidance.law" = ["smooth", "feedforward"]\n'


def flown(store, results):
    """Return the table of a campaign flown into a folder."""
    for row in results:
        store.add([row])
    store.close()
    store.sort()
    return (store.folder / "runs.csv").read_bytes()


def rows_of(campaign, runs, processes):
    return jobs.fly(fly_run, ((campaign, number) for number in runs), processes, None)


@pytest.fixture
def table(write, tmp_path):
    """The campaign table of SHORT, flown in this process."""
    campaign = load_campaign(write(SHORT))
    return flown(Store(tmp_path / "here", campaign), rows_of(campaign, range(8), 1))


def test_campaign_table_is_independent_of_processes_and_resuming(write, tmp_path, table):
    campaign = load_campaign(write(SHORT))
    assert table.count(b"\n") == 9
    assert flown(Store(tmp_path / "two", campaign), rows_of(campaign, range(7, -1, -1), 2)) == table
    store = Store(tmp_path / "torn", campaign)
    store.add([fly_run(campaign, 1)])
    store.close()
    with (tmp_path / "torn" / "runs.csv").open("ab") as file:
        file.write(b"5,1234,smo")
    store = Store(tmp_path / "torn", campaign, resume=True)
    assert store.done == {1}
    assert flown(store, rows_of(campaign, [0, *range(2, 8)], 1)) == table


def test_campaign_table_on_dask_worker_equals_local_table(circnav, write, tmp_path, table):
    distributed = pytest.importorskip("distributed", reason="needs the extra [cluster]")
    path = write(SHORT)
    there = tmp_path / "there"
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        done = circnav("campaign", path, "--out", there, "--scheduler", cluster.scheduler_address)
    assert done.code == 0, done.err
    assert (there / "runs.csv").read_bytes() == table


def test_failing_run_does_not_stop_other_runs(write):
    campaign = load_campaign(write(f'{SHORT}"orbit.radius_m" = [100.0, -5.0]'))
    rows = [fly_run(campaign, number) for number in range(4)]
    assert [row["outcome"] for row in rows] == ["completed", "completed", "error", "error"]
    assert "orbit.radius_m: must be above 0, not -5" in rows[2]["error"]


def test_internal_error_in_run_becomes_row(write, monkeypatch):
    def breaks(run):
        raise RuntimeError("a\nb")

    monkeypatch.setattr("circnav_mav.extras.campaign.fly.fly_lockstep", breaks)
    row = fly_run(load_campaign(write(SHORT, "runs = 1")), 0)
    assert row["error"].startswith("internal error: RuntimeError: a b (")


def test_drawn_values_depend_only_on_seed_and_run_number(write):
    laws = '"guidance.law" = ["smooth", "feedforward"]\n'
    vary = laws + '"sim.ranging.noise_m" = {log_uniform = [0.1, 10]}'
    campaign = load_campaign(write(vary))
    more = load_campaign(write(vary), runs=5000)
    assert [campaign.values(n) for n in range(8)] == [more.values(n) for n in range(8)]
    first, second, third = (campaign.values(n) for n in range(3))
    assert first | {"guidance.law": "feedforward"} == second
    assert third["sim.seed"] != first["sim.seed"]
    assert third["sim.ranging.noise_m"] != first["sim.ranging.noise_m"]
    other = load_campaign(write(vary, "runs = 8\nseed = 4"))
    assert other.values(0)["sim.seed"] != first["sim.seed"]
    noises = [more.values(2 * n)["sim.ranging.noise_m"] for n in range(2000)]
    assert sum(noise < 1 for noise in noises) / 2000 == pytest.approx(0.5, abs=0.05)


def test_campaign_flight_starts_at_drawn_range_and_bearing(write):
    vary = '"start.range_m" = [200.0]\n"start.bearing_deg" = [90.0]\n"start.heading_deg" = [30.0]'
    campaign = load_campaign(
        write(vary + '\n"sim.target.north_m" = [50.0]\n"limits.duration_s" = [2.0]', starts="")
    )
    row = fly_run(campaign, 0)
    shown = [row[name] for name in ("start_range_m", "start_bearing_deg", "start_heading_deg")]
    assert shown == pytest.approx([200.0, 90.0, 30.0], abs=1e-3)


def test_campaign_detects_wrong_direction_on_true_track(write, monkeypatch):
    """The test mirrors the track of a flight. The mirrored circle has the same ranges, but the
    opposite direction."""
    start = '"start.range_m" = [110.0]\n"start.bearing_deg" = [0.0]\n"start.heading_deg" = [90.0]\n'
    vary = '"limits.duration_s" = [45.0]\n"sim.wind.speed_mps" = [0.0]'
    campaign = load_campaign(write(vary, starts=start))
    right = fly_run(campaign, 0)
    flown = Vehicle.truth.fget

    def mirrored(vehicle):
        truth = flown(vehicle)
        return truth._replace(east=2 * truth.target_east - truth.east)

    monkeypatch.setattr(Vehicle, "truth", property(mirrored))
    wrong = fly_run(campaign, 0)
    assert (right["sense"], right["right_way"], right["kept"]) == ("clockwise", True, True)
    assert (wrong["sense"], wrong["right_way"], wrong["kept"]) == ("counterclockwise", False, False)
    assert wrong["rms_m"] < 1.0


def test_campaign_command_writes_complete_folder(circnav, write, tmp_path):
    """A picture that cannot be drawn gives a warning. Resuming a complete campaign does not contact
    the scheduler."""
    path = write(SHORT + '"sim.wind.speed_mps" = {uniform = [0, 2]}', "runs = 4\nseed = 3")
    out = tmp_path / "out"
    ran = circnav("campaign", path, "--out", out, "--processes", "1")
    assert ran.code == 0, ran.err
    assert "guidance.law = smooth" in ran.out
    names = {
        "runs.csv",
        "summary.json",
        "campaign.toml",
        "mission.toml",
        "distributions.png",
        "error-guidance-law.png",
        "error-sim-wind-speed-mps.png",
    }
    assert {file.name for file in out.iterdir()} == names
    table = (out / "runs.csv").read_bytes()
    again = circnav("campaign", path, "--out", out)
    assert (again.code, again.out.count("\n"), again.err.count("\n")) == (2, 0, 1)
    for name in ("summary.json", "distributions.png", "error-guidance-law.png"):
        (out / name).unlink()
    (out / "distributions.png").mkdir()
    again = circnav("campaign", path, "--out", out, "--resume", "--scheduler", "tcp://127.0.0.1:9")
    assert (again.code, again.err) == (0, "")
    assert (
        f"WARNING    {out / 'distributions.png'}: could not be drawn: Is a directory" in again.out
    )
    assert json.loads((out / "summary.json").read_text())["all"]["flights"] == 4
    assert (out / "error-guidance-law.png").exists()
    assert (out / "runs.csv").read_bytes() == table
    (out / "distributions.png").rmdir()
    more = circnav("campaign", path, "--out", out, "--resume", "--runs", "6", "--processes", "1")
    assert more.code == 0 and "WARNING" not in more.out
    longer = (out / "runs.csv").read_bytes()
    assert longer.startswith(table) and longer.count(b"\n") == 7


def test_documented_command_flies_single_row_of_campaign():
    """The test runs the command of docs/campaigns.md with the values and keys of its example."""
    page = (CONFIG.parent / "docs" / "campaigns.md").read_text()
    command = shlex.split(
        re.search(r"circnav fly .*?\n\n", page, re.DOTALL)[0].replace("\\\n", " ")
    )
    overrides = [word for before, word in pairwise(command) if before == "--set"]
    values = dict(override.split("=") for override in overrides)
    assert set(values) == {"sim.seed", "guidance.law", "sim.wind.speed_mps", "orbit.radius_m",
                           "sim.start.random.range_m", "sim.start.random.bearing_deg"}  # fmt: skip
    mission = load_mission(bundled("mission", command[2]), overrides)
    low, high = mission.file.sim["start"]["random"]["range_m"]
    assert low == high == 153.25
    assert parse_vehicle(mission.file.sim, "sim").seed == int(values["sim.seed"])


def test_mission_with_drawn_values_equals_campaign_run(write):
    campaign = load_campaign(
        write('"guidance.law" = ["switching"]\n"orbit.radius_m" = {uniform = [80, 120]}')
    )
    run = prepare(campaign, 3)
    overrides = [
        f"{START[key]}=[{value}, {value}]" if key in START else f"{key}={value}"
        for key, value in run.values.items()
    ]
    alone = load_mission(CONFIG / "campaign_mission.toml", overrides)
    assert alone.file == run.mission.file
    assert parse_vehicle(alone.file.sim, "sim") == run.vehicle
