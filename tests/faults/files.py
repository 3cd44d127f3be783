"""python -m tests.faults.files [--files N] [--seed S]: damaged mission files and run folders for their readers."""

import argparse
import struct
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from random import Random

from circnav_mav.analysis.run_folder import read_ticks, read_tlog, read_truth
from circnav_mav.mission.checks import check_mission
from circnav_mav.mission.load import MissionError, parse_mission
from sim.config import ConfigError, parse_vehicle
from sim.faults.intruders import tlog_frames
from tests.faults.course import Course
from tests.flight.lockstep import CONFIG

MISSIONS = sorted(path for path in CONFIG.glob("*.toml") if "[orbit]" in path.read_text())
WORDS = (
    "nan",
    "inf",
    "-1",
    "0",
    "1e308",
    "1e9",
    "1e-308",
    "5e-324",
    "true",
    '""',
    "[]",
    "{}",
    '"x"',
    "2026-01-01",
    "-0.0",
    "99999999999999999999",
)
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
            lines.insert(
                at, chance.choice((lines[chance.randrange(len(lines))], f"[{chance.choice(NAMES)}]", "\0", "é="))
            )
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


def read_run(folder: Path, tlog: bytes, ticks: bytes) -> None:
    """Everything that is read of a run folder. Raises OSError and ValueError only."""
    (folder / "flight.tlog").write_bytes(tlog)
    (folder / "ticks.csv").write_bytes(ticks)
    tlog_frames(tlog)
    list(read_tlog(folder / "flight.tlog"))
    read_truth(folder, 0)
    read_ticks(folder)


def good_run() -> tuple[bytes, bytes]:
    """A short tlog and a short table of ticks to damage."""
    course = Course("arducopter")
    heard = []
    while course.now < 2.0:
        course.vehicle.advance(course.now)
        heard += [struct.pack(">Q", round(course.now * 1e6)) + frame for frame in course.vehicle.outgoing()]
        course.now += 0.05
    ticks = "time,phase,r,mode\r\n" + "".join(f"{n / 20},engaged,{100 + n},GUIDED\r\n" for n in range(40))
    return b"".join(heard), ticks.encode()


def assault_files(count: int, seed: int) -> list[str]:
    """What escaped from the readers that should not have."""
    chance, escaped = Random(seed), []
    texts = [path.read_text(encoding="utf-8") for path in MISSIONS]
    tlog, ticks = good_run()
    with tempfile.TemporaryDirectory() as folder:
        for n in range(count):
            text = spoilt_text(chance.choice(texts), chance)
            escaped += _escapes(n, lambda text=text: read_mission(text), (MissionError, ConfigError))  # type: ignore[misc]
            run = spoilt_bytes(tlog, chance), spoilt_bytes(ticks, chance)
            escaped += _escapes(n, lambda run=run: read_run(Path(folder), *run), (OSError, ValueError))  # type: ignore[misc]
    return escaped


def _escapes(n: int, attempt: Callable[[], None], known: tuple[type[Exception], ...]) -> list[str]:
    try:
        attempt()
    except known as error:
        return [f"{n}: more than one line: {error}"] if known[0] is MissionError and "\n\n" in str(error) else []
    except Exception as error:
        return [f"{n}: {type(error).__name__}: {error}"]
    return []


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.faults.files")
    parser.add_argument("--files", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    escaped = assault_files(options.files, options.seed)
    print(f"{options.files} mission files and {options.files} run folders, seed {options.seed}: {len(escaped)} escaped")
    for line in escaped[:20]:
        print(f"  {line}")
    return 1 if escaped else 0


if __name__ == "__main__":
    sys.exit(main())
