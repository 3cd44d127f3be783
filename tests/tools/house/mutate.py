"""python -m tests.tools.house.mutate [FOLDER...] [--count N] [--seed S] [--keep FILE] [--seconds T] [--also PATH...]

Breaks the product in N small ways per room, one at a time, in a copy of the checkout, and shows which test notices.
FOLDER: rooms of the product or files in them (circnav_mav/guidance, mav and pilot if none is given). The tests of a
room are those in tests/ROOM; `--also` adds files or folders, which run after them. A first run without a mutation
records the functions that each test calls. A mutant in a function is judged by the tests that call it, the fastest
first. A mutant outside functions is judged by all tests, those that call functions of its module first. Tests that fail
without a mutation do not count.

Two commits are compared with `--checkout`, or with `--tests` for another checkout's tests on the same product. The draw
orders all mutations by a hash of seed, file name, function and text: what did not change is drawn in both.
`--keep FILE` keeps a line for each mutant; what is there is not run again. The record of the first run
is kept beside it (FILE's name with .ROOM.json): remove it when tests change.
"""

import argparse
import ast
import contextlib
import hashlib
import importlib
import json
import multiprocessing
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
ROOMS = "circnav_mav/guidance", "circnav_mav/mav", "circnav_mav/pilot"
COPIED = "circnav_mav", "sim", "config", "docs", "tests"
LINKS = {"circnav_sim": "sim", "circnav_mav/config": "../config"}
"""Packages as they are installed. Without these links, an editable installation would lend its own."""
GRACE, PATIENCE = 30.0, 6.0
"""A mutant's tests time out after GRACE seconds and PATIENCE times their recorded duration."""
MEMORY = 8 << 30
"""Address space of a process of tests, bytes: a loop that no longer ends must not fill the machine."""
PLUGIN = "mutate_plugin"
FORK = multiprocessing.get_context("fork")

COMPARED: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE), ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
}  # fmt: skip
"""Comparison and what replaces it: the bound that moves by one value, and the opposite."""
COMPUTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult, ast.Pow: ast.Mult,
}  # fmt: skip
SWAPPED = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all", "all": "any"}
UNMUTATED_FUNCTIONS = {"__repr__", "__str__"}
UNMUTATED_KEYWORDS = {"strict", "frozen", "slots", "repr", "stacklevel"}
LOGGERS = {"log", "logger", "logging", "warnings"}


@dataclass(frozen=True)
class Mutant:
    """path: in the checkout. start, end: bytes of the file that text replaces. function: first line of the innermost
    function, 0 outside functions and in cached ones."""

    path: str
    line: int
    start: int
    end: int
    text: str
    what: str
    function: int
    key: str

    @property
    def name(self) -> str:
        """Place and change as printed, on one line."""
        what = " ".join(self.what.split())
        return f"{self.path}:{self.line}  {what if len(what) <= 130 else what[:127] + '...'}"

    def applied(self, source: bytes) -> bytes:
        """Return the source of the mutated file."""
        return source[: self.start] + self.text.encode() + source[self.end :]


