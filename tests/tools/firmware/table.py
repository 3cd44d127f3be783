"""The table of docs/measured.md.

    python -m tests.tools.firmware.table --out DIR [--seeds 1 5] [--processes 2] [--rows ROW ...]

Flies every row with every seed, some at once, and writes the table between the marks in
docs/measured.md and its flights into flights.jsonl beside this file. DIR keeps a line for each
flight in results.jsonl, and the run folders. Seeds differ in noise, start and direction of
rotation. A vehicle without a binary is skipped, and the reason is printed. Other options go to
every flight (`tests.tools.firmware.fly`).
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
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import date
from functools import partial
from pathlib import Path
from statistics import median
from textwrap import fill

from tests.tools import cells
from tests.tools.cells import Result
from tests.tools.firmware.flight import ROOT, add_options, flight
from tests.tools.firmware.fly import missing

PAGE = ROOT / "docs" / "measured.md"
FLIGHTS = Path(__file__).with_name("flights.jsonl")
MARKS = "<!-- flights -->\n", "<!-- end of flights -->\n"
STARTS = ((70, True), (-70, False), (140, True), (-10, False), (-110, True))
"""Start of a flight, by seed: bearing of the target from the nose, deg, and True for a clockwise
circle."""
OF_FLIGHT = ("vehicle", "radius", "speed", "direction", "wind", "turbulence", "start_bearing")
LEFT_OUT = {"title", "texts", "modes", "from_app", "ranges", "hidden", "exit_code",
            "own_position"}  # fmt: skip
"""OF_FLIGHT: options that are stored with the flights of the page. LEFT_OUT: keys of a result that
are not stored."""
WIDTH = 120
"""Width of the page's lines, characters."""
LASTS = 170
LASTS_PX4_COPTER = 270
"""Duration of a flight until the operator takes over, s; longer for the PX4 copter."""
APART = 7.0
"""Shortest time between two starts, s."""
STARTING = threading.Lock()
LONGEST_PAUSE = 0.5
SLOWEST = 0.98
"""Limits of a valid flight: longest pause, s, and smallest ratio of simulated to real time. Beyond
these limits, the figures depend on the load of the computer."""


@dataclass(frozen=True)
class Row:
    """A row of the table. aim: desired bound of the RMS radius error, m. aim_turn: desired bound of
    the standard deviation of the turn command, deg/s."""

    name: str
    options: str
    aim: float
    aim_turn: float | None


BREEZE = "--wind 3 --turbulence 0.5 --gps-shown"
WINDY = "--radius 40 --speed 6.4 --wind 4.5 --turbulence 1"
SX1280 = (
    "--set ranging.message=named_value_float "
    "--set ranging.points_m=[[0,4.4],[50,57.6],[100,103],[150,148],[200,201],[250,253]]"
)
ROWS = (
    Row("Plane R 150 V 22, calm", "plane", 0.22, 1.0),
    Row("Plane, wind 5 + turbulence 1", "plane --wind 5 --turbulence 1", 0.50, 4.0),
    Row("Plane, wind 8", "plane --wind 8", 0.45, 6.0),
    Row("Plane, wind 6 + turbulence 3", "plane --wind 6 --turbulence 3", 1.30, 8.0),
    Row("Plane, target at 4 m/s", "plane --target-speed 4", 0.35, None),
    Row(
        "Plane, GPS off after 60 s, wind 5 + turbulence 1",
        "plane --gps-off 60 --wind 5 --turbulence 1",
        0.55,
        None,
    ),
    Row(
        "Plane, 10 % outliers of 30 m + 30 % loss, wind 5",
        "plane --outliers 0.1 --loss 0.3 --wind 5",
        0.30,
        None,
    ),
    Row("Plane, ranges 0.3 s late, wind 5", "plane --delay 0.3 --wind 5", 0.35, None),
    Row("Plane, LoRa-like ranges, wind 5", "plane --preset lora --wind 5", 1.60, None),
    Row("Plane, airspeed 15 % above the mission's", "plane --airspeed-off 1.15", 0.30, None),
    Row("Plane, ROLL_LIMIT_DEG 35, wind 5", "plane --roll-limit 35 --wind 5", 0.80, None),
    Row("Copter R 30 V 5, calm", "copter", 0.12, 1.0),
    Row("Copter, wind 5 + turbulence 1", "copter --wind 5 --turbulence 1", 0.15, 1.0),
    Row("Copter, target at 1 m/s", "copter --target-speed 1", 0.17, 3.0),
    Row("Copter, UWB ranges, wind 5", "copter --preset uwb --wind 5", 0.18, 3.0),
    Row(
        "Copter, GPS lost after 60 s, wind 3 + turbulence 0.5",
        f"copter --gps-off 60 {BREEZE}",
        0.50,
        None,
    ),
    Row("Copter without GPS R 30 V 5, calm", "copter_nogps", 0.20, 1.0),
    Row(
        "Copter without GPS R 40 V 6.4, wind 4.5 + turbulence 1",
        f"copter_nogps {WINDY}",
        0.60,
        None,
    ),
    Row("Copter without GPS, target at 1 m/s", "copter_nogps --target-speed 1", 0.40, None),
    Row("Copter without GPS, UWB ranges", "copter_nogps --preset uwb", 0.30, None),
    Row("Copter without GPS, SX1280", f"copter_nogps --preset sx1280 {SX1280}", 2.00, None),
    Row(
        "Copter without GPS, drag 25 % too low",
        "copter_nogps --set vehicle.drag_per_s=0.29",
        0.30,
        None,
    ),
    Row("Rover R 20 V 3", "rover", 0.08, 2.0),
    Row("PX4 copter R 50 V 5, calm", "px4_copter", 0.40, 2.0),
    Row("PX4 copter, wind 3", "px4_copter --wind 3", 0.45, 2.0),
    Row("PX4 copter, target at 1.1 m/s", "px4_copter --target-speed 1.1", 0.60, 2.0),
    Row("PX4 copter without GPS R 50 V 5, calm", "px4_copter_nogps --gps-off 8", 0.80, None),
    Row("PX4 plane R 60 V 10 by stick, calm", "px4_plane", 0.30, 2.0),
    Row("PX4 plane by stick, wind 2", "px4_plane --wind 2", 0.30, 2.0),
)
BY_NAME = {row.name: row for row in ROWS}
HEAD = "flight (wind, V: m/s; R: m) | RMS, m (aim) | turn sd, deg/s (aim) | settled, s"
OF_SEEDS = " | RMS of the seeds, m"
"""Title of the last column, if a row has several seeds."""


