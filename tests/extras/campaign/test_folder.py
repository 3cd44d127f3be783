"""The folder of a campaign: no foreign file is overwritten, and one process at a time owns it."""

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from circnav_mav.extras.campaign.plan import CampaignError, load_campaign
from circnav_mav.extras.campaign.store import Store
from tests.command_line import FULL, ended
from tests.process import python

VARY = '"guidance.law" = ["smooth", "feedforward"]\n'
HOLDS = """
import sys, time
from pathlib import Path
from circnav_mav.extras.campaign.plan import load_campaign
from circnav_mav.extras.campaign.store import Store
store = Store(Path(sys.argv[2]), load_campaign(sys.argv[1]))
print("held", flush=True)
time.sleep(600)
"""


@pytest.fixture
def campaign(write):
    return load_campaign(write(VARY))


def begin(folder, campaign, *runs):
    store = Store(folder, campaign)
    store.add({"run": run} for run in runs)
    store.close()


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("name", ["log.txt", "slurm-17.out", ".DS_Store"])
def test_a_file_that_no_campaign_writes_is_in_nobodys_way(campaign, tmp_path, name):
    (tmp_path / name).write_text("mine\n")
    Store(tmp_path, campaign).close()
    assert (tmp_path / name).read_text() == "mine\n"


def test_what_a_full_disk_left_of_our_own_files_is_begun_anew(campaign, tmp_path):
    whole = tmp_path / "whole"
    torn = tmp_path / "torn"
    Store(whole, campaign).close()
    torn.mkdir()
    (torn / "mission.toml").write_bytes((whole / "mission.toml").read_bytes()[:100])
    Store(torn, campaign).close()
    assert contents(torn) == contents(whole)


@pytest.mark.parametrize(
    ("name", "text", "resume", "says"),
    [
        *(
            (
                name,
                "mine\n",
                resume,
                f"holds {name}, which is not a file of this campaign: name another --out",
            )
            for name in ("mission.toml", "campaign.toml", "summary.json", "runs.csv", "flight.png")
            for resume in (False, True)
        ),
        (
            "runs.csv",
            "a,b\n1,2\n3,4\n",
            False,
            "holds runs.csv, which is not a file of this campaign",
        ),
        (
            "runs.csv",
            "a,b\n1,2\n3,4\n",
            True,
            "cannot resume: campaign.toml is missing; name another --out",
        ),
    ],
)
def test_a_folder_with_a_file_of_somebody_elses_is_refused_untouched(
    campaign, tmp_path, name, text, resume, says
):
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / name).write_text(text)
    with pytest.raises(CampaignError, match=re.escape(says)):
        Store(folder, campaign, resume=resume)
    assert contents(folder) == {name: text.encode()}


@pytest.mark.parametrize("name", ["campaign.toml", "mission.toml"])
def test_a_campaign_that_lost_its_files_is_not_resumed_and_says_which(campaign, tmp_path, name):
    begin(tmp_path / "out", campaign, 0)
    (tmp_path / "out" / name).unlink()
    with pytest.raises(
        CampaignError, match=f"cannot resume: {name} is missing; name another --out"
    ):
        Store(tmp_path / "out", campaign, resume=True)


def test_lengths_are_written_with_five_decimals(campaign, tmp_path):
    errors = {
        -0.00968086: "-0.00968",
        -0.00968063: "-0.00968",
        -0.000001: "0",
        123.456789: "123.457",
    }
    store = Store(tmp_path / "out", campaign)
    store.add(
        [
            {"run": run, "mean_error_m": error, "settled_s": 12.3456789}
            for run, error in enumerate(errors)
        ]
    )
    store.close()
    assert [(row["mean_error_m"], row["settled_s"]) for row in store.read()] == [
        (told, "12.3457") for told in errors.values()
    ]


