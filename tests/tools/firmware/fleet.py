"""python -m tests.tools.firmware.fleet VEHICLE [options]:

one fleet of the installed circnav on real firmware in simulation: one simulator, radio and `circnav
fly` per vehicle.

    python -m tests.tools.firmware.fleet plane --size 3 --start 0 60 120 --leave 1
        --out runs/fleet-planes

Each vehicle is one `tests.tools.firmware.fly` process with its own ports and folder. All take off
at one home, circle one beacon in layers of height, and exchange signed reports on the loopback
interface. The figures are computed from the simulators' true tracks and their times of receipt.
Evenness is measured without a model of the wind: the gap of a vehicle is the time until the vehicle
reaches the present bearing of the vehicle ahead, as a share of the sum of all gaps. Only the state
"on the circle" is read from circnav's record. Prints one table and leaves fleet.json.
"""

import argparse
import csv
import json
import secrets
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from datetime import datetime
from itertools import combinations
from math import cos, pi, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.tools.firmware.flight import ROOT, VEHICLES

FIRST_PORT = 14600
"""UDP port of the first vehicle's fleet link."""
EVEN_DEG = 5.0
LASTS = 20.0
"""A fleet is even if no gap error exceeds EVEN_DEG (360 deg is the time of a lap) for LASTS
seconds."""
STEP = 0.2
"""Interval at which the tracks are compared, s."""
NEAR_ABOVE = 10.0
NEAR_BESIDE = 25.0
"""Two vehicles are too close if their vertical distance is below NEAR_ABOVE and their horizontal
distance below NEAR_BESIDE, m."""
HOME_FIELD = (230.0, 51.0)
"""Magnetic field at the home of the simulators, north and east, mG."""
BRING_UP = 120.0
"""Longest expected time from the start of a simulator to engaging, s."""
KINDS = ("plane", "copter", "rover")
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Member:
    """True track of one vehicle at the common times; nan while circnav did not steer. angle:
    unwrapped bearing from the beacon, positive in the direction of rotation, rad. ring: True while
    circnav reports that the vehicle is on the circle."""

    number: int
    north: Array
    east: Array
    height: Array
    angle: Array
    ring: NDArray[np.bool_]

    @property
    def radius(self) -> Array:
        return np.hypot(self.north, self.east)


def commands(given: argparse.Namespace, out: Path) -> list[list[str]]:
    """Return the command of each vehicle."""
    key = out / "fleet.key"
    key.write_text(secrets.token_hex(32))
    key.chmod(0o600)
    what = VEHICLES[given.vehicle]
    ports = [FIRST_PORT + i for i in range(given.size)]
    away = 2.5 * what.radius if given.away is None else given.away
    found = []
    for i, start in enumerate(given.start):
        peers = [f"127.0.0.1:{port}" for port in ports if port != ports[i]]
        lasts = given.duration - start - (given.leave_early if i + 1 == given.leave else 0.0)
        keys = [f"fleet.id={i + 1}", f"fleet.size={given.size}", f"fleet.layer_m={given.layer}"]
        keys += [
            f"fleet.port={ports[i]}",
            f"fleet.peers={json.dumps(peers)}",
            f'fleet.key_file="{key}"',
        ]
        words = [
            sys.executable,
            "-m",
            "tests.tools.firmware.fly",
            given.vehicle,
            "--out",
            str(out / f"{i + 1:02d}"),
        ]
        words += ["--target-at", str(away), "0", "--altitude", str(what.altitude + given.layer * i)]
        words += [
            "--duration",
            str(lasts),
            "--seed",
            str(given.seed * 100 + i),
            "--wind",
            str(given.wind),
        ]
        if given.takeover == i + 1:
            words += ["--takeover", str(given.takeover_at)]
        if given.heading_error:
            words += [word for one in field(given.heading_error[i]) for word in ("--param", one)]
        found.append([*words, *[word for one in keys for word in ("--set", one)], *given.rest])
    return found


