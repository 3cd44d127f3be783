"""Campaigns as a whole: the table is the same whoever flies it, and nothing is lost."""

import json
import os
import re
import select
import shlex
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from circnav_mav.cli.bundled import bundled
from circnav_mav.emulator.config import parse_vehicle
from circnav_mav.experiments.batch.guidance import Guidance
from circnav_mav.experiments.campaign.batchable import obstacle
from circnav_mav.experiments.campaign.execute import ExecutionError, on_cores, on_scheduler
from circnav_mav.experiments.campaign.file import CampaignError, load_campaign
from circnav_mav.experiments.campaign.fly import chunks, fly_chunk
from circnav_mav.experiments.campaign.plan import START, prepare
from circnav_mav.experiments.campaign.store import Store, StoreError
from circnav_mav.experiments.campaign.summary import summarise
from circnav_mav.mission.load import load_mission
from tests.process import PATIENCE

CONFIG = Path(__file__).parents[3] / "config"
SHORT = '"limits.duration_s" = [20.0]\n"guidance.law" = ["smooth", "pi"]\n'


def flown(campaign, folder, results=None):
    """A campaign flown into a folder; its table."""
    store = Store(folder, campaign)
    for rows in results or on_cores(campaign, chunks(campaign), 1):
        store.add(rows)
    store.close()
    store.sort()
    return (folder / "runs.csv").read_bytes()


ENVIRONMENT = {"PYTHONPATH": str(Path(__file__).parents[3]), "PATH": "/bin"}


def test_the_table_is_the_same_on_one_process_two_and_when_resumed(write, tmp_path):
    campaign = load_campaign(write(SHORT))
    one = flown(campaign, tmp_path / "one")
    assert one.count(b"\n") == 9
    assert flown(campaign, tmp_path / "two", on_cores(campaign, chunks(campaign)[::-1], 2)) == one
    torn = tmp_path / "torn"
    store = Store(torn, campaign)
    store.add(fly_chunk(campaign, chunks(campaign)[1]))
    store.close()
    with (torn / "runs.csv").open("ab") as file:
        file.write(b"5,1234,smo")
    store = Store(torn, campaign, resume=True)
    assert store.done == set(chunks(campaign)[1])
    for rows in on_cores(campaign, chunks(campaign), 1):
        store.add(rows)
    store.close()
    store.sort()
    assert (torn / "runs.csv").read_bytes() == one


def test_the_table_is_the_same_on_two_workers_of_a_dask_scheduler(circnav, write, tmp_path):
    distributed = pytest.importorskip("distributed", reason="needs the extra [cluster]")
    path, there = write(SHORT), tmp_path / "there"
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        done = circnav("campaign", path, "--out", there, "--scheduler", cluster.scheduler_address)
    assert done.code == 0, done.err
    assert (there / "runs.csv").read_bytes() == flown(load_campaign(path), tmp_path / "here")


def test_an_interrupt_keeps_what_was_flown_and_says_how_to_go_on(write, tmp_path):
    path, out = write(SHORT, "runs = 200000"), tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, "-m", "circnav_mav", "campaign", path, "--out", out, "--processes", "2"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True, env=ENVIRONMENT,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # these tests may run where it is ignored
    )  # fmt: skip
    table = out / "runs.csv"
    while process.poll() is None and not (table.exists() and table.read_bytes().count(b"\n") > 1):
        select.select([], [], [], 0.05)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: everybody hears it
    said, complaint = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130, complaint
    assert f"go on with --out {out} --resume" in said
    assert "Traceback" not in complaint
    campaign = load_campaign(path)
    Store(out, campaign, resume=True).close()  # whole lines only


def test_dask_that_is_not_installed_is_told_with_the_remedy(write, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ExecutionError, match=r"pip install distributed"):
        list(on_scheduler(load_campaign(write(SHORT)), [[0]], "tcp://127.0.0.1:9"))


def test_one_bad_run_does_not_stop_the_rest(write):
    campaign = load_campaign(write(f'{SHORT}"orbit.radius_m" = [100.0, -5.0]'))
    rows = fly_chunk(campaign, range(4))
    assert [row["outcome"] for row in rows] == ["completed", "completed", "error", "error"]
    assert "orbit.radius_m: must be above 0, not -5" in rows[2]["error"]


