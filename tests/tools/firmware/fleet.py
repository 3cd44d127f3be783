"""python -m tests.tools.firmware.fleet VEHICLE [options]:

one fleet of the installed circnav on real firmware in simulation: one simulator, radio and `circnav
fly` per vehicle.

    python -m tests.tools.firmware.fleet plane --size 3 --start 0 60 120 --leave 1
        --out runs/fleet-planes

Each vehicle is one `tests.tools.firmware.fly` process with its own ports and folder. All take off
at one home, circle one beacon in layers of height, and exchange signed reports on the loopback
interface. Other options (--wind, ...) go to every flight. The figures are computed from the
simulators' true tracks and their times of receipt. Evenness is measured without a model of the
wind: the gap of a vehicle is the time until the vehicle reaches the present bearing of the vehicle
ahead, as a share of the sum of all gaps. Only the state "on the circle" is read from circnav's
record. Prints one table and leaves fleet.json.
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
from functools import partial
from itertools import combinations
from math import cos, inf, pi, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.tools import cells
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
LAYER = 20.0
"""Distance of the height layers, m."""
LEAVES_EARLY = 120.0
"""Time from the end of the vehicle that leaves to the end of the others, s."""
TAKEN_AT = 200.0
"""Time of a takeover after the start of the vehicle's circnav, s."""
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
    found = []
    for i, start in enumerate(given.start):
        peers = [f"127.0.0.1:{port}" for port in ports if port != ports[i]]
        lasts = given.duration - start - (LEAVES_EARLY if i + 1 == given.leave else 0.0)
        keys = (
            f"fleet.id={i + 1}",
            f"fleet.size={given.size}",
            f"fleet.layer_m={LAYER}",
            f"fleet.port={ports[i]}",
            f"fleet.peers={json.dumps(peers)}",
            f'fleet.key_file="{key}"',
        )
        options = (
            f"--target-at {2.5 * what.radius} 0 --altitude {what.altitude + LAYER * i}"
            f" --duration {lasts} --seed {given.seed * 100 + i} --direction {given.direction}"
        )
        if given.takeover == i + 1:
            options += f" --takeover {TAKEN_AT}"
        words = [sys.executable, "-m", "tests.tools.firmware.fly", given.vehicle]
        words += ["--out", str(out / f"{i + 1:02d}"), *options.split()]
        if given.heading_error:
            words += [word for one in field(given.heading_error[i]) for word in ("--param", one)]
        found.append([*words, *(word for one in keys for word in ("--set", one)), *given.rest])
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
    flown = [one.parent for one in sorted(out.glob("[0-9][0-9]/truth.csv"))]
    raw = {
        int(one.name): read_member(one)
        for one in flown
        if (one / "circnav" / "fleet.csv").is_file()
    }
    if not raw:
        return np.array([]), []
    walls = [track["wall"] for track, *_ in raw.values()]
    grid = np.arange(min(one[0] for one in walls), max(one[-1] for one in walls), STEP)
    members = []
    for number, (track, wall, on) in raw.items():
        north = track["north"] - track["target_north"]
        east = track["east"] - track["target_east"]
        bearing = np.unwrap(np.arctan2(east, north))  # bearing, clockwise from north
        columns = [
            np.interp(grid, track["wall"], one, left=np.nan, right=np.nan)
            for one in (north, east, track["altitude"], bearing if clockwise else -bearing)
        ]
        place = np.searchsorted(wall, grid, side="right") - 1
        ring = (place >= 0) & on[np.maximum(place, 0)] & np.isfinite(columns[0])
        members.append(Member(number, *columns, ring))
    return grid, members


def read_member(folder: Path) -> tuple[dict[str, Array], Array, NDArray[np.bool_]]:
    """Return the true track of a vehicle while circnav steered; Unix times, and for each time True
    if circnav reports that the vehicle is on the circle."""
    track = {
        name: np.array(column, float) for name, column in _columns(folder / "truth.csv").items()
    }
    lasts = json.loads((folder / "result.json").read_text())["flown"]
    flown = (track["time"] >= 0.0) & (track["time"] <= lasts)
    epoch = json.loads((folder / "circnav" / "manifest.json").read_text())["epoch_us"] / 1e6
    states = _columns(folder / "circnav" / "fleet.csv")
    on = np.array(states["state"]) == "on_circle"
    track = {name: column[flown] for name, column in track.items()}
    return track, epoch + np.array(states["time"], float), on