def test_an_empty_folder_and_one_of_the_same_campaign_before_its_first_row_are_taken(
    campaign, tmp_path
):
    (tmp_path / "out").mkdir()
    for _ in range(2):
        Store(tmp_path / "out", campaign).close()
    (tmp_path / "out" / "summary.json").write_text(
        "of no flights: it was interrupted before the first row"
    )
    for resume in (True, False):
        Store(tmp_path / "out", campaign, resume=resume).close()


@pytest.mark.parametrize("place", ["/proc/circnav", "/dev/null", "/dev/null/out"])
def test_a_folder_that_cannot_be_had_is_one_line_without_a_word_of_resuming(campaign, place):
    with pytest.raises(CampaignError) as told:
        Store(Path(place), campaign)
    assert re.fullmatch(rf"{place}(?!.*resume).*", str(told.value))


@pytest.fixture
def other(write, tmp_path):
    """Another process that owns the folder."""
    path = write(VARY)
    held = python("-c", HOLDS, str(path), str(tmp_path / "out"))
    assert held.stdout.readline() == "held\n"
    yield held
    held.kill()
    held.communicate()


@pytest.mark.parametrize("resume", [False, True])
def test_a_second_process_in_one_folder_is_refused(campaign, other, tmp_path, resume):
    with pytest.raises(
        CampaignError,
        match="another process is flying a campaign there: wait, or name another --out",
    ):
        Store(tmp_path / "out", campaign, resume=resume)


def test_a_process_that_was_killed_leaves_no_lock_behind(campaign, other, tmp_path):
    other.kill()
    other.communicate()
    Store(tmp_path / "out", campaign).close()


def test_a_machine_without_locks_is_taken_as_it_is(campaign, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "fcntl", None)
    Store(tmp_path / "out", campaign).close()


def test_fewer_runs_than_were_flown_are_refused_with_how_many_there_are(write, tmp_path):
    begin(tmp_path / "out", load_campaign(write(VARY, "runs = 24")), 3, 12, 23)
    with pytest.raises(
        CampaignError, match=r"runs\.csv: already holds run 12: give --runs of at least 24"
    ):
        Store(tmp_path / "out", load_campaign(write(VARY, "runs = 24"), runs=12), resume=True)


def test_a_folder_is_neither_overwritten_nor_resumed_with_another_campaign_and_free_again_when_refused(
    write, tmp_path
):
    campaign = load_campaign(write(VARY))
    begin(tmp_path / "out", campaign, 0)
    with pytest.raises(
        CampaignError, match="holds a campaign already: --resume it, or name another --out"
    ) as kept:
        Store(tmp_path / "out", campaign)
    with pytest.raises(CampaignError, match=r"cannot resume: campaign\.toml has changed"):
        Store(tmp_path / "out", load_campaign(write(VARY, "runs = 8\nseed = 4")), resume=True)
    Store(tmp_path / "out", campaign, resume=True).close()
    assert kept.value is not None  # and its traceback with all the objects in it


def test_a_full_disk_is_one_line_and_what_is_there_can_be_resumed(campaign, tmp_path):
    """There is space for 3 rows and a part of the next."""
    rows = [{"run": run, "rms_m": 1.0} for run in range(8)]
    store = Store(tmp_path / "out", campaign)
    store.add(rows[:3])
    real = store._file
    store._file = SimpleNamespace(write=lambda data: real.write(data[:10]))
    with pytest.raises(
        CampaignError, match="No space left on device; the rows written so far can be resumed"
    ):
        store.add(rows[3:])
    store.close()
    again = Store(tmp_path / "out", campaign, resume=True)
    assert again.done == {0, 1, 2}
    again.add(rows)
    again.close()
    assert [row["run"] for row in again.read()] == list("01234567")


def test_an_output_that_is_full_is_one_line_that_names_it(write, full):
    path = write(VARY)
    ran = ended(path.parent, f"campaign {path} --runs 4 --processes 1", full)
    assert (ran.returncode, ran.stderr) == (2, FULL)