def test_a_flight_that_breaks_the_program_is_a_row_too(write, monkeypatch):
    def breaks(run):
        raise RuntimeError("a\nb")

    monkeypatch.setattr("circnav_mav.experiments.campaign.fly.fly_lockstep", breaks)
    (row,) = fly_chunk(load_campaign(write(SHORT, 'runs = 1\nengine = "lockstep"')), [0])
    assert row["error"].startswith("internal error: RuntimeError: a b (")


def test_lockstep_is_flown_where_it_is_asked_for_and_where_a_batch_cannot(write):
    vary = '"limits.duration_s" = [5.0]\n'
    asked = fly_chunk(load_campaign(write(vary, 'runs = 1\nengine = "lockstep"')), [0])
    needed = fly_chunk(load_campaign(write(vary + '"guidance.radius_trim_per_s" = [0.05, 0.0]')), [0, 1])
    assert [row["engine"] for row in asked + needed] == ["lockstep", "lockstep", "batch"]


def test_values_and_seeds_follow_from_the_campaigns_seed_and_the_number_alone(write):
    vary = '"guidance.law" = ["smooth", "pd"]\n"sim.ranging.noise_m" = {log_uniform = [0.1, 10]}'
    campaign, more = load_campaign(write(vary)), load_campaign(write(vary), runs=5000)
    assert [campaign.values(n) for n in range(8)] == [more.values(n) for n in range(8)]
    first, second, third = (campaign.values(n) for n in range(3))
    assert first | {"guidance.law": "pd"} == second
    assert third["sim.seed"] != first["sim.seed"]
    assert third["sim.ranging.noise_m"] != first["sim.ranging.noise_m"]
    other = load_campaign(write(vary, "runs = 8\nseed = 4"))
    assert other.values(0)["sim.seed"] != first["sim.seed"]
    noises = [more.values(2 * n)["sim.ranging.noise_m"] for n in range(2000)]
    assert sum(noise < 1 for noise in noises) / 2000 == pytest.approx(0.5, abs=0.05)


def test_start_in_range_and_bearing_is_where_the_vehicle_begins(write):
    vary = '"start.range_m" = [200.0]\n"start.bearing_deg" = [90.0]\n"start.heading_deg" = [30.0]'
    campaign = load_campaign(write(vary + '\n"sim.target.north_m" = [50.0]\n"limits.duration_s" = [2.0]', starts=""))
    (row,) = fly_chunk(campaign, [0])
    shown = [row[name] for name in ("start_range_m", "start_bearing_deg", "start_heading_deg")]
    assert shown == pytest.approx([200.0, 90.0, 30.0], abs=1e-3)
    start = prepare(campaign, 0).vehicle.start.random
    assert start.range_m == (200.0, 200.0)


def test_a_wrong_sense_of_rotation_is_seen_on_the_true_track(write, monkeypatch):
    """A wrong sign behind the steering: the circle is as good, for range cannot see direction."""
    campaign = load_campaign(write('"limits.duration_s" = [90.0]\n"sim.wind.speed_mps" = [0.0]'))
    right = fly_chunk(campaign, [0])[0]
    command = Guidance.command

    def mirrored(*arguments):
        turn, cut = command(*arguments)
        return -turn, cut

    monkeypatch.setattr(Guidance, "command", mirrored)
    wrong = fly_chunk(campaign, [0])[0]
    assert (right["sense"], right["right_way"], right["kept"]) == ("clockwise", True, True)
    assert (wrong["sense"], wrong["right_way"], wrong["kept"]) == ("counterclockwise", False, False)
    assert wrong["rms_m"] < 1.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('mission = "m.toml"\nruns = 3\nrunz = 4\n[vary]', "runz: unknown key, did you mean runs?"),
        ('mission = "m.toml"\n[vary]', "runs: missing, add it"),
        ('mission = "m.toml"\nruns = 0\n[vary]', "runs: must be at least 1, not 0"),
        ('mission = "m.toml"\nruns = 3\n[vary]', "m.toml: cannot be read"),
        ("runs = ", "not valid TOML"),
        ('mission = "m.toml"\nruns = 3\nseed = "É"\n[vary]', "seed: should be a valid integer, not 'É'"),
        ('{M}\nruns = 3\n[vary]', "vary: is empty"),
        ('{M}\nruns = 3\n[vary]\norbit.radius_m = {{unifrom = [1, 2]}}', "radius_m: unifrom: unknown key, did"),
        ('{M}\nruns = 3\n[vary]\norbit.radius_m = {{uniform = [2, 1]}}', "radius_m: uniform: [2, 1] is empty"),
        ('{M}\nruns = 3\n[vary]\norbit.radius_m = {{normal = [2, -1]}}', "standard deviation"),
        ('{M}\nruns = 3\n[vary]\norbit.radius_m = []', "is an empty list"),
        ('{M}\nruns = 3\n[vary]\norbit.radius_m = 5', "vary.orbit.radius_m: write a list"),
    ],
)  # fmt: skip
def test_a_campaign_file_that_is_wrong_is_one_line_with_the_remedy(write, tmp_path, text, says):
    path = tmp_path / "wrong.toml"
    mission = write("").read_text().splitlines()[0]
    path.write_text(text.format(M=mission) if "{M}" in text else text)
    with pytest.raises(CampaignError) as told:
        load_campaign(path)
    assert str(told.value).startswith(str(path))
    assert says in str(told.value)
    assert "\n" not in str(told.value)