def field(error: float) -> list[str]:
    """Return the parameters of the simulator that rotate the magnetic field, so that the compass
    heading is too large by an error, deg."""
    turn = -radians(error)
    north, east = HOME_FIELD
    # The anomaly decays with height over the last parameter, m. This value makes the anomaly
    # constant.
    return [
        f"SIM_MAG_ALY_X={north * cos(turn) - east * sin(turn) - north:.2f}",
        f"SIM_MAG_ALY_Y={north * sin(turn) + east * cos(turn) - east:.2f}",
        "SIM_MAG_ALY_HGT=100000",
    ]


def fly(given: argparse.Namespace, out: Path) -> None:
    """Start the vehicles at their times and wait for the end of all."""
    began = time.monotonic()
    running = []
    try:
        for i, (words, start) in enumerate(zip(commands(given, out), given.start, strict=True)):
            time.sleep(max(began + start - time.monotonic(), 0.0))
            with (out / f"{i + 1:02d}.log").open("w") as log:
                running.append(
                    subprocess.Popen(words, cwd=ROOT, stdout=log, stderr=subprocess.STDOUT)
                )
        for one in running:
            one.wait(max(began + given.duration + 2 * BRING_UP - time.monotonic(), 1.0))
    finally:
        for one in running:
            if one.poll() is None:
                one.terminate()
                one.wait()


def read_members(out: Path, clockwise: bool) -> tuple[Array, list[Member]]:
    """Return the common times (Unix, s) and the members that flew."""
    raw = {}
    for folder in sorted(out.glob("[0-9][0-9]")):
        if not (folder / "truth.csv").is_file() or not (folder / "circnav" / "fleet.csv").is_file():
            continue
        track = _columns(
            folder / "truth.csv",
            ("time", "wall", "north", "east", "altitude", "target_north", "target_east"),
        )
        result = json.loads((folder / "result.json").read_text())
        flown = (track["time"] >= 0.0) & (track["time"] <= result["flown"])
        raw[int(folder.name)] = (
            {name: column[flown] for name, column in track.items()},
            _states(folder / "circnav"),
        )
    if not raw:
        return np.array([]), []
    grid = np.arange(
        min(t["wall"][0] for t, _ in raw.values()),
        max(t["wall"][-1] for t, _ in raw.values()),
        STEP,
    )
    members = []
    for number, (track, (wall, on)) in raw.items():
        north, east = track["north"] - track["target_north"], track["east"] - track["target_east"]
        bearing = np.unwrap(np.arctan2(east, north))  # bearing, clockwise from north
        columns = [
            np.interp(grid, track["wall"], one, left=np.nan, right=np.nan)
            for one in (north, east, track["altitude"], bearing if clockwise else -bearing)
        ]
        place = np.searchsorted(wall, grid, side="right") - 1
        ring = (place >= 0) & on[np.maximum(place, 0)] & np.isfinite(columns[0])
        members.append(Member(number, *columns, ring))
    return grid, members


def _columns(path: Path, names: tuple[str, ...]) -> dict[str, Array]:
    with path.open() as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in names}


def _states(run: Path) -> tuple[Array, NDArray[np.bool_]]:
    """Return Unix times, and for each time True if circnav reports that the vehicle is on the
    circle."""
    epoch = json.loads((run / "manifest.json").read_text())["epoch_us"] / 1e6
    with (run / "fleet.csv").open() as file:
        rows = list(csv.DictReader(file))
    wall = np.array([epoch + float(row["time"]) for row in rows])
    return wall, np.array([row["state"] == "on_circle" for row in rows])