def words(row: Row, seed: int, extra: list[str]) -> list[str]:
    """Return the options of a flight."""
    bearing, clockwise = STARTS[(seed - 1) % len(STARTS)]
    direction = "clockwise" if clockwise else "counterclockwise"
    start = ["--seed", str(seed), f"--start-bearing={bearing}", "--direction", direction]
    lasts = LASTS_PX4_COPTER if row.options.startswith("px4_copter") else LASTS
    end = [f"--takeover={lasts}", f"--duration={lasts + 30}"]
    return [*shlex.split(row.options), *start, *end, *extra]


def fly(name: str, seed: int, out: Path, extra: list[str]) -> Result:
    """Fly a row in a separate process. Return its result."""
    row = BY_NAME[name]
    folder = out / f"{re.sub('[^a-z0-9]+', '-', row.options.replace('.', 'p'))}-{seed}"
    program = [sys.executable, "-m", "tests.tools.firmware.fly"]
    command = [*program, *words(row, seed, extra), "--out", str(folder)]
    shutil.rmtree(folder, ignore_errors=True)
    # Simulators that start together compete for the processor, and their vehicles engage late.
    with STARTING:
        time.sleep(APART)
    with (out / f"{folder.name}.log").open("w") as log:
        subprocess.run(command, cwd=ROOT, stdout=log, stderr=subprocess.STDOUT, check=False)
    if not (folder / "result.json").is_file():
        return {"failed": f"no result, see {folder}.log"}
    found: Result = json.loads((folder / "result.json").read_text())
    return found | {"date": f"{date.today()}", "commit": commit()}


