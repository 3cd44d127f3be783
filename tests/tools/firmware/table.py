"""python -m tests.tools.firmware.table --out DIR [--seeds N] [--jobs J] [--only TEXT]: the table of docs/firmware.md.

Flies every row with every seed, J at once, and writes the table between the marks in docs/firmware.md and its flights
into flights.jsonl beside this file. DIR keeps a line for each flight in results.jsonl and the run folders; what is
there is not flown again. Seeds differ in noise, start and direction of rotation. A vehicle without a binary is left out
with the reason. Other options go to every flight (`tests.tools.firmware.fly`).
"""

import argparse
import json
import re
import shlex
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from tests.tools.firmware.flight import ROOT, add_options, flight
from tests.tools.firmware.fly import line, missing

PAGE = ROOT / "docs" / "firmware.md"
FLIGHTS = Path(__file__).with_name("flights.jsonl")
MARKS = "<!-- flights -->\n", "<!-- end of flights -->\n"
STARTS = ((70, True), (-70, False), (140, True), (-10, False), (-110, True))
"""Bearing of the target from the nose, deg, and whether clockwise; by seed."""
OF_FLIGHT = ("vehicle", "radius", "speed", "direction", "seed", "wind", "turbulence", "start_bearing")
LEFT_OUT = {"title", "texts", "modes", "from_app", "ranges", "hidden", "exit_code", "cpu", "own_position"}
"""What the page's flights keep of their options, and leave out of their results."""
LASTS, LASTS_PX4_COPTER = 170, 270
"""How long a flight lasts before the operator takes it over, s."""
APART = 7.0
"""Least time between two starts, s."""
LONGEST_PAUSE, SLOWEST = 0.5, 0.98
"""A flight with a longer pause, s, or slower than real time says more about the computer than about circnav."""


@dataclass(frozen=True)
class Row:
    """shipped: RMS of version c1d941b, m, its turn sd, deg/s, and share at the limit, as measured then. aim: RMS and
    turn sd. own: RMS of the autopilot's own GPS circle, and its standard deviation, m."""

    name: str
    options: str
    shipped: str
    shipped_turn: str
    aim: float
    aim_turn: float | None
    own: str = "-"


ROWS = (
    Row("Plane R 150 V 22, calm", "plane", "0.82 to 1.71", "11.7 to 14.1, 30 to 35 %", 0.22, 1.0, "16.65 (0.09)"),
    Row("Plane, wind 5 + turbulence 1", "plane --wind 5 --turbulence 1", "3.06 to 4.55", "17 to 18.7, 47 %", 0.50, 4.0,
        "16.4 (2.0)"),
    Row("Plane, wind 8", "plane --wind 8", "1.92", "16.4, 40 %", 0.45, 6.0, "17.3 (3.1)"),
    Row("Plane, wind 6 + turbulence 3", "plane --wind 6 --turbulence 3", "6.9 not kept", "15.4, 22 %", 1.3, 8.0),
    Row("Plane, target at 4 m/s", "plane --target-speed 4", "1.30", "10.8, 19 %", 0.35, None),
    Row("Plane, GPS off after 60 s, wind 5 + turbulence 1", "plane --gps-off 60 --wind 5 --turbulence 1",
        "1.53 (no turbulence)", "11.8, 18 %", 0.55, None),
    Row("Plane, 10 % outliers of 30 m + 30 % loss, wind 5", "plane --outliers 0.1 --loss 0.3 --wind 5", "0.71",
        "11.3, 16 %", 0.30, None),
    Row("Plane, ranges 0.3 s late, wind 5", "plane --delay 0.3 --wind 5", "1.96", "12.1, 22 %", 0.35, None),
    Row("Plane, LoRa-like ranges, wind 5", "plane --preset lora --wind 5", "6.29", "18.1, 55 %", 1.6, None),
    Row("Plane, airspeed 15 % above the mission's", "plane --airspeed-off 1.15", "2.53", "10.7, 28 %", 0.30, None),
    Row("Plane, ROLL_LIMIT_DEG 35, wind 5", "plane --roll-limit 35 --wind 5", "4.9", "13, 40 %", 0.8, None),
    Row("Copter R 30 V 5, calm", "copter", "0.80, 0.81", "26 to 30, 31 %", 0.12, 1.0, "0.60 (0.06)"),
    Row("Copter, wind 5 + turbulence 1", "copter --wind 5 --turbulence 1", "0.62, 3.29 not kept", "22.6 to 36",
        0.15, 1.0),
    Row("Copter, target at 1 m/s", "copter --target-speed 1", "0.33", "20.5, 13 %", 0.17, 3.0),
    Row("Copter, UWB ranges, wind 5", "copter --preset uwb --wind 5", "0.60", "25.7, 22 %", 0.18, 3.0),
    Row("Rover R 20 V 3", "rover", "0.11 to 0.23", "10.7 to 13", 0.08, 2.0, "0.08"),
    Row("PX4 copter R 50 V 5, calm", "px4_copter", "0.93 to 1.72", "-", 0.40, 2.0, "0.97 (0.38)"),
    Row("PX4 copter, wind 3", "px4_copter --wind 3", "1.5", "-", 0.45, 2.0),
    Row("PX4 copter, target at 1.1 m/s", "px4_copter --target-speed 1.1", "1.4, led away 57 m", "-", 0.60, 2.0),
    Row("PX4 plane R 60 V 10 by stick, calm", "px4_plane", "0.5 to 0.8", "5 to 10", 0.30, 2.0, "0.52"),
    Row("PX4 plane by stick, wind 2", "px4_plane --wind 2", "0.5 to 0.8", "5 to 10", 0.30, 2.0),
    Row("PX4 plane by attitude, calm", "px4_plane_attitude", "0.4 to 0.6", "5 to 10", 0.30, 2.0),
    Row("PX4 plane by attitude, wind 2", "px4_plane_attitude --wind 2", "0.4 to 0.6", "5 to 10", 0.30, 2.0),
)  # fmt: skip
HEAD = (
    "| flight | as shipped: RMS m | turn sd deg/s, at limit | now: RMS m, median (least to most) | aim "
    "| turn sd deg/s (aim) | at limit | kept, right way round | settled s, own verdict | closest / R | led away m "
    "| most setpoints after the operator's mode was shown, in flights | own GPS circle: RMS (sd) m |\n"
    + 13 * "|---"
    + "|"
)