def gap_errors(grid: Array, members: list[Member]) -> Array:
    """Return the largest gap error at each time, deg (360 deg is the time of a lap). nan: fewer
    than two vehicles on the circle, or the end of a track."""
    found = np.full(len(grid), np.nan)
    for k in range(len(grid)):
        ring = [one for one in members if one.ring[k]]
        if len(ring) < 2:
            continue
        ring.sort(key=lambda one: one.angle[k] % (2 * pi))
        gaps = np.array(
            [
                _time_to(grid, here, ahead, k)
                for here, ahead in zip(ring, [*ring[1:], ring[0]], strict=True)
            ]
        )
        if np.isfinite(gaps).all():
            found[k] = 360.0 * np.abs(gaps / gaps.sum() - 1 / len(ring)).max()
    return found


def _time_to(grid: Array, here: Member, ahead: Member, k: int) -> float:
    """Return the time until a vehicle reaches the present bearing of the vehicle ahead, s."""
    goal = here.angle[k] + (ahead.angle[k] - here.angle[k]) % (2 * pi)
    later = np.flatnonzero(here.angle[k + 1 :] >= goal)
    if not len(later):
        return float("nan")
    pair = slice(k + later[0], k + later[0] + 2)
    return float(np.interp(goal, here.angle[pair], grid[pair]) - grid[k])


def even_from(grid: Array, errors: Array, since: float) -> float | None:
    """Return the first time after `since` from which the fleet was even for LASTS seconds, or
    None."""
    hold = round(LASTS / STEP)
    good = errors <= EVEN_DEG
    starts = (k for k in range(len(grid) - hold) if grid[k] >= since and good[k : k + hold].all())
    return next((float(grid[k]) for k in starts), None)


