"""python -m tests.tools.faults.files [--files N] [--seed S]: damaged mission, vehicle, campaign and log files."""

import argparse
import sys
import tempfile
from collections.abc import Callable
from contextlib import redirect_stdout, suppress
from functools import partial
from io import StringIO
from pathlib import Path
from random import Random
from typing import Any

from circnav_sim.config import ConfigError, load_vehicle, parse_vehicle
from circnav_sim.faults.intruders import tlog_frames

from circnav_mav.cli.exits import Refused
from circnav_mav.cli.replay import replay_log
from circnav_mav.extras.campaign.figures import summarise
from circnav_mav.extras.campaign.fly import fly_chunk, obstacle
from circnav_mav.extras.campaign.plan import CampaignError, hopeless, load_campaign, prepare
from circnav_mav.extras.campaign.store import TABLE, Store
from circnav_mav.mission.checks import check_mission
from circnav_mav.mission.load import MissionError, parse_mission
from circnav_mav.runlog.events import events
from circnav_mav.runlog.loop_steps import tlog_steps
from circnav_mav.runlog.run_folder import RunError, open_run
from tests.flight.lockstep import CONFIG
from tests.flight.recorded import recorded_flight

MISSIONS = sorted(path for path in CONFIG.glob("*.toml") if "[orbit]" in path.read_text())
CAMPAIGN = CONFIG / "campaigns" / "wind.toml"
LOGS = ("flight.tlog", "turns.csv", "ticks.csv")
WORDS = (
    "nan", "inf", "-1", "0", "1e308", "1e9", "1e-308", "5e-324", "true", '""', "[]", "{}", '"x"', "2026-01-01", "-0.0",
    "99999999999999999999",
)  # fmt: skip
NAMES = ("orbit", "vehicle", "sim", "guidance", "ranging", "limits", "link", "exit")


def spoilt_text(text: str, chance: Random) -> str:
    """A mission file with other values, lost lines, doubled ones, or odd characters."""
    lines = text.splitlines()
    for _ in range(chance.randint(1, 3)):
        at, kind = chance.randrange(len(lines)), chance.randrange(6)
        if kind <= 2 and "=" in lines[at]:
            lines[at] = lines[at].split("=")[0] + "= " + chance.choice(WORDS)
        elif kind == 3:
            del lines[at : at + chance.randint(1, 5)]
        elif kind == 4:
            odd = lines[chance.randrange(len(lines))], f"[{chance.choice(NAMES)}]", "\0", "é="
            lines.insert(at, chance.choice(odd))
        elif lines[at]:
            cut = chance.randrange(len(lines[at]))
            lines[at] = lines[at][:cut] + chr(chance.randrange(1, 0x2FF)) + lines[at][cut + 1 :]
        if len(lines) < 2:
            break
    return "\n".join(lines)


def read_mission(text: str) -> None:
    """Everything that is done with a mission file before the flight. Raises MissionError and ConfigError only."""
    mission = parse_mission(text, "damaged.toml")
    check_mission(mission)
    mission.pilot_settings()
    if mission.file.sim is not None:
        parse_vehicle(mission.file.sim, "damaged.toml: sim")


def spoilt_bytes(data: bytes, chance: Random) -> bytes:
    """A log that was cut off, with flipped, lost and foreign bytes."""
    spoilt = bytearray(data[: chance.randrange(len(data) + 1)] if chance.random() < 0.3 else data)
    for _ in range(chance.randint(0, 6)):
        at = chance.randrange(len(spoilt) + 1)
        spoilt[at : at + chance.randrange(9)] = chance.randbytes(chance.randrange(9))
    return bytes(spoilt)


def read_vehicle(path: Path, text: str) -> None:
    """A vehicle file, or the vehicle in a mission file. Raises ConfigError only."""
    path.write_text(text, encoding="utf-8")
    load_vehicle(path)


