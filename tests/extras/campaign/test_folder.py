"""The folder of a campaign: no foreign file is overwritten, and one process at a time owns it."""

import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from circnav_mav.extras.campaign.plan import CampaignError, load_campaign
from circnav_mav.extras.campaign.store import Store
from tests.command_line import FULL, ended
from tests.process import python, running

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


def test_resumed_campaign_rewrites_incomplete_files(campaign, tmp_path):
    whole = tmp_path / "whole"
    torn = tmp_path / "torn"
    Store(whole, campaign).close()
    torn.mkdir()
    (torn / "mission.toml").write_bytes((whole / "mission.toml").read_bytes()[:100])
    Store(torn, campaign).close()
    assert contents(torn) == contents(whole)


@pytest.mark.parametrize(
    ("name", "text", "resume", "error"),
    [
        ("mission.toml", "mine\n", False, "holds mission.toml, which is not a file of this"),
        ("mission.toml", "mine\n", True, "holds mission.toml, which is not a file of this"),
        ("flight.png", "mine\n", False, "holds flight.png, which is not a file of this"),
        ("runs.csv", "a,b\n1,2\n", False, "holds runs.csv, which is not a file of this campaign"),
        ("runs.csv", "a,b\n1,2\n", True, "cannot resume: campaign.toml is missing"),
    ],
)
def test_folder_with_existing_file_is_refused_and_unchanged(
    campaign, tmp_path, name, text, resume, error
):
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / name).write_text(text)
    with pytest.raises(CampaignError, match=re.escape(error)):
        Store(folder, campaign, resume=resume)
    assert contents(folder) == {name: text.encode()}


@pytest.mark.parametrize("name", ["campaign.toml", "mission.toml"])
def test_campaign_without_its_files_cannot_resume(campaign, tmp_path, name):
    begin(tmp_path / "out", campaign, 0)
    (tmp_path / "out" / name).unlink()
    with pytest.raises(
        CampaignError, match=f"cannot resume: {name} is missing; name another --out"
    ):
        Store(tmp_path / "out", campaign, resume=True)


@pytest.mark.parametrize("place", ["/proc/circnav", "/dev/null", "/dev/null/out"])
def test_unusable_folder_is_refused_in_one_line(campaign, place):
    with pytest.raises(CampaignError) as caught:
        Store(Path(place), campaign)
    assert re.fullmatch(rf"{place}(?!.*resume).*", str(caught.value))


def test_campaign_folder_belongs_to_one_process_until_its_end(campaign, write, tmp_path):
    out = tmp_path / "out"
    with running(python("-c", HOLDS, str(write(VARY)), str(out))) as other:
        assert other.stdout.readline() == "held\n"
        for resume in (False, True):
            with pytest.raises(
                CampaignError,
                match="another process is flying a campaign there: wait, or name another --out",
            ):
                Store(out, campaign, resume=resume)
    Store(out, campaign).close()


def test_resumed_campaign_refuses_fewer_runs_than_flown(write, tmp_path):
    begin(tmp_path / "out", load_campaign(write(VARY, "runs = 24")), 3, 12, 23)
    with pytest.raises(
        CampaignError, match=r"runs\.csv: already holds run 12: give --runs of at least 24"
    ):
        Store(tmp_path / "out", load_campaign(write(VARY, "runs = 24"), runs=12), resume=True)


def test_another_campaign_can_neither_overwrite_nor_resume_folder(write, tmp_path):
    campaign = load_campaign(write(VARY))
    begin(tmp_path / "out", campaign, 0)
    with pytest.raises(
        CampaignError, match="holds a campaign already: --resume it, or name another --out"
    ) as kept:
        Store(tmp_path / "out", campaign)
    with pytest.raises(CampaignError, match=r"cannot resume: campaign\.toml has changed"):
        Store(tmp_path / "out", load_campaign(write(VARY, "runs = 8\nseed = 4")), resume=True)
    Store(tmp_path / "out", campaign, resume=True).close()
    assert kept.value is not None  # kept alive, so that no lock depends on garbage collection


def test_campaign_can_be_resumed_after_full_disk(campaign, tmp_path):
    """The disk has space for 3 rows and a part of the fourth row."""
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


def test_campaign_reports_unwritable_stdout_in_one_line(write, full):
    path = write(VARY)
    ran = ended(path.parent, f"campaign {path} --runs 4 --processes 1", full)
    assert (ran.returncode, ran.stderr) == (2, FULL)