def words(row: Row, seed: int, extra: list[str]) -> list[str]:
    """The options of a flight."""
    bearing, clockwise = STARTS[(seed - 1) % len(STARTS)]
    direction = "clockwise" if clockwise else "counterclockwise"
    start = ["--seed", str(seed), f"--start-bearing={bearing}", "--direction", direction]
    lasts = LASTS_PX4_COPTER if row.options.startswith("px4_copter") else LASTS
    end = [f"--takeover={lasts}", f"--duration={lasts + 30}"]
    return [*shlex.split(row.options), *start, *end, *extra]


def told(path: Path) -> dict[tuple[str, int], dict[str, Any]]:
    """The flights kept so far, the newest of each."""
    lines = path.read_text().splitlines() if path.is_file() else []
    return {(one["row"], one["flight"]["seed"]): one for one in map(json.loads, lines)}


def fly_all(rows: list[Row], seeds: int, jobs: int, out: Path, extra: list[str], say: Callable[[str], None]) -> None:
    """What is not kept yet, seed by seed, so that a broken-off table has every row."""
    out.mkdir(parents=True, exist_ok=True)
    kept, lock, starting = told(out / "results.jsonl"), threading.Lock(), threading.Lock()
    wanted = [(row, seed) for seed in range(1, seeds + 1) for row in rows]
    todo = [(row, seed) for row, seed in wanted if "failed" in kept.get((row.name, seed), {"failed": ""})]

    def one(job: tuple[Row, int]) -> None:
        row, seed = job
        folder = out / f"{re.sub('[^a-z0-9]+', '-', row.options.replace('.', 'p'))}-{seed}"
        command = [sys.executable, "-m", "tests.tools.firmware.fly", *words(row, seed, extra), "--out", str(folder)]
        shutil.rmtree(folder, ignore_errors=True)
        with starting:  # simulators that start together starve each other, and their vehicles engage late
            time.sleep(APART)
        with (out / f"{folder.name}.log").open("w") as log:
            subprocess.run(command, cwd=ROOT, stdout=log, stderr=subprocess.STDOUT, check=False)
        with lock:
            if (folder / "result.json").is_file():
                result = {"row": row.name, **json.loads((folder / "result.json").read_text())}
                with (out / "results.jsonl").open("a") as file:
                    file.write(json.dumps(result) + "\n")
                say(line(result))
            else:
                say(f"{row.name}, seed {seed}: no result, see {folder}.log")

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(one, todo))


