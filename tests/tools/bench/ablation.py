"""The benefit of each layer on the turn.

    python -m tests.tools.bench.ablation --keep runs/ablation.jsonl --minutes 60

One layer at a time is disabled by replacing its function. Flights of the emulated vehicles (rows of
docs/measured.md) and rows of the benchmark are flown with and without the layer, with the same
seeds.

In a flight with all layers, each result of a layer is compared with the result without this layer.
If they never differ, the layer does not change this flight, so the flight without the layer is not
flown.
"""

import inspect
import sys
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial, wraps
from math import inf
from statistics import median
from typing import Any

from circnav_mav.extras.bench.bench import cell_of, fly_one
from circnav_mav.extras.bench.situations import SITUATIONS, Situation
from tests.tools import cells
from tests.tools.cells import Result
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


def fly_row(row: str, seed: int) -> Result:
    """Fly a row of the emulated vehicles with all layers, then without each layer that acted."""
    acted: set[str] = set()
    radius = CIRCLES[FLIGHTS[row][0]][0]

    def flown() -> Result:
        one = fly(row, seed, count=LAPS, rows=FLIGHTS)
        kept = one.right and one.rms < KEPT * radius and one.worst < NEVER * radius
        return figures(one.rms, one.turn_sd, one.at_limit, int(kept), 1)

    with noted(acted):
        found = {FULL: flown()}
    for layer in LAYERS:
        if layer.name in acted:
            with without(layer):
                found[layer.name] = flown()
    return {"layers": found}


def fly_bench(row: str, seed: int) -> Result:
    """Fly a row of the benchmark with all layers, then without each layer that it has."""

    def flown(situation: Situation) -> Result:
        rows = [fly_one(situation, "auto", seed, number) for number in range(BENCH_FLIGHTS)]
        cell = cell_of(rows, rows)
        turn = cell.turn_std_deg_s, cell.turn_at_limit
        return figures(cell.rms_median, *turn, cell.kept, cell.flights)

    situation = replace(SITUATIONS[row], duration=LASTS)
    found = {FULL: flown(situation)}
    for layer in LAYERS:
        if layer.name == ACCELERATIONS and situation.imu is not None:
            found[layer.name] = flown(replace(situation, imu=None))
        elif layer.bench:
            with without(layer):
                found[layer.name] = flown(situation)
    return {"layers": found}


def figures(rms: float, turn_sd: float, at_limit: float, kept: int, of: int) -> Result:
    """Return the figures of a flight or benchmark row: radius error, m; standard deviation of the
    turn command, deg/s; share of commands at the limit; flights that kept the circle; flights."""
    return {"rms": rms, "turn_sd": turn_sd, "at_limit": at_limit, "kept": kept, "of": of}


def table(results: dict[str, list[Result]]) -> str:
    """Return the table in Markdown. A cell contains the median radius RMS, m, the standard
    deviation of the turn command, deg/s, and the share of commands at the limit if it is 1 % or
    more. A dash: the layer changed no result, or the row has not been flown."""
    lines = []
    spread: dict[str, list[float]] = {name: [] for name in NAMES}
    for row, flights in results.items():
        pairs = {name: _with_and_without(name, flights) for name in NAMES}
        full = [one["layers"][FULL] for one in flights]
        title = row if row in FLOWN else f"benchmark: {row}"
        lines.append([title, _cell(full), *(_cell(off) for _, off in pairs.values())])
        for name, (on, off) in pairs.items():
            if off:
                spread[name].append(_median(off, "rms") / _median(on, "rms"))
    ratios = [sorted(values) or [1.0] for values in spread.values()]
    lines.append(["median ratio of RMS", "1", *(f"{median(one):.2f}" for one in ratios)])
    lines.append(["least and largest", "1", *(f"{one[0]:.2f}, {one[-1]:.2f}" for one in ratios)])
    return cells.table(" | ".join(("row", FULL, *NAMES)), lines)


def _with_and_without(name: str, flights: Sequence[Result]) -> tuple[list[Result], list[Result]]:
    """Return the figures of the flights with all layers, and without a layer. Both are empty if
    the layer acted in no flight."""
    layers = [one["layers"] for one in flights]
    if not any(name in one for one in layers):
        return [], []
    return [one[FULL] for one in layers], [one.get(name, one[FULL]) for one in layers]


def _median(flights: Sequence[Result], figure: str) -> float:
    return median(one[figure] for one in flights)


def _cell(flights: Sequence[Result]) -> str:
    if not flights:
        return "-"
    cut = _median(flights, "at_limit")
    limit = f", {100 * cut:.0f} %" if cut >= 0.005 else ""
    kept = sum(one["kept"] for one in flights)
    of = sum(one["of"] for one in flights)
    lost = "" if kept == of else f" (kept {kept} of {of})"
    return f"{_median(flights, 'rms'):.2f}, {_median(flights, 'turn_sd'):.1f}{limit}{lost}"


def main() -> None:
    given = vars(cells.parser(__doc__, (*FLOWN, *BENCHED), (1, 3)).parse_args())
    rows = given.pop("rows")
    flown = cells.flown(fly_row, Namespace(**given, rows=[one for one in rows if one in FLOWN]))
    given["seeds"] = (BENCH_SEED, BENCH_SEED)
    benched = [one for one in rows if one in BENCHED]
    print(table(flown | cells.flown(fly_bench, Namespace(**given, rows=benched))))


if __name__ == "__main__":
    main()
