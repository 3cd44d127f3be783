"""Damaged campaign tables and run folders.

    python -m tests.tools.faults.files --files 5000 --seed 4

Damaged mission files: tests/mission/test_load.py.
"""

import argparse
import sys
import tempfile
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import partial
from io import StringIO
from pathlib import Path
from random import Random

from circnav_mav.cli.exits import Refused
from circnav_mav.cli.replay import replay_log
from circnav_mav.extras.campaign.figures import summarize
from circnav_mav.extras.campaign.fly import fly_run
from circnav_mav.extras.campaign.plan import CampaignError, load_campaign
from circnav_mav.extras.campaign.store import TABLE, Store
from circnav_mav.runlog.events import events
from circnav_mav.runlog.loop_steps import tlog_steps
from circnav_mav.runlog.run_folder import RunError, open_run
from tests.flight.lockstep import CONFIG
from tests.flight.recorded import recorded_flight
from tests.tools.fault_link.intruders import tlog_frames

CAMPAIGN = CONFIG / "campaigns" / "wind.toml"
LOGS = ("flight.tlog", "steps.csv", "ticks.csv")


def spoilt_bytes(data: bytes, chance: Random) -> bytes:
    """Return a log cut off at a random point, with flipped, lost and foreign bytes."""
    spoilt = bytearray(data[: chance.randrange(len(data) + 1)] if chance.random() < 0.3 else data)
    for _ in range(chance.randint(0, 6)):
        at = chance.randrange(len(spoilt) + 1)
        spoilt[at : at + chance.randrange(9)] = chance.randbytes(chance.randrange(9))
    return bytes(spoilt)


def read_run(folder: Path, files: dict[str, bytes]) -> None:
    """Read all files of a run folder, and its tlog separately. Only RunError and Refused are
    expected exceptions."""
    for name, data in files.items():
        (folder / name).write_bytes(data)
    tlog_frames(files["flight.tlog"])
    list(tlog_steps(folder / "flight.tlog", 191))
    run = open_run(folder)
    with redirect_stdout(StringIO()):
        replay_log(str(folder))
    len(run.ticks.time), run.truth, events(run)


def read_campaign(folder: Path, table: bytes) -> None:
    """Read a campaign table as a resumed campaign does. Only CampaignError is an expected
    exception."""
    campaign = load_campaign(folder / "good.toml")
    out = folder / "out"
    (out / TABLE).write_bytes(table)
    store = Store(out, campaign, resume=True)
    store.sort()
    summarize(store.read(), campaign.swept)
    store.close()


def good_campaign(folder: Path) -> bytes:
    """Return the table of two short flights of a campaign, which the caller damages. Its files are
    written into the folder."""
    mission = (CONFIG / "campaign_mission.toml").read_text(encoding="utf-8")
    assert "duration_s = 180.0" in mission
    shorter = mission.replace("duration_s = 180.0", "duration_s = 10.0")
    (folder / "campaign_mission.toml").write_text(shorter, encoding="utf-8")
    text = CAMPAIGN.read_text(encoding="utf-8").replace(
        "../campaign_mission.toml", "campaign_mission.toml"
    )
    (folder / "good.toml").write_text(text, encoding="utf-8")
    campaign = load_campaign(folder / "good.toml")
    store = Store(folder / "out", campaign)
    store.add(fly_run(campaign, number) for number in range(2))
    store.close()
    return (folder / "out" / TABLE).read_bytes()


def good_run(folder: Path) -> dict[str, bytes]:
    """Return the files of a short flight, which the caller damages."""
    flight = recorded_flight(folder, "arducopter", 'guidance.law="smooth"').fly(3.0)
    assert flight.recorder is not None
    flight.recorder.close()
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def assault_files(count: int, seed: int) -> list[str]:
    """Pass damaged files to the readers. Return their unexpected exceptions."""
    chance = Random(seed)
    escaped = list[str]()
    with tempfile.TemporaryDirectory() as folder:
        good = good_run(Path(folder))
        table = good_campaign(Path(folder))
        for n in range(count):
            rows = spoilt_bytes(table, chance)
            spoilt = chance.choice([*LOGS, chance.choice(sorted(good))])
            run = good | {spoilt: spoilt_bytes(good[spoilt], chance)}
            escaped += _escapes(partial(read_campaign, Path(folder), rows), n)
            escaped += _escapes(partial(read_run, Path(folder), run), n)
    return escaped


def _escapes(reader: Callable[[], None], n: int) -> list[str]:
    """Return the unexpected exception of a reader, or no exception."""
    try:
        reader()
    except (CampaignError, RunError, Refused) as error:
        return [f"{n}: more than one line: {error}"] if "\n\n" in str(error) else []
    except Exception as error:
        return [f"{n}: {type(error).__name__}: {error}"]
    return []


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--files", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    escaped = assault_files(options.files, options.seed)
    print(f"{options.files} tables of campaigns and as many run folders: {len(escaped)} escaped")
    print("\n".join(escaped[:20]))
    return 1 if escaped else 0


if __name__ == "__main__":
    sys.exit(main())