def _columns(path: Path) -> dict[str, list[str]]:
    with path.open() as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


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
    pairs = [_distances(*pair) for pair in combinations(members, 2)]
    known = [pair for pair in pairs if pair is not None]
    return {
        "rings": [
            {"members": int(count[k]), **_ring(grid[: end + 1], errors[: end + 1], k)}
            for k, end in zip(changes, [*changes[1:], len(grid) - 1], strict=True)
            if count[k] >= 2
        ],
        "smallest_beside_m": round(min(one[0] for one in known), 1) if known else None,
        "smallest_above_m": round(min(one[1] for one in known), 1) if known else None,
        "too_near": sum(near for *_, near in known),
        "each": [_member(grid, one, radius) for one in members],
    }


def _ring(grid: Array, errors: Array, k: int) -> dict[str, Any]:
    """Return the figures of a ring that exists from time k to the last time."""
    even = even_from(grid, errors, grid[k])
    late = errors[grid >= (inf if even is None else even)]
    late = late[np.isfinite(late)]
    return {
        "from_s": _since(grid, k),
        "until_s": _since(grid, -1),
        "even_after_s": None if even is None else round(even - float(grid[k]), 1),
        "worst_gap_deg": _rms(late),
    }


def _distances(one: Member, other: Member) -> tuple[float, float, bool] | None:
    """Return the smallest distances of two vehicles beside and above each other, m, and True if
    they were too near. None: they did not fly at the same time."""
    flat = np.hypot(one.north - other.north, one.east - other.east)
    up = np.abs(one.height - other.height)
    both = np.isfinite(flat)
    if not both.any():
        return None
    near = bool(((flat < NEAR_BESIDE) & (up < NEAR_ABOVE)).any())
    return float(flat[both].min()), float(up[both].min()), near


def _member(grid: Array, one: Member, radius: float) -> dict[str, Any]:
    """Return the figures of a vehicle."""
    on = one.radius[one.ring]
    half = on[len(on) // 2 :]
    flew = np.flatnonzero(np.isfinite(one.north))
    entered = np.flatnonzero(one.ring)
    heights = (float(np.nanmin(one.height)), float(np.nanmax(one.height)))
    return {
        "id": one.number,
        "engaged_s": _since(grid, flew[0]),
        "on_circle_s": _since(grid, entered[0]) if len(entered) else None,
        "ended_s": _since(grid, flew[-1]),
        "radius_rms_m": _rms(half - radius),
        "radius_sd_m": _rms(half - half.mean()) if len(half) else None,
        "height_m": [round(height, 1) for height in heights],
    }


def _since(grid: Array, k: int) -> float:
    return round(float(grid[k] - grid[0]), 1)


def _rms(values: Array) -> float | None:
    return round(float(np.sqrt(np.mean(values**2))), 2) if len(values) else None


def table(found: dict[str, Any]) -> str:
    """Return the figures as text."""
    rings = "members on the circle | from, s | until, s | even after, s | worst gap rms, deg"
    each = "id | engaged, s | on circle, s | ended, s | radius rms, m | its sd, m | altitude, m"
    return (
        f"{cells.table(rings, (one.values() for one in found['rings']))}\n\n"
        f"{cells.table(each, (one.values() for one in found['each']))}\n\n"
        f"smallest distance {found['smallest_beside_m']} m beside, {found['smallest_above_m']} m"
        f" above; pairs within {NEAR_ABOVE:g} m above and {NEAR_BESIDE:g} m beside:"
        f" {found['too_near']}"
    )


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    number = partial(parser.add_argument, type=int, default=0)
    times = partial(parser.add_argument, type=float, nargs="*")
    parser.add_argument("vehicle", choices=KINDS)
    number("--size", default=3)
    times("--start", help="start of each simulator, s [0 60 120 ...]")
    parser.add_argument("--duration", type=float, default=420.0, help="of the first vehicle, s")
    number("--leave", help="id of the vehicle that leaves early")
    number("--takeover", help="id of the vehicle that the operator takes over")
    times("--heading-error", help="error of each compass (ArduPilot), degrees")
    parser.add_argument(
        "--direction", choices=("clockwise", "counterclockwise"), default="clockwise"
    )
    number("--seed", default=1)
    parser.add_argument("--out", type=Path, help="folder [runs/firmware/TIME-VEHICLE-fleet]")
    parser.add_argument("--judge", action="store_true", help="judge the folder --out again")
    given, given.rest = parser.parse_known_args()
    given.start = given.start or [60.0 * i for i in range(given.size)]
    for name in ("start", "heading_error"):
        values = getattr(given, name)
        if values and len(values) != given.size:
            parser.error(f"--{name.replace('_', '-')}: {len(values)} for {given.size} vehicles")
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    out = (given.out or Path("runs") / "firmware" / f"{stamp}-{given.vehicle}-fleet").resolve()
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