def read_run(folder: Path, files: dict[str, bytes]) -> None:
    """Everything that is read of a run folder, and its tlog for itself. Raises RunError and Refused only."""
    for name, data in files.items():
        (folder / name).write_bytes(data)
    tlog_frames(files["flight.tlog"])
    list(tlog_steps(folder / "flight.tlog", 191))
    run = open_run(folder)
    with redirect_stdout(StringIO()):
        replay_log(str(folder))
    len(run.ticks.time), run.truth, events(run)


def read_campaign(folder: Path, text: str, table: bytes | None) -> None:
    """Everything that is done with a campaign file before the flights, and with the table of one that is resumed.
    Raises CampaignError only."""
    path, out = folder / "campaign.toml", folder / "out"
    path.write_text(text, encoding="utf-8")
    campaign = load_campaign(path)
    if hopeless(campaign) is None:
        for number in range(min(campaign.runs, campaign.cells, 4)):
            with suppress(MissionError, ConfigError):  # such a run becomes a row with its error
                obstacle(prepare(campaign, number))
    if table is not None:
        (out / TABLE).write_bytes(table)
        store = Store(out, campaign, resume=True)
        store.sort()
        summarise(store.read(), campaign.swept)
        store.close()


def good_campaign(folder: Path) -> tuple[str, bytes]:
    """A campaign file, and the table of a short campaign, to damage; the folder holds what it was flown with."""
    mission = CONFIG / "campaign_mission.toml"
    text = CAMPAIGN.read_text(encoding="utf-8").replace('"../campaign_mission.toml"', f'"{mission}"')
    (folder / "good.toml").write_text(text.replace("runs = 750", "runs = 4"), encoding="utf-8")
    campaign = load_campaign(folder / "good.toml")
    store = Store(folder / "out", campaign)
    store.add(fly_chunk(campaign, range(4)))
    store.close()
    return campaign.text, (folder / "out" / TABLE).read_bytes()


def good_run(folder: Path) -> dict[str, bytes]:
    """The files of a short flight, to damage."""
    flight = recorded_flight(folder, "arducopter", 'guidance.law="smooth"').fly(3.0)
    assert flight.recorder is not None
    flight.recorder.close()
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def assault_files(count: int, seed: int) -> list[str]:
    """What escaped from the readers that should not have."""
    chance, escaped = Random(seed), list[str]()
    texts = [path.read_text(encoding="utf-8") for path in MISSIONS]
    with tempfile.TemporaryDirectory() as folder:
        good = good_run(Path(folder))
        campaign, table = good_campaign(Path(folder))
        read = partial(_escapes, escaped)
        for n in range(count):
            text, varied = spoilt_text(chance.choice(texts), chance), spoilt_text(campaign, chance)
            rows = spoilt_bytes(table, chance)
            spoilt = chance.choice([*LOGS, chance.choice(sorted(good))])
            run = good | {spoilt: spoilt_bytes(good[spoilt], chance)}
            read(n, (MissionError, ConfigError), read_mission, text)
            read(n, (ConfigError,), read_vehicle, Path(folder) / "x.toml", text)
            read(n, (CampaignError,), read_campaign, Path(folder), varied, None)
            read(n, (CampaignError,), read_campaign, Path(folder), campaign, rows)
            read(n, (RunError, Refused), read_run, Path(folder), run)
    return escaped


def _escapes(
    into: list[str], n: int, known: tuple[type[Exception], ...], reader: Callable[..., None], *given: Any
) -> None:
    try:
        reader(*given)
    except known as error:
        if "\n\n" in str(error):
            into.append(f"{n}: more than one line: {error}")
    except Exception as error:
        into.append(f"{n}: {type(error).__name__}: {error}")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.tools.faults.files")
    parser.add_argument("--files", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    escaped = assault_files(options.files, options.seed)
    kinds = "mission files, as many vehicle files, campaigns, tables and run folders"
    print(f"{options.files} {kinds}, seed {options.seed}: {len(escaped)} escaped")
    for line in escaped[:20]:
        print(f"  {line}")
    return 1 if escaped else 0


if __name__ == "__main__":
    sys.exit(main())