def test_a_folder_is_neither_overwritten_nor_resumed_with_another_campaign(write, tmp_path):
    folder = tmp_path / "out"
    begun = Store(folder, load_campaign(write(SHORT)))
    begun.add([{"run": 0}])
    begun.close()
    with pytest.raises(StoreError, match="--resume it, or name another"):
        Store(folder, load_campaign(write(SHORT)))
    with pytest.raises(StoreError, match=r"cannot resume: campaign\.toml has changed"):
        Store(folder, load_campaign(write(SHORT, "runs = 8\nseed = 4")), resume=True)


def test_a_full_disk_is_one_line_and_what_is_there_can_be_resumed(write, tmp_path):
    campaign = load_campaign(write(SHORT))
    rows = fly_chunk(campaign, range(8))
    store = Store(tmp_path / "out", campaign)
    store.add(rows[:3])
    room, real = 40, store._file

    class Full:
        def write(self, data):
            return real.write(data[:room])

    store._file = Full()
    with pytest.raises(StoreError, match="No space left on device; what is there can be resumed"):
        store.add(rows[3:])
    store.close()
    again = Store(tmp_path / "out", campaign, resume=True)
    assert again.done == {0, 1, 2}
    again.add(rows)
    again.close()
    assert (tmp_path / "out" / "runs.csv").read_bytes() == flown(campaign, tmp_path / "whole")


def test_summary_counts_every_value_of_the_grid():
    row = {
        "run": "0",
        "outcome": "completed",
        "kept": "true",
        "rms_m": "1",
        "settled_s": "",
        "closest_m": "3",
        "right_way": "true",
        "turn_std_deg_s": "0.4",
        "turn_at_limit": "0",
        "turn_variation_rad_s2": "0.2",
        "turn_limit_cycle": "false",
    }
    lost = row | {"kept": "false", "rms_m": "9", "right_way": "false", "turn_limit_cycle": "true"}
    failed = dict.fromkeys(row, "") | {"run": "3", "outcome": "error", "kept": "false"}
    summary = summarise([row | {"k": "1"}, lost | {"k": "2"}, failed | {"k": "2"}], {"k": (1, 2)})
    assert (summary["all"]["flights"], summary["all"]["kept"], summary["all"]["failed"]) == (3, 1, 1)
    assert summary["by"]["k"]["2"]["wrong_way"] == 1
    assert summary["all"]["settled_median"] is None
    assert (summary["all"]["turn_std_deg_s"], summary["all"]["limit_cycles"]) == (0.4, 1)
    json.dumps(summary, allow_nan=False)


def test_the_command_flies_sums_up_and_draws(circnav, write, tmp_path):
    path, out = write(SHORT + '"sim.wind.speed_mps" = {uniform = [0, 2]}'), tmp_path / "out"
    ran = circnav("campaign", path, "--out", out, "--processes", "1")
    assert ran.code == 0, ran.err
    assert "guidance.law = smooth" in ran.out
    names = {"runs.csv", "summary.json", "campaign.toml", "mission.toml", "starts.png", "distributions.png",
             "error-guidance-law.png", "error-sim-wind-speed-mps.png"}  # fmt: skip
    assert {file.name for file in out.iterdir()} == names
    assert json.loads((out / "summary.json").read_text())["all"]["flights"] == 8
    again = circnav("campaign", path, "--out", out)
    assert (again.code, again.out.count("\n"), again.err.count("\n")) == (2, 0, 1)
    more = circnav("campaign", path, "--out", out, "--resume", "--runs", "10", "--processes", "1")
    assert more.code == 0
    assert (out / "runs.csv").read_text().count("\n") == 11