class Finder(ast.NodeVisitor):
    """Collects the mutations of one file. Texts, annotations, decorators and logging stay as they are."""

    def __init__(self, path: str, source: bytes, seed: int) -> None:
        self.path, self.source, self.seed = path, source, seed
        self.found: list[Mutant] = []
        self._starts = [0]
        for line in source.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))
        self._names: list[str] = []
        self._function = 0
        self._bound: set[str] | None = None
        """Names that the function has assigned so far; None outside functions."""
        self._repeated: Counter[str] = Counter()
        self.visit(ast.parse(source))

    def _add(self, node: ast.expr | ast.stmt, kind: str, new: ast.AST | str) -> None:
        start = self._starts[node.lineno - 1] + node.col_offset
        end = self._starts[(node.end_lineno or node.lineno) - 1] + (node.end_col_offset or 0)
        text = new if isinstance(new, str) else ast.unparse(ast.fix_missing_locations(new))
        what = f"{kind}: {ast.unparse(node)} -> {text}"
        place = f"{self.seed}|{Path(self.path).name}|{'.'.join(self._names)}|{what}"
        self._repeated[place] += 1
        key = hashlib.sha256(f"{place}|{self._repeated[place]}".encode()).hexdigest()
        written = f"({text})" if isinstance(new, ast.expr) else text
        self.found.append(Mutant(self.path, node.lineno, start, end, written, what, self._function, key))

    # --- scopes

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        if node.name in UNMUTATED_FUNCTIONS:
            return
        for default in [*node.args.defaults, *node.args.kw_defaults]:
            if default is not None:
                self.visit(default)
        kept = self._function, self._bound
        cached = any("cache" in ast.unparse(one) for one in node.decorator_list)
        self._function = 0 if cached else min([node.lineno, *(one.lineno for one in node.decorator_list)])
        self._bound = {one.arg for one in [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]}
        self._names.append(node.name)
        for part in node.body:
            self.visit(part)
        self._names.pop()
        self._function, self._bound = kept

    visit_AsyncFunctionDef = visit_FunctionDef  # noqa: N815

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        kept = self._function, self._bound
        self._function, self._bound = 0, None
        self._names.append(node.name)
        for part in node.body:
            self.visit(part)
        self._names.pop()
        self._function, self._bound = kept

    # --- statements

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call) and not logs(node.value):
            if self._bound is not None:
                self._add(node, "removed", "pass")
            self.visit(node.value)
        elif isinstance(node.value, ast.Yield | ast.YieldFrom | ast.Await):
            self.visit(node.value)

    def visit_Assign(self, node: ast.Assign) -> None:
        names = {one.id for target in node.targets for one in ast.walk(target) if isinstance(one, ast.Name)
                 and isinstance(one.ctx, ast.Store)}  # fmt: skip
        if self._bound is not None:
            if names <= self._bound:
                self._add(node, "removed", "pass")
            self._bound |= names
        self.visit(node.value)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self._add(node, "removed", "pass")
        if type(node.op) in COMPUTED and not textual(node.value):
            self._add(node, "arithmetic", ast.AugAssign(node.target, COMPUTED[type(node.op)](), node.value))
        self.visit(node.value)

    def visit_Raise(self, node: ast.Raise) -> None:
        if node.exc is not None:
            self._add(node, "removed", "pass")

    def visit_Assert(self, node: ast.Assert) -> None:
        pass

    def visit_match_case(self, node: ast.match_case) -> None:
        for part in [*([node.guard] if node.guard else []), *node.body]:
            self.visit(part)

    def visit_If(self, node: ast.If | ast.While | ast.IfExp) -> None:
        if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            return
        if not isinstance(node.test, ast.Constant | ast.Compare):
            self._add(node.test, "negated", ast.UnaryOp(ast.Not(), node.test))
        self.generic_visit(node)

    visit_While = visit_If  # noqa: N815
    visit_IfExp = visit_If  # noqa: N815

    # --- expressions

    def visit_Compare(self, node: ast.Compare) -> None:
        for place, operator in enumerate(node.ops):
            for other in COMPARED[type(operator)]:
                ops = [*node.ops[:place], other(), *node.ops[place + 1 :]]
                self._add(node, "comparison", ast.Compare(node.left, ops, node.comparators))
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        if type(node.op) in COMPUTED and not textual(node.left) and not textual(node.right):
            self._add(node, "arithmetic", ast.BinOp(node.left, COMPUTED[type(node.op)](), node.right))
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.USub | ast.Not):
            self._add(node, "sign" if isinstance(node.op, ast.USub) else "negated", node.operand)
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        self._add(node, "boolean", ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values))
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        if logs(node):
            return
        function = node.func
        if isinstance(function, ast.Name) and function.id in SWAPPED:
            self._add(function, "swapped", ast.Name(SWAPPED[function.id], ast.Load()))
        elif isinstance(function, ast.Attribute) and function.attr in SWAPPED:
            other = ast.Attribute(function.value, SWAPPED[function.attr], ast.Load())
            self._add(function, "swapped", other)
        self.generic_visit(node)

    def visit_keyword(self, node: ast.keyword) -> None:
        if node.arg not in UNMUTATED_KEYWORDS:
            self.visit(node.value)

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, bool):
            self._add(node, "constant", repr(not node.value))
        elif isinstance(node.value, int):
            self._add(node, "constant", repr(node.value + 1))
        elif isinstance(node.value, float):
            self._add(node, "constant", repr(2 * node.value or 1.0))

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        pass


def logs(call: ast.Call) -> bool:
    """True for a call of a logger."""
    first: ast.expr = call.func
    while isinstance(first, ast.Attribute):
        first = first.value
    return isinstance(first, ast.Name) and first.id.lower().lstrip("_") in LOGGERS


def textual(node: ast.expr) -> bool:
    """True for a string or bytes literal: no arithmetic is done with it."""
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str | bytes))


