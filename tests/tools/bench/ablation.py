"""python -m tests.tools.bench.ablation --results FILE [--seconds T] [--table]: the benefit of each
layer on the turn.

One layer at a time is disabled by replacing its function. Flights of the emulated vehicles (rows of
docs/measured.md) and rows of the benchmark are flown with and without the layer, with the same
seeds. FILE keeps a line for each flight or row, which is not flown again. A run ends after T
seconds. `--table` prints the table from FILE.

In a flight with all layers, each result of a layer is compared with the result without this layer.
If they never differ, the layer does not change this flight, so the flight without the layer is not
flown.
"""

import argparse
import inspect
import json
import random
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial, wraps
from itertools import islice
from math import inf
from pathlib import Path
from statistics import median
from typing import Any

from circnav_mav.extras.bench.bench import cell_of, fly_one
from circnav_mav.extras.bench.situations import SITUATIONS
from tests.tools.firmware.emulated import CIRCLES, ROWS, fly

FULL = "all"
RINGING = "Rover whose steering rings"
FLIGHTS = ROWS | {
    RINGING: ("ardurover", "sim.vehicle.turn_frequency_rad_s=4.0", "sim.vehicle.turn_damping=0.1"),
}
FLOWN = (
    "Plane R 150 V 22, calm",
    "Plane, wind 5 + turbulence 1",
    "Plane, wind 8",
    "Plane, ROLL_LIMIT_DEG 35, wind 5",
    "Copter, wind 5 + turbulence 1",
    "Copter, target at 1 m/s",
    "Rover R 20 V 3",
    "PX4 copter, wind 3",
    "PX4 plane by stick, wind 2",
    "Plane, airspeed 15 % above the mission's",
    RINGING,
)
SEEDS = 1, 2, 3
BENCHED = (
    "wind 0.53 V",
    "gusts 1.5, wind 0.33 V",
    "gusts, with accelerations",
    "target stops and goes",
)
BENCH_FLIGHTS = 20
BENCH_SEED = 2027
LASTS = 170.0
"""Benchmark rows: flights per row (BENCH_FLIGHTS), seed of the published table (BENCH_SEED), and
duration of a flight, s (LASTS; 400 s in the published table)."""
LAPS = 1
"""Laps of an emulated flight that are evaluated."""
AHEAD = 8
"""Number of next jobs from which a job is drawn at random, so that two parallel runs seldom fly the
same job."""
KEPT = 0.1
NEVER = 0.2
"""A circle is kept if the RMS radius error is below KEPT and every error below NEVER, as shares of
the radius."""

Function = Callable[..., Any]


@dataclass(frozen=True)
class Layer:
    """A function of the product that can be disabled. owner: class of the function; empty for a
    function of a module. takes: argument that distinguishes the function from others of the same
    name. off: called with the function and its arguments; returns the result without the layer.
    bench: True if the array engine of the benchmark has the layer."""

    name: str
    owner: str
    function: str
    takes: str
    off: Function
    bench: bool = False

    @property
    def places(self) -> list[tuple[Any, Function]]:
        """Modules or classes that contain the function, with the function. Raises LookupError if
        there is none."""
        modules = [one for name, one in sys.modules.items() if name.startswith("circnav_mav")]
        holders = [getattr(one, self.owner, None) for one in modules] if self.owner else modules
        held = [
            (one, vars(one)[self.function])
            for one in holders
            if self.function in getattr(one, "__dict__", ())
        ]
        fit = {id(holder): (holder, held) for holder, held in held if self._fits(held)}
        if not fit:
            raise LookupError(
                f"layer {self.name}: no function {self.owner or 'module'}.{self.function}"
            )
        return list(fit.values())

    def _fits(self, function: object) -> bool:
        return inspect.isfunction(function) and self.takes in inspect.signature(function).parameters


def _response_of_the_mission(response: Function, self: Any, link: float) -> Any:
    return vars(self).setdefault("of_the_mission", response(self, link))._replace(link=link)


def _present_turn_goes_on(
    at: Function, self: Any, now: float, response: Any, turn_rate: Any
) -> Any:
    return at(self, now, response, turn_rate)._replace(turn=turn_rate * response.delay)


def _not_compensated(compensate: Function, command: Any, limit: float, gain: float) -> Any:
    return compensate(command, limit, 1.0)