def judge(grid: Array, members: list[Member], radius: float) -> dict[str, Any]:
    """Return the figures of the fleet. Times: s since the first vehicle engaged."""
    errors = gap_errors(grid, members)
    count = np.sum([one.ring for one in members], axis=0)
    changes = [0, *(np.flatnonzero(np.diff(count)) + 1)]
    rings = []
    for k, end in zip(changes, [*changes[1:], len(grid) - 1], strict=True):
        if count[k] < 2:
            continue
        even = even_from(grid[: end + 1], errors[: end + 1], grid[k])
        late = errors[(grid >= even) & (grid <= grid[end])] if even is not None else np.array([])
        late = late[np.isfinite(late)]
        rings.append({
            "members": int(count[k]), "from_s": round(float(grid[k] - grid[0]), 1),
            "until_s": round(float(grid[end] - grid[0]), 1),
            "even_after_s": None if even is None else round(even - float(grid[k]), 1),
            "worst_gap_deg": round(float(np.sqrt(np.mean(late**2))), 2) if len(late) else None,
        })  # fmt: skip
    near = 0
    beside = []
    above = []
    for one, other in combinations(members, 2):
        flat = np.hypot(one.north - other.north, one.east - other.east)
        up = np.abs(one.height - other.height)
        both = np.isfinite(flat)
        if both.any():
            beside.append(float(flat[both].min()))
            above.append(float(up[both].min()))
            near += bool(((flat < NEAR_BESIDE) & (up < NEAR_ABOVE)).any())
    each = []
    for one in members:
        on = one.radius[one.ring]
        half = on[len(on) // 2 :]
        rms = float(np.sqrt(np.mean((half - radius) ** 2))) if len(half) else None
        spread = float(half.std()) if len(half) else None
        begin = np.flatnonzero(np.isfinite(one.north))
        entered = np.flatnonzero(one.ring)
        each.append(
            {
                "id": one.number,
                "engaged_s": round(float(grid[begin[0]] - grid[0]), 1),
                "on_circle_s": round(float(grid[entered[0]] - grid[0]), 1)
                if len(entered)
                else None,
                "ended_s": round(float(grid[begin[-1]] - grid[0]), 1),
                "radius_rms_m": None if rms is None else round(rms, 2),
                "radius_sd_m": None if spread is None else round(spread, 2),
                "height_m": [
                    round(float(np.nanmin(one.height)), 1),
                    round(float(np.nanmax(one.height)), 1),
                ],
            }
        )
    return {
        "rings": rings, "smallest_beside_m": round(min(beside), 1) if beside else None,
        "smallest_above_m": round(min(above), 1) if above else None, "too_near": near, "each": each,
    }  # fmt: skip


def table(found: dict[str, Any]) -> str:
    """Return the figures as text."""

    def shown(value: Any) -> str:
        return "-" if value is None else str(value)

    lines = [
        "| members on the circle | from, s | until, s | even after, s | worst gap rms, deg |",
        "|---|---|---|---|---|",
    ]
    lines += [f"| {' | '.join(shown(one[key]) for key in one)} |" for one in found["rings"]]
    lines += [
        "",
        "| id | engaged, s | on circle, s | ended, s | radius rms, m | its sd, m | altitude, m |",
        "|---" * 7 + "|",
    ]
    lines += [f"| {' | '.join(shown(one[key]) for key in one)} |" for one in found["each"]]
    apart = (
        f"{shown(found['smallest_beside_m'])} m beside, {shown(found['smallest_above_m'])} m above"
    )
    limits = f"{NEAR_ABOVE:g} m above and {NEAR_BESIDE:g} m beside"
    lines += ["", f"smallest distance {apart}; pairs within {limits}: {found['too_near']}"]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.firmware.fleet",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("vehicle", choices=KINDS)
    parser.add_argument("--size", type=int, default=3)
    parser.add_argument(
        "--start", type=float, nargs="*", help="start of each simulator, s [0 60 120 ...]"
    )
    parser.add_argument(
        "--duration",
        type=float,
        default=420.0,
        help="flight of the first vehicle after engaging, s",
    )
    parser.add_argument("--leave", type=int, default=0, help="id of the vehicle that leaves early")
    parser.add_argument(
        "--leave-early",
        type=float,
        default=120.0,
        help="time from its end to the end of the others, s",
    )
    parser.add_argument(
        "--takeover", type=int, default=0, help="id of the vehicle that the operator takes over"
    )
    parser.add_argument(
        "--takeover-at",
        type=float,
        default=200.0,
        help="time of the takeover after the start of this vehicle's circnav, s",
    )
    parser.add_argument(
        "--heading-error", type=float, nargs="*", help="error of each compass (ArduPilot), degrees"
    )
    parser.add_argument(
        "--layer", type=float, default=20.0, help="distance of the height layers, m"
    )
    parser.add_argument(
        "--away", type=float, help="distance of the beacon north of the home, m [2.5 radii]"
    )
    parser.add_argument("--wind", type=float, default=0.0)
    parser.add_argument(
        "--direction", choices=("clockwise", "counterclockwise"), default="clockwise"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="folder [runs/firmware/TIME-VEHICLE-fleet]")
    parser.add_argument(
        "--judge", action="store_true", help="judge the folder --out again, without a flight"
    )
    given, given.rest = parser.parse_known_args(arguments)
    given.start = given.start or [60.0 * i for i in range(given.size)]
    if len(given.start) != given.size:
        parser.error(f"--start: {len(given.start)} times for {given.size} vehicles")
    if given.heading_error and len(given.heading_error) != given.size:
        parser.error(f"--heading-error: {len(given.heading_error)} for {given.size} vehicles")
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    out = (given.out or Path("runs") / "firmware" / f"{stamp}-{given.vehicle}-fleet").resolve()
    given.rest += ["--direction", given.direction]
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    if not given.judge:
        out.mkdir(parents=True, exist_ok=True)
        fly(given, out)
    grid, members = read_members(out, given.direction == "clockwise")
    if not members:
        print(f"{out}: no vehicle flew, see its logs", flush=True)
        return 3
    found = judge(grid, members, VEHICLES[given.vehicle].radius)
    (out / "fleet.json").write_text(json.dumps(found, indent=1) + "\n")
    print(f"{table(found)}\n\n{out}", flush=True)
    return 0 if len(members) == given.size else 3


if __name__ == "__main__":
    sys.exit(main())