@pytest.mark.parametrize("who", [["--processes", "2"], ["--scheduler", "tcp://127.0.0.1:9"]])
def test_a_finished_campaign_is_resumed_without_a_flight(circnav, write, tmp_path, who):
    """Whoever would have flown it: nobody is asked."""
    path, out = write(SHORT), tmp_path / "out"
    assert circnav("campaign", path, "--out", out, "--processes", "1").code == 0
    table = (out / "runs.csv").read_bytes()
    again = circnav("campaign", path, "--out", out, "--resume", *who)
    assert (again.code, again.err) == (0, "")
    assert "runs.csv" in again.out
    assert (out / "runs.csv").read_bytes() == table


def test_dollars_in_names_and_values_enclose_no_formula(circnav, write, tmp_path):
    path = tmp_path / "cost $_{\\x $.toml"
    path.write_text(write(SHORT + '"ranging.name" = ["$_a$", "$_{$"]').read_text())
    ran = circnav("campaign", path, "--out", tmp_path / "$_{ $", "--processes", "1")
    assert (ran.code, ran.err) == (0, "")
    assert "WARNING" not in ran.out
    assert "error-ranging-name.png" in ran.out


def test_a_picture_that_cannot_be_drawn_is_a_warning_and_the_rest_is_kept(circnav, write, tmp_path):
    path, out = write(SHORT), tmp_path / "out"
    assert circnav("campaign", path, "--out", out, "--processes", "1").code == 0
    for name in ("summary.json", "distributions.png", "error-guidance-law.png"):
        (out / name).unlink()
    (out / "distributions.png").mkdir()
    ran = circnav("campaign", path, "--out", out, "--resume")
    assert (ran.code, ran.err) == (0, "")
    assert f"WARNING    {out / 'distributions.png'}: could not be drawn: Is a directory" in ran.out
    assert "written" in ran.out
    assert json.loads((out / "summary.json").read_text())["all"]["flights"] == 8
    assert (out / "error-guidance-law.png").exists()
    (out / "distributions.png").rmdir()
    again = circnav("campaign", path, "--out", out, "--resume")
    assert "WARNING" not in again.out
    assert (out / "distributions.png").is_file()


def test_the_documented_way_to_fly_a_row_alone_gives_the_rows_mission():
    """The example's values where the example's keys stand, and its command as it stands."""
    page = (CONFIG.parent / "docs" / "campaigns.md").read_text()
    command = shlex.split(re.search(r"circnav fly .*?\n\n", page, re.DOTALL)[0].replace("\\\n", " "))
    overrides = [word for before, word in pairwise(command) if before == "--set"]
    values = dict(override.split("=") for override in overrides)
    assert set(values) == {"sim.seed", "guidance.law", "sim.wind.speed_mps", "orbit.radius_m",
                           "sim.start.random.range_m", "sim.start.random.bearing_deg"}  # fmt: skip
    mission = load_mission(bundled("mission", command[2]), overrides)
    low, high = mission.file.sim["start"]["random"]["range_m"]
    assert low == high == 153.25
    assert parse_vehicle(mission.file.sim, "sim").seed == int(values["sim.seed"])


def test_a_row_flown_alone_as_documented_is_the_run_of_the_campaign(write):
    campaign = load_campaign(write('"guidance.law" = ["relay"]\n"orbit.radius_m" = {uniform = [80, 120]}'))
    run = prepare(campaign, 3)
    overrides = [
        f"{START[key]}=[{value}, {value}]" if key in START else f"{key}={value}" for key, value in run.values.items()
    ]
    alone = load_mission(CONFIG / "campaign_mission.toml", overrides)
    assert alone.file == run.mission.file
    assert parse_vehicle(alone.file.sim, "sim") == run.vehicle


def test_a_mission_that_no_batch_flies_is_refused_where_a_batch_is_asked_for(circnav, write, tmp_path):
    path = write('"guidance.radius_trim_per_s" = [0.05]', 'runs = 2\nengine = "batch"')
    ran = circnav("campaign", path, "--out", tmp_path / "never")
    assert ran.code == 2
    assert 'engine: "batch" cannot fly this: guidance.radius_trim_per_s is not 0' in ran.err
    assert not (tmp_path / "never").exists()


def test_the_campaign_that_ships_is_flown_in_batches():
    campaign = load_campaign(Path(__file__).parents[3] / "config" / "campaigns" / "wind.toml")
    assert [obstacle(prepare(campaign, number)) for number in range(campaign.cells)] == [None] * campaign.cells
