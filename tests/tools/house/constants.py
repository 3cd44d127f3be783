"""python -m tests.tools.house.constants [--results FILE [--seconds T]] [--write]: the numeric constants of the product.

Each constant of a module with its value, unit and origin; for those of guidance and pilot the effect at half and at
double: relative change of radius RMS (last 40 s) and of the turn command's standard deviation (whole flight) in two
lockstep flights of the emulator. FILE keeps a line for each constant and factor, which is not flown again. A run ends
after T seconds. `--write` writes docs/constants.md; for an effect that FILE lacks, the page keeps its value.
"""

import argparse
import ast
import importlib
import importlib.machinery
import json
import multiprocessing
import random
import re
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from math import degrees, isfinite
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "constants.md"
PACKAGE = "circnav_mav"
MEASURED = "circnav_mav/guidance/", "circnav_mav/pilot/"
FIRST = (
    "turn_gain", "turn_response", "turn_monitor", "vector_field", "step", "watches", "side_slip", "lap_plan",
    "controller",
)  # fmt: skip
"""Modules with the constants that are flown first, because they act on the turn rate."""
FACTORS = 0.5, 2.0
NONE = 0.01
"""Relative change below which a constant has no effect."""
NAME = re.compile(r"_?[A-Z][A-Z0-9_]*")
UNITS = (
    "rad/s^2", "rad/s", "deg/s", "m/s^2", "m^2/s^3", "(rad/s)^2", "rad^2/s", "rad/m", "m/s", "1/s", "1/m", "Hz", "rad",
    "degrees", "deg", "bytes", "lines", "ms", "us", "km", "m", "s", "%", "K", "Pa", "bins", "samples", "pixels",
)  # fmt: skip
UNIT = re.compile(rf"(?:[,(]|^| in) ?({'|'.join(map(re.escape, UNITS))})(?=[,.:;)]|$| )")
SHARE = re.compile(r"\b(share|fraction|in units of|ratio|gains? of|weight|gain)\b", re.IGNORECASE)
FLIGHTS: dict[str, tuple[str, ...]] = {
    "plane": (
        "arduplane", "orbit.radius_m=150.0", "vehicle.speed_mps=22.0", "sim.wind.speed_mps=5",
        "sim.wind.gust_rms_mps=0.7", "sim.ranging.outlier_fraction=0.03", "sim.ranging.dropout_fraction=0.1"),
    "copter": (
        "arducopter", "orbit.radius_m=30.0", "vehicle.speed_mps=5.0", "sim.wind.speed_mps=5",
        "sim.wind.gust_rms_mps=0.4"),
}  # fmt: skip
"""Flights: a plane with lost and false ranges, and a copter, in wind and gusts."""
LASTS, JUDGED = 90.0, 40.0
"""Duration of a flight, and its last part in which the radius is judged, s."""


@dataclass(frozen=True)
class Constant:
    """module: path in the repository. value: as Python prints it. origin: text of the docstring or comment."""

    module: str
    name: str
    value: str
    origin: str

    @property
    def unit(self) -> str:
        """Unit named in the origin; empty if it names none."""
        found = UNIT.search(self.origin)
        return found.group(1) if found else "share" if SHARE.search(self.origin) else ""

    @property
    def key(self) -> str:
        """Name of the constant in the results, independent of its folder."""
        return f"{Path(self.module).stem}.{self.name}={self.value}"


# --- finding


def constants(module: str) -> list[Constant]:
    """Return the numeric constants of a module (path in the repository). Imports it for their values."""
    text = (ROOT / module).read_text()
    loaded = importlib.import_module(module.removesuffix(".py").replace("/", ".").removesuffix(".__init__"))
    lines, body = text.splitlines(), [one for one in ast.parse(text).body if not fills_in(one)]
    found = []
    for statement, after in zip(body, [*body[1:], None], strict=False):
        for name, expression in assigned(statement):
            value = getattr(loaded, name, None)
            if numeric(value) and has_number(expression):
                found.append(Constant(module, name, shown(value), said(statement, after, lines)))
    return found