def draw(checkout: Path, folder: str, seed: int, count: int) -> list[Mutant]:
    """Return `count` mutants of a folder or file, drawn by the hash of seed and mutant."""
    found: list[Mutant] = []
    whole = checkout / folder
    for path in [whole] if whole.is_file() else sorted(whole.rglob("*.py")):
        found += Finder(str(path.relative_to(checkout)), path.read_bytes(), seed).found
    return sorted(found, key=lambda mutant: mutant.key)[:count]


# --- running


@dataclass
class Copy:
    """A copy of a checkout in which mutants are tested. calls: tests (or files of tests, for their fixtures) by the
    function that they call. seconds: duration of each test."""

    folder: Path
    tests: tuple[str, ...]
    calls: dict[tuple[str, int], set[str]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    failed: list[str] = field(default_factory=list)

    @classmethod
    def make(cls, checkout: Path, tests_of: Path, folder: Path, tests: Iterable[str]) -> "Copy":
        """Copy product and tests, and the plugin beside them."""
        ignored = shutil.ignore_patterns("__pycache__", ".*")
        for name in COPIED:
            source = (tests_of if name == "tests" else checkout) / name
            if source.is_dir():
                shutil.copytree(source, folder / name, ignore=ignored)
        for path in checkout.iterdir():
            if path.is_file():
                shutil.copy(path, folder)
        for name, target in LINKS.items():
            if (folder / name).parent.is_dir() and not (folder / name).exists():
                (folder / name).symlink_to(target)
        shutil.copy(Path(__file__).with_name(f"{PLUGIN}.py"), folder)
        return cls(folder, tuple(tests))

    def _pytest(self, paths: Iterable[str], timeout: float | None, *options: str, **environment: str) -> str | None:
        """Return what pytest prints at its end; empty if all tests pass, None after the timeout. Pytest runs in a fork:
        libraries that this process has imported need not be imported for each mutant."""
        printed = self.folder / "printed.txt"
        arguments = ["-n", "0", "-p", "no:cacheprovider", "-p", PLUGIN, "--tb=no", *options, *paths]
        process = FORK.Process(target=in_copy, args=(self.folder, printed, environment, arguments))
        process.start()
        try:
            process.join(timeout)
            if process.is_alive():
                return None
        finally:
            if process.is_alive():
                os.killpg(process.pid or 0, signal.SIGKILL)
                process.join()
        return printed.read_text(encoding="utf-8", errors="replace") + "\n" if process.exitcode else ""

    def record(self, kept: Path | None) -> None:
        """Run all tests without a mutation and keep which functions each of them calls. A kept record is read."""
        file = self.folder / "recorded.json"
        if kept and kept.exists():
            shutil.copy(kept, file)
        else:
            printed = self._pytest(self.tests, None, MUTATE_RECORD=str(file))
            if not file.exists():
                sys.exit(f"The tests do not run: {printed}")
            if kept:
                shutil.copy(file, kept)
        found = json.loads(file.read_text(encoding="utf-8"))
        self.seconds, self.failed = found["seconds"], found["failed"]
        for where, calls in found["called"].items():
            for path, line in calls:
                self.calls.setdefault((path, line), set()).add(where)
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        for name in found["libraries"]:
            with contextlib.suppress(Exception):
                importlib.import_module(name)

    def chosen(self, mutant: Mutant) -> list[str]:
        """Return the tests for a mutant in the order in which they run."""
        callers = self.calls.get((mutant.path, mutant.function), set()) if mutant.function else set()
        if not mutant.function or "import" in callers:
            near = set().union(*(who for (path, _), who in self.calls.items() if path == mutant.path))
            names = list(self.seconds)
        else:
            near, names = callers, [name for name in self.seconds if {name, name.split("::")[0]} & callers]

        def order(name: str) -> tuple[int, bool, float]:
            place = next((n for n, path in enumerate(self.tests) if name.startswith(path)), len(self.tests))
            return min(place, 1), name not in near, self.seconds[name]

        return sorted((name for name in names if name not in self.failed), key=order)

    def judge(self, mutant: Mutant) -> str:
        """Return the first test that fails with the mutant applied, `survived`, `not called` or `timeout`."""
        names = self.chosen(mutant)
        if not names:
            return "not called"
        path, chosen = self.folder / mutant.path, self.folder / "chosen.json"
        chosen.write_text(json.dumps(names), encoding="utf-8")
        source = path.read_bytes()
        timeout = GRACE + PATIENCE * sum(self.seconds[name] for name in names)
        try:
            path.write_bytes(mutant.applied(source))
            files = dict.fromkeys(name.split("::")[0] for name in names)
            printed = self._pytest(files, timeout, "-x", MUTATE_CHOSEN=str(chosen))
        finally:
            path.write_bytes(source)
        if not printed:
            return "timeout" if printed is None else "survived"
        found = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", printed, re.MULTILINE)
        return found.group(1) if found else "import"


def in_copy(folder: Path, printed: Path, environment: dict[str, str], arguments: list[str]) -> None:
    """Run pytest in a copy of the checkout and exit with its code. Runs in a process of its own."""
    os.setsid()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    with printed.open("wb") as file:
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
    os.environ.update(environment, PYTHONPATH=str(folder), PYTHONDONTWRITEBYTECODE="1")
    os.chdir(folder)
    sys.dont_write_bytecode = True
    sys.path[:] = [str(folder), *(path for path in sys.path if path and Path(path) != ROOT)]
    for name in [name for name in sys.modules if name.split(".")[0] in ("tests", "circnav_mav", "circnav_sim")]:
        del sys.modules[name]
    importlib.invalidate_caches()
    sys.exit(pytest.main(arguments))


# --- results


def table(results: dict[str, dict[str, str]]) -> Iterator[str]:
    """Yield the shares of each room: results by room and by mutant."""
    headings = "by room", "elsewhere", "timeout", "survived", "not called", "noticed"
    yield f"{'room':<12}{'mutants':>9}" + "".join(f"{heading:>12}" for heading in headings)
    everything = {f"{room} {key}": who for room, judged in results.items() for key, who in judged.items()}
    for room, judged in [*results.items(), ("all", everything)]:
        counts = Counter(judged.values())
        lost = counts["survived"] + counts["not called"]
        elsewhere = sum(who.startswith("tests/") and not any(who.startswith(f"tests/{one}/") for one in results)
                        for who in judged.values())  # fmt: skip
        by_room = len(judged) - lost - counts["timeout"] - elsewhere
        share = 100 * (1 - lost / max(len(judged), 1))
        cells = by_room, elsewhere, counts["timeout"], counts["survived"], counts["not called"], f"{share:.0f} %"
        yield f"{room:<12}{len(judged):>9}" + "".join(f"{cell:>12}" for cell in cells)


def run(options: argparse.Namespace) -> dict[str, dict[str, str]]:
    """Judge the mutants of each folder and print one line for each. Return the results by room and key."""
    ends = time.monotonic() + options.seconds
    kept: dict[str, str] = {}
    if options.keep and options.keep.exists():
        for line in options.keep.read_text(encoding="utf-8").splitlines():
            kept.update([json.loads(line)])
    results: dict[str, dict[str, str]] = {}
    for folder in options.folders or ROOMS:
        room = Path(folder).parts[1]
        mutants, copy = draw(options.checkout, folder, options.seed, options.count), None
        judged = results.setdefault(room, {})
        with tempfile.TemporaryDirectory(prefix="mutate-") as temporary:
            for mutant in mutants:
                who = kept.get(mutant.key)
                if who is None and time.monotonic() < ends:
                    if copy is None:
                        paths = [f"tests/{room}", *options.also]
                        copy = Copy.make(options.checkout, options.tests, Path(temporary), paths)
                        copy.record(options.keep and options.keep.with_suffix(f".{room}.json"))
                        print(f"# {room}: {len(copy.seconds)} tests pass unmutated, failing: {copy.failed}", flush=True)
                    who = copy.judge(mutant)
                    if options.keep:
                        with options.keep.open("a", encoding="utf-8") as file:
                            file.write(json.dumps([mutant.key, who]) + "\n")
                if who is not None:
                    judged[mutant.key] = who
                    verdict = who if who in ("survived", "not called", "timeout") else f"killed by {who}"
                    print(f"{mutant.name}\n    {verdict}", flush=True)
    return results


def main(arguments: list[str]) -> None:
    """Judge the mutants, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*")
    parser.add_argument("--count", type=int, default=40, help="mutants of each folder")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="begin no mutant after this time")
    parser.add_argument("--also", nargs="*", default=[], help="tests to run in addition to those of the room")
    parser.add_argument("--checkout", type=Path, default=ROOT, help="checkout with the product")
    parser.add_argument("--tests", type=Path, help="checkout with the tests; that of the product if not given")
    options = parser.parse_args(arguments)
    options.checkout = options.checkout.resolve()
    options.tests = (options.tests or options.checkout).resolve()
    print("\n" + "\n".join(table(run(options))))


if __name__ == "__main__":
    main(sys.argv[1:])