def _turns_at_the_missions_limit(pending: Function, self: Any, now: float, turn_rate: float) -> Any:
    return pending(self, now, turn_rate)._replace(most=inf)


LAYERS = (
    Layer("gain learner", "", "compensate_turn_gain", "gain", _not_compensated),
    Layer("delay learner", "ResponseLearner", "response", "link", _response_of_the_mission),
    Layer("Smith prediction", "PendingTurn", "at", "response", _present_turn_goes_on, bench=True),
    Layer("bank limit", "VehicleModel", "pending", "turn_rate", _turns_at_the_missions_limit),
    Layer(
        "limit-cycle watch",
        "",
        "drift_gains",
        "share",
        lambda of, V, delay, settles, *_: of(V, delay, settles),
    ),
    Layer("lap plan", "", "plan", "limit", lambda of, *circle, **how: None, bench=True),
    Layer(
        "accelerations",
        "PathPoint",
        "velocity_change_since",
        "before",
        lambda of, self, before: None,
    ),
    Layer(
        "change of drift",
        "",
        "drift",
        "change",
        lambda of, *at, **how: of(*at, **how | {"change": (0, 0)}),
        True,
    ),
)
NAMES = tuple(layer.name for layer in LAYERS)
ACCELERATIONS = "accelerations"


@contextmanager
def replaced(layer: Layer, make: Callable[[Function], Function]) -> Iterator[None]:
    """Replace a layer's function in every module or class that contains it."""
    places = layer.places
    for holder, function in places:
        setattr(holder, layer.function, wraps(function)(make(function)))
    try:
        yield
    finally:
        for holder, function in places:
            setattr(holder, layer.function, function)


def without(layer: Layer) -> Any:
    return replaced(layer, lambda function: answering(layer.off, function))


def answering(off: Function, function: Function) -> Function:
    """Return a function that gives the result without the layer. Unlike a `partial`, it can be a
    method."""
    return lambda *given, **named: off(function, *given, **named)


@contextmanager
def noted(acted: set[str]) -> Iterator[None]:
    """While active, record each layer that changes a result, in a flight with all layers."""

    def compare(layer: Layer, function: Function) -> Function:
        def compared(*given: Any, **named: Any) -> Any:
            with_it = function(*given, **named)
            if layer.name not in acted and _differ(with_it, layer.off(function, *given, **named)):
                acted.add(layer.name)
            return with_it

        return compared

    with ExitStack() as all_of_them:
        for layer in LAYERS:
            all_of_them.enter_context(replaced(layer, partial(compare, layer)))
        yield


def _differ(one: object, other: object) -> bool:
    if one is None or other is None:
        return one is not other
    return bool(one != other)


@dataclass(frozen=True)
class Result:
    """Figures of one flight or benchmark row. rms: radius error, m. turn_sd: standard deviation of
    the turn command, deg/s. kept, of: flights that kept the circle, and all flights. acted: layers
    that changed a result in a flight with all layers."""

    row: str
    seed: int
    layer: str
    rms: float
    turn_sd: float
    at_limit: float
    kept: int
    of: int
    acted: tuple[str, ...] = ()


def fly_row(row: str, seed: int, layer: str) -> Result:
    """Fly one flight of an emulated vehicle."""
    acted: set[str] = set()
    with noted(acted) if layer == FULL else without(_layer(layer)):
        one = fly(row, seed, count=LAPS, rows=FLIGHTS)
    radius = CIRCLES[FLIGHTS[row][0]][0]
    kept = one.right and one.rms < KEPT * radius and one.worst < NEVER * radius
    return Result(
        row, seed, layer, one.rms, one.turn_sd, one.at_limit, int(kept), 1, tuple(sorted(acted))
    )


def fly_bench(row: str, layer: str) -> Result:
    """Fly one row of the benchmark."""
    situation = SITUATIONS[row]
    flown = replace(
        situation, duration=LASTS, imu=None if layer == ACCELERATIONS else situation.imu
    )
    with ExitStack() as off:
        if layer not in (FULL, ACCELERATIONS):
            off.enter_context(without(_layer(layer)))
        rows = [fly_one(flown, "auto", BENCH_SEED, number) for number in range(BENCH_FLIGHTS)]
    cell = cell_of(rows, rows)
    figures = cell.rms_median, cell.turn_std_deg_s, cell.turn_at_limit
    return Result(row, BENCH_SEED, layer, *figures, cell.kept, cell.flights)