def commit() -> str | None:
    """Return the commit of this checkout, with "-dirty" if files differ from it. Outside of a
    checkout, return None."""
    command = ["git", "describe", "--always", "--dirty", "--exclude=*"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.strip() or None


def table(flights: Iterable[Result]) -> str:
    """Return the table in Markdown, and figures of all flights together."""
    every = list(flights)
    flown = [one for one in every if "failed" not in one]
    seeds = len({one["seed"] for one in every})
    rows = [
        _cells(row, [one for one in flown if one["row"] == row.name])[: 4 + (seeds > 1)]
        for row in ROWS
    ]
    lost = [f"{one['row']} (seed {one['seed']})" for one in flown if not _good(one)]
    agree = sum((one["settled"] is None) == (one["own"].get("settled_s") is None) for one in flown)
    late = [one["takeover"]["after_shown"] for one in flown if one.get("takeover")]
    late = [count for count in late if count is not None]
    figures = (
        f"{_versions(flown)}{len(every)} flights. {len(flown) - len(lost)} kept the circle in the"
        f" direction of the mission; not kept: {', '.join(lost) or 'none'}. circnav's verdict"
        f" agreed with the true track in {agree}. Closest approach:"
        f" {min((one['closest'] / one['flight']['radius'] for one in flown), default=0.0):.2f} R."
        f" Flown away from the target: at most {_largest(flown, 'led_away'):.0f} m. Turn command at"
        f" its limit: at most {100 * _largest(flown, 'turn_at_limit'):.0f} % of the last two laps."
        f" Setpoints after the operator's mode was shown: at most {max(late, default=0)}, in"
        f" {sum(map(bool, late))} of {len(late)} takeovers. The computer paused for more than"
        f" {LONGEST_PAUSE} s, or was slow: in {sum(map(_disturbed, every))} flights."
    )
    return f"{cells.table(HEAD + OF_SEEDS * (seeds > 1), rows)}\n\n{fill(figures, WIDTH)}"


def _good(one: Result) -> bool:
    """Return True if the vehicle kept its circle in the direction of the mission."""
    return bool(one["kept"]) and one["direction"] == one["flight"]["direction"]


def _versions(flown: Sequence[Result]) -> str:
    """Return a sentence with date and versions of the flights, empty if none is stored."""
    known = [one for one in flown if one.get("date")]
    if not known:
        return ""
    programs = {f"circnav {one['own'].get('version')} (commit {one['commit']})" for one in known}
    firmware = {
        f"{'PX4' if _is_px4(one) else 'ArduPilot'}"
        f" {one['own'].get('firmware') or 'of an unknown version'}"
        for one in known
    }
    dates = sorted({one["date"] for one in known})
    return f"Flown on {', '.join(dates)} with {', '.join(sorted(programs) + sorted(firmware))}. "


def _largest(flown: Sequence[Result], figure: str) -> float:
    return max((one[figure] or 0.0 for one in flown), default=0.0)


def _is_px4(one: Result) -> bool:
    return str(one["flight"]["vehicle"]).startswith("px4")


def _disturbed(one: Result) -> bool:
    # With PX4, circnav follows the clock of the simulator, which is slow on an idle computer, too.
    slow = not _is_px4(one) and one.get("real_speedup", 1.0) < SLOWEST
    return bool(slow or one.get("longest_pause", 0.0) > LONGEST_PAUSE)


def _cells(row: Row, flown: Sequence[Result]) -> list[str]:
    """Return the line of the table for a row, with the column of the seeds."""
    if not flown:
        return [row.name, "not flown", "-", "-", "-"]
    rms = [one["rms"] for one in flown]
    settled = [one["own"]["settled_s"] for one in flown if one["own"].get("settled_s") is not None]
    aim = "" if row.aim_turn is None else f" ({row.aim_turn:g})"
    return [
        row.name,
        f"{median(rms):.2f} ({row.aim:g})",
        f"{median(one['turn_sd'] or 0 for one in flown):.1f}{aim}",
        f"{median(settled):.0f}" if settled else "never",
        f"{min(rms):.2f} to {max(rms):.2f}",
    ]


def write(text: str) -> None:
    """Write text between the marks of the page."""
    before, rest = PAGE.read_text().split(MARKS[0])
    after = rest.split(MARKS[1])[1]
    PAGE.write_text(f"{before}{MARKS[0]}\n{text}\n\n{MARKS[1]}{after}")


def kept(flights: Iterable[Result]) -> str:
    """Return the lines of flights.jsonl, row by row."""
    order = list(BY_NAME)
    lines = []
    for flown in sorted(flights, key=lambda one: (order.index(one["row"]), one["seed"])):
        one = {key: value for key, value in flown.items() if key not in LEFT_OUT}
        one["flight"] = {key: one["flight"][key] for key in OF_FLIGHT}
        lines.append(json.dumps(one) + "\n")
    return "".join(lines)


def able(name: str, extra: list[str]) -> bool:
    """Return True if a row can be flown here. Otherwise print the reason."""
    parser = argparse.ArgumentParser()
    add_options(parser)
    reason = missing(flight(parser.parse_args(words(BY_NAME[name], 1, extra))))
    if reason:
        print(f"{name}: left out: {reason}", file=sys.stderr)
    return not reason


def main() -> None:
    parser = cells.parser(__doc__, BY_NAME, (1, 5))
    parser.set_defaults(processes=2)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--dry", action="store_true", help="print the table of the flights in DIR")
    options, extra = parser.parse_known_args()
    out = options.out.resolve()
    options.keep = out / "results.jsonl"
    if not options.dry:
        out.mkdir(parents=True, exist_ok=True)
        options.rows = [row for row in options.rows if able(row, extra)]
        cells.flown(partial(fly, out=out, extra=extra), options, ThreadPoolExecutor)
    flights = cells.read(options.keep).values()
    if options.dry:
        print(table(flights))
    else:
        write(table(flights))
        FLIGHTS.write_text(kept(flights))


if __name__ == "__main__":
    main()