def assigned(statement: ast.stmt) -> Iterator[tuple[str, ast.expr]]:
    """Yield each constant that a statement assigns, with its expression. Indices of array rows (a `range`, an
    enumeration) are not constants."""
    if not isinstance(statement, ast.Assign | ast.AnnAssign) or statement.value is None:
        return
    target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
    pairs = [(target, statement.value)]
    if isinstance(target, ast.Tuple) and isinstance(statement.value, ast.Tuple):
        pairs = list(zip(target.elts, statement.value.elts, strict=True))
    for one, value in pairs:
        if isinstance(one, ast.Name) and NAME.fullmatch(one.id):
            yield one.id, value


def fills_in(statement: ast.stmt) -> bool:
    """True for `A[...] = ...`, which may come between an array and its docstring."""
    return isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Subscript)


def has_number(expression: ast.expr) -> bool:
    """True if the expression contains a number. An expression of other names only is not a separate constant."""
    numbers = (node.value for node in ast.walk(expression) if isinstance(node, ast.Constant))
    return any(isinstance(value, int | float | complex) and not isinstance(value, bool) for value in numbers)


def numeric(value: object) -> bool:
    """True for a number, or a tuple or array of numbers."""
    if isinstance(value, tuple):
        return type(value) is tuple and bool(value) and all(map(numeric, value))
    return type(value) in (int, float, complex) or (isinstance(value, np.ndarray) and value.dtype.kind in "ifc")