def _layer(name: str) -> Layer:
    return next(layer for layer in LAYERS if layer.name == name)


def read(path: Path) -> dict[tuple[str, int, str], Result]:
    """Return the stored results, by row, seed and layer."""
    lines = path.read_text().splitlines() if path.exists() else []
    results = [Result(**json.loads(line)) for line in lines]
    return {(one.row, one.seed, one.layer): one for one in results}


def due(done: dict[tuple[str, int, str], Result]) -> Iterator[Callable[[], Result]]:
    """Yield the jobs left to fly: seed by seed, each row with all layers first."""
    for seed in (SEEDS[0], BENCH_SEED, *SEEDS[1:]):
        for layer in (FULL, *NAMES):
            for row in BENCHED if seed == BENCH_SEED else FLOWN:
                if (row, seed, layer) in done or (layer != FULL and (row, seed, FULL) not in done):
                    continue
                if seed == BENCH_SEED and (layer == FULL or _in_bench(layer, row)):
                    yield partial(fly_bench, row, layer)
                elif seed != BENCH_SEED and (layer == FULL or layer in done[row, seed, FULL].acted):
                    yield partial(fly_row, row, seed, layer)


def _in_bench(layer: str, row: str) -> bool:
    return _layer(layer).bench or (layer == ACCELERATIONS and SITUATIONS[row].imu is not None)


def table(results: dict[tuple[str, int, str], Result]) -> str:
    """Return the table in Markdown. A cell contains the median radius RMS, m, the standard
    deviation of the turn command, deg/s, and the share of commands at the limit if it is 1 % or
    more. A dash: the layer changed no result. Empty cell: not flown yet."""
    ratios: dict[str, list[float]] = {name: [] for name in NAMES}
    lines = [["row", FULL, *NAMES], ["---"] * (2 + len(NAMES))]
    for row in (*FLOWN, *BENCHED):
        seeds = SEEDS if row in FLOWN else (BENCH_SEED,)
        full = [results[row, seed, FULL] for seed in seeds if (row, seed, FULL) in results]
        cells = [row if row in FLOWN else f"benchmark: {row}", _cell(full)]
        for name in NAMES:
            applies = {
                one.seed
                for one in full
                if (_in_bench(name, row) if row in BENCHED else name in one.acted)
            }
            off = {
                seed: results[row, seed, name] for seed in applies if (row, seed, name) in results
            }
            pairs = [
                (one, off.get(one.seed, one))
                for one in full
                if one.seed not in applies or one.seed in off
            ]
            cells.append(_cell([other for _, other in pairs]) if off else "" if applies else "-")
            if off:
                ratios[name].append(
                    median(other.rms for _, other in pairs) / median(one.rms for one, _ in pairs)
                )
        lines.append(cells)
    spread = {name: sorted(ratio) or [1.0] for name, ratio in ratios.items()}
    lines.append(["median ratio of RMS", "1", *(f"{median(spread[name]):.2f}" for name in NAMES)])
    lines.append(
        [
            "least and largest",
            "1",
            *(f"{spread[name][0]:.2f}, {spread[name][-1]:.2f}" for name in NAMES),
        ]
    )
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def _cell(results: list[Result]) -> str:
    if not results:
        return ""
    rms, turn_sd, cut = (
        median(getattr(one, name) for one in results) for name in ("rms", "turn_sd", "at_limit")
    )
    kept = sum(one.kept for one in results)
    of = sum(one.of for one in results)
    limit = f", {100 * cut:.0f} %" if cut >= 0.005 else ""
    return f"{rms:.2f}, {turn_sd:.1f}{limit}{'' if kept == of else f' (kept {kept} of {of})'}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=240.0)
    parser.add_argument("--table", action="store_true")
    options = parser.parse_args()
    if options.table:
        print(table(read(options.results)))
        return
    began = time.monotonic()
    while time.monotonic() - began < options.seconds:
        jobs = list(islice(due(read(options.results)), AHEAD))
        if not jobs:
            print("all flown")
            return
        result = random.choice(jobs)()
        with options.results.open("a") as file:
            file.write(json.dumps(asdict(result)) + "\n")
        print(result, flush=True)


if __name__ == "__main__":
    main()