def table(rows: list[Row], flights: dict[tuple[str, int], dict[str, Any]]) -> Iterator[str]:
    """As Markdown."""
    yield HEAD
    for row in rows:
        flown = [one for (name, _), one in flights.items() if name == row.name and "failed" not in one]
        cells = _cells(row, flown) if flown else ["not flown", f"{row.aim:g}", *["-"] * 7]
        yield f"| {' | '.join([row.name, row.shipped, row.shipped_turn, *cells, row.own])} |"
    pauses = [one for one in flights.values() if _disturbed(one)]
    paused = f"the computer paused for more than {LONGEST_PAUSE} s, or was slow"
    yield f"\n{len(flights)} flights; in {len(pauses)} of them {paused}."


def _disturbed(one: dict[str, Any]) -> bool:
    return bool(one.get("longest_pause", 0.0) > LONGEST_PAUSE or one.get("real_speedup", 1.0) < SLOWEST)


def _cells(row: Row, flown: list[dict[str, Any]]) -> list[str]:
    rms, count = [one["rms"] for one in flown], len(flown)
    good = sum(one["kept"] and one["direction"] == one["flight"]["direction"] for one in flown)
    settled = [one["own"].get("settled_s") for one in flown]
    own = [value for value in settled if value is not None]
    agree = sum((one["settled"] is None) == (said is None) for one, said in zip(flown, settled, strict=True))
    radius = flown[0]["flight"]["radius"]
    aim = "" if row.aim_turn is None else f" (<= {row.aim_turn:g})"
    return [
        f"{median(rms):.2f} ({min(rms):.2f} to {max(rms):.2f})",
        f"{row.aim:g}",
        f"{median(one['turn_sd'] or 0 for one in flown):.1f}{aim}",
        f"{100 * median(one['turn_at_limit'] or 0 for one in flown):.0f} %",
        f"{good} of {count}",
        (f"{median(own):.0f}, {len(own)} of {count}" if own else f"0 of {count}")
        + ("" if agree == count else f"; truth disagrees in {count - agree}"),
        f"{min(one['closest'] for one in flown) / radius:.2f}",
        f"{max(one['led_away'] for one in flown):.0f}",
        _late([one["takeover"] for one in flown if one.get("takeover")]),
    ]


def _late(takeovers: list[dict[str, Any]]) -> str:
    """The most that came, of so many flights."""
    late = [one["after_shown"] for one in takeovers if one["after_shown"] is not None]
    return f"{max(late)} in {len(late)}" if late else "-"


def write(lines: Iterator[str], page: Path = PAGE) -> None:
    """Between the marks of the page."""
    before, rest = page.read_text().split(MARKS[0])
    after = rest.split(MARKS[1])[1]
    page.write_text(before + MARKS[0] + "\n".join(["", *lines, ""]) + "\n" + MARKS[1] + after)


def keep(flights: dict[tuple[str, int], dict[str, Any]], path: Path = FLIGHTS) -> None:
    """Write a line for each flight, row by row."""
    lines = []
    for name, seed in [of for row in ROWS for of in sorted(flights) if of[0] == row.name]:
        one = {key: value for key, value in flights[name, seed].items() if key not in LEFT_OUT}
        lines.append(json.dumps({**one, "flight": {key: one["flight"][key] for key in OF_FLIGHT}}) + "\n")
    path.write_text("".join(lines))


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.tools.firmware.table", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", default="", help="rows whose name or options hold this")
    parser.add_argument("--dry", action="store_true", help="fly nothing, print the table of what is kept")
    parser.add_argument("--page", type=Path, default=PAGE)
    parser.add_argument("--flights", type=Path, default=FLIGHTS)
    options, extra = parser.parse_known_args(arguments)
    rows = [row for row in ROWS if options.only in row.name or options.only in row.options]
    able = []
    for row in [] if options.dry else rows:
        reason = missing(flight(_parsed(words(row, 1, extra))))
        if reason:
            print(f"{row.name}: left out: {reason}", file=sys.stderr)
        else:
            able.append(row)
    fly_all(able, options.seeds, options.jobs, options.out.resolve(), extra, lambda text: print(text, flush=True))
    flown = told(options.out / "results.jsonl")
    lines = table(list(ROWS), flown)
    if options.dry:
        print("\n".join(lines))
    else:
        write(lines, options.page)
        keep(flown, options.flights)
    return 0


def _parsed(given: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_options(parser)
    return parser.parse_args(given)


if __name__ == "__main__":
    sys.exit(main())