def shown(value: Any) -> str:
    """Return a value as the table shows it."""
    text = f"{value:.6g}" if isinstance(value, float) else str(value) if isinstance(value, int) else _list(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _list(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"array {'x'.join(map(str, value.shape))}"
    return f"({', '.join(map(shown, value))})" if isinstance(value, tuple) else f"{value:.4g}"


def said(statement: ast.stmt, after: ast.stmt | None, lines: list[str]) -> str:
    """Return the docstring under a statement, else the comment beside it or above it, else an empty text."""
    if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str):
        return " ".join(after.value.value.split())
    beside = lines[statement.end_lineno - 1].partition("  # ")[2]
    above = lines[statement.lineno - 2].strip()
    comment = beside or (above[1:] if above.startswith("#") and not above.startswith("# ---") else "")
    return "" if comment.strip().startswith(("fmt:", "noqa", "type:")) else comment.strip()


def all_constants() -> list[Constant]:
    """Return the constants of the whole product, without the bundled emulator and missions."""
    paths = [path.relative_to(ROOT) for path in sorted((ROOT / PACKAGE).rglob("*.py")) if path.name != "__main__.py"]
    return [one for path in paths for one in constants(path.as_posix())]


# --- flying at half and at double


class Scaled(importlib.machinery.SourceFileLoader):
    """Loads a module with one constant multiplied before any use."""

    def __init__(self, fullname: str, path: str, name: str, factor: float) -> None:
        super().__init__(fullname, path)
        self._name, self._factor = name, factor

    def get_code(self, fullname: str) -> Any:
        path = self.get_filename(fullname)
        tree = ast.parse(self.get_data(path))
        for statement in tree.body:
            for name, value in assigned(statement):
                if name == self._name:
                    multiply(statement, value, self._factor)
        return compile(ast.fix_missing_locations(tree), path, "exec")


def multiply(statement: ast.stmt, value: ast.expr, factor: float) -> None:
    """Replace a value in its statement by the scaled value."""
    call = ast.parse(f"__import__({__name__!r}, fromlist=['scaled']).scaled(0, {factor})", mode="eval").body
    assert isinstance(call, ast.Call)
    assert isinstance(statement, ast.Assign | ast.AnnAssign)
    call.args[0] = value
    if statement.value is value:
        statement.value = call
    elif isinstance(statement.value, ast.Tuple):
        statement.value.elts = [call if one is value else one for one in statement.value.elts]


def scaled(value: Any, factor: float) -> Any:
    """Return a number, or numbers, times a factor. Counts remain integers of at least 1."""
    if isinstance(value, tuple):
        return tuple(scaled(one, factor) for one in value)
    if isinstance(value, int) and not isinstance(value, bool):
        return max(1, round(value * factor)) if value > 0 else round(value * factor)
    return value * factor


class Finder:
    """Finds one module so that `Scaled` loads it."""

    def __init__(self, module: str, name: str, factor: float) -> None:
        self._module, self._name, self._factor = module, name, factor

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        if fullname != self._module:
            return None
        file = str(ROOT / (fullname.replace(".", "/") + ".py"))
        return importlib.machinery.ModuleSpec(fullname, Scaled(fullname, file, self._name, self._factor), origin=file)


Flown = dict[str, tuple[float, float]]
"""Radius RMS, m, and standard deviation of the turn command, deg/s, by flight."""


def fly(module: str = "", name: str = "", factor: float = 1.0) -> Flown:
    """Fly with one constant scaled. Runs in a process that has not loaded the product."""
    if module:
        finder: Any = Finder(module.removesuffix(".py").replace("/", "."), name, factor)
        sys.meta_path.insert(0, finder)
    from tests.flight.lockstep import flight, rms_error

    results = {}
    for flown_by, (mission, *changes) in FLIGHTS.items():
        one = flight(mission, *changes, "sim.seed=1", f"limits.duration_s={LASTS + 5}", law="auto").fly(LASTS)
        turns = [tick.turn_rate for tick in one.ticks if tick.turn_rate is not None]
        late = [truth for truth in one.truths if truth.time > LASTS - JUDGED]
        kept = one.now >= LASTS - 1 and late and turns
        radius = one.pilot.settings.orbit.radius
        results[flown_by] = (rms_error(late, radius), degrees(float(np.std(turns)))) if kept else (np.inf, np.inf)
    return results


def functions_run() -> set[tuple[str, int]]:
    """Return files and first lines of the functions that run in the flights."""
    run: set[tuple[str, int]] = set()
    sys.setprofile(lambda frame, kind, _: run.add((frame.f_code.co_filename, frame.f_code.co_firstlineno)))
    try:
        fly()
    finally:
        sys.setprofile(None)
    return {(Path(file).relative_to(ROOT).as_posix(), line) for file, line in run if file.startswith(str(ROOT))}


def reached(every: list[Constant], run: set[tuple[str, int]]) -> set[str]:
    """Return names of constants that are used by a function that runs, or at import. A constant used only in another
    constant counts if that constant does."""
    users: dict[str, set[str]] = {}
    used: set[str] = set()
    for module in {one.module for one in every}:
        for statement in ast.parse((ROOT / module).read_text()).body:
            names = [name for name, _ in assigned(statement)]
            for part in [statement] if names else _parts(statement):
                seen = {node.id for node in ast.walk(part) if isinstance(node, ast.Name)}
                seen |= {node.attr for node in ast.walk(part) if isinstance(node, ast.Attribute)}
                for name in seen - set(names):
                    users.setdefault(name, set()).update(names)
                first = min([part.lineno, *(one.lineno for one in getattr(part, "decorator_list", ()))])
                if not names and (not isinstance(part, ast.FunctionDef) or (module, first) in run):
                    used |= seen
    while more := {name for name, makes in users.items() if makes & used} - used:
        used |= more
    return used


def _parts(statement: ast.stmt) -> Iterator[ast.stmt]:
    """Yield a statement, or the statements of a class."""
    if isinstance(statement, ast.ClassDef):
        for one in statement.body:
            yield from _parts(one)
    else:
        yield statement


def apart(function: Any, *given: Any) -> Any:
    """Return the result of a function run in a separate process."""
    with multiprocessing.get_context("fork").Pool(1) as pool:
        return pool.apply(function, given)


def measure(path: Path, seconds: float, tell: Any = print) -> None:
    """Fly the jobs without a result, until the time is over."""
    began, every = time.monotonic(), apart(all_constants)
    here = [one for one in every if one.module.startswith(MEASURED)]
    done = read(path)
    if "base" not in done:
        note(path, "base", apart(fly))
        done = read(path)
    if "reached" not in done:
        note(path, "reached", sorted(reached(every, apart(functions_run))))
        done = read(path)
    jobs = [(one, factor) for one in here if one.name in done["reached"] for factor in FACTORS]
    random.shuffle(jobs)  # so that two parallel runs seldom fly the same job
    for one, factor in sorted(jobs, key=lambda job: Path(job[0].module).stem not in FIRST):
        key = f"{one.key} x{factor:g}"
        if key in read(path):
            continue
        if time.monotonic() - began > seconds:
            return
        try:
            flown: object = apart(partial(fly, one.module, one.name, factor))
        except Exception as error:  # any failure is the effect of the changed constant
            flown = f"{type(error).__name__}: {error}"[:80]
        note(path, key, flown)
        tell(key, flown, flush=True)
    tell("all flown")


def note(path: Path, key: str, what: object) -> None:
    with path.open("a") as file:
        file.write(json.dumps([key, what]) + "\n")


def read(path: Path | None) -> dict[str, Any]:
    """Return the stored results."""
    lines = path.read_text().splitlines() if path is not None and path.exists() else []
    return dict(json.loads(line) for line in lines)


# --- the page


def effect(flown: Any, base: Flown) -> str:
    """Return the larger change of the two flights, of radius RMS and of turn, in percent."""
    if isinstance(flown, str):
        return "fails"
    changes = [[flown[row][i] / base[row][i] - 1 for row in base] for i in (0, 1)]
    rms, turn = (max(change, key=abs) for change in changes)
    if not (isfinite(rms) and isfinite(turn)):
        return "no circle"
    return "none" if max(abs(rms), abs(turn)) < NONE else f"{100 * rms:+.0f}, {100 * turn:+.0f} %"


def effects(one: Constant, done: dict[str, Any], page: dict[tuple[str, str], str]) -> str:
    """Return the effects of a constant, as the table shows them. Without a flight, use the effects on the old page."""
    flown = [done.get(f"{one.key} x{factor:g}") for factor in FACTORS]
    if None not in flown and "base" in done:
        told = [effect(each, done["base"]) for each in flown]
        return "none" if set(told) == {"none"} else "; ".join(told)
    if not one.module.startswith(MEASURED):
        return ""
    if "reached" in done and one.name not in done["reached"]:
        return "not used there"
    return page.get((one.name, one.value), "not flown")


def before(text: str) -> dict[tuple[str, str], str]:
    """Return the effects on a page, by name and value."""
    rows = [[cell.strip() for cell in line.split("|")] for line in text.splitlines() if line.startswith("| `")]
    return {(row[1].strip("`"), row[3]): row[5] for row in rows if len(row) > 5}


HEAD = """# Constants

Every numeric constant of the product's modules, made by `python -m tests.tools.house.constants --write`. Effect, for
guidance and pilot: change of radius RMS and of the turn command's standard deviation at half; at double the value, the
larger of two lockstep flights of the emulator (plane and copter in 5 m/s of wind with gusts, the plane with 10 % of its
ranges lost and 3 % false; one seed). `none`: below 1 %. `not used there`: the flights do not reach it. A constant that
guards against what these flights do not hold shows no effect, and its origin says what it is for.

"""


def page(every: list[Constant], done: dict[str, Any], old: str) -> str:
    """Return the page in Markdown, with a table for each folder."""
    parts, kept = [HEAD], before(old)
    without = sum(not one.origin for one in every)
    parts.append(f"{len(every)} constants, {without} without origin.\n")
    for folder in sorted({str(Path(one.module).parent) for one in every}):
        parts.append(f"\n## {folder}\n\n| name | file | value | unit | effect | origin |\n|---|---|---|---|---|---|\n")
        for one in every:
            if str(Path(one.module).parent) == folder:
                origin = one.origin.replace("|", "\\|") or "none"
                cells = f"`{one.name}`", Path(one.module).name, one.value, one.unit, effects(one, done, kept), origin
                parts.append(f"| {' | '.join(cells)} |\n")
    return "".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", type=Path)
    parser.add_argument("--seconds", type=float, default=0.0)
    parser.add_argument("--write", action="store_true", help="write docs/constants.md")
    options = parser.parse_args()
    if options.results is not None and options.seconds > 0:
        measure(options.results, options.seconds)
    every = apart(all_constants)
    if options.write:
        PAGE.write_text(page(every, read(options.results), PAGE.read_text() if PAGE.exists() else ""))
    for one in every:
        if not one.origin:
            print(f"{one.module}: {one.name} = {one.value}: no origin")
    print(f"{len(every)} constants, {sum(not one.origin for one in every)} without origin")


if __name__ == "__main__":
    main()
