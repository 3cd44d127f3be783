"""Measures the code base: `python -m tests.tools.house.measure [PACKAGE_FOLDER...]`, also for folders of an older
checkout.

Prints every figure about the code that the documentation contains.
"""

import ast
import os
import re
import subprocess
import sys
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

HERE = Path(__file__).parents[3]
PACKAGES = ("circnav_mav", "sim", "tests")
ALL, WRITTEN = ("circnav_mav", "sim", "tests", "docs", "config"), (".py", ".md", ".toml", ".html")
PRAGMA = re.compile(r"#\s*(noqa|type:|fmt:|ruff:)")
FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef
NAMED = {
    "law": ("smooth", "switching", "bounded", "relay", "pd", "pi", "feedforward"),
    "vehicle": ("arducopter", "arduplane", "ardurover", "px4copter", "px4plane"),
    "ranging message": ("rangingbeacon", "distancesensor", "namedvaluefloat"),
}
"""Options that a user selects by name. Laws are common words, so they count only in quotes."""

TRACE = """
import sys
from tests.flight.lockstep import flight
package, visited, heard, sent = sys.argv[1] + "/", set(), False, False
flown = flight("quickstart", law="auto").fly(20.0)
name = "answer" if hasattr(flown.pilot, "answer") else "step"  # of an older checkout
receive, step = flown.pilot.receive, getattr(flown.pilot, name)
def note(frame, kind, argument):
    path = frame.f_code.co_filename
    if kind == "call" and path.startswith(package):
        visited.add(path)
def traced(call, *arguments):
    sys.setprofile(note if heard and not sent else None)
    try:
        return call(*arguments)
    finally:
        sys.setprofile(None)
def hear(data, *rest):
    global heard
    if not heard and int.from_bytes(data[7:10], "little") in (132, 251, 513):  # a range
        heard = True
        return traced(receive, data, *rest)
    return receive(data, *rest)
def note_setpoint(data):
    global sent
    sent = sent or heard and int.from_bytes(data[7:10], "little") in (69, 82, 84)
    sys.setprofile(note if heard and not sent else None)
def speak(now, send=None):
    if send is None:  # of an older checkout
        note_setpoint(out := traced(step, now))
        sys.setprofile(None)
        return out
    traced(step, now, lambda data: (note_setpoint(data), send(data))[1])
flown.pilot.receive = hear
setattr(flown.pilot, name, speak)
while not sent and flown.now < 30:
    flown.fly(flown.now + 0.001)
assert sent
print(len(visited))
"""
"""Program that flies the quickstart of a checkout. It counts the package's files with a function called between a
received range and the next setpoint."""


@dataclass
class Count:
    """Counts of some files. public: functions and classes of modules. bodies: lines of each function's body without its
    docstring."""

    files: int = 0
    lines: int = 0
    public: int = 0
    comments: int = 0
    arguments: int = 0
    of_any: int = 0
    bodies: list[int] = field(default_factory=list)

    def row(self) -> list[str]:
        """Return the printed figures: names per 1,000 lines, comments per 100 lines."""
        lines, known = max(self.lines, 1), self.arguments
        return [
            f"{self.files}", f"{self.lines}", f"{1000 * self.public / lines:.1f}", f"{100 * self.comments / lines:.1f}",
            f"{100 * self.of_any / known:.0f} %" if known else "-", f"{median(self.bodies or [0]):.0f}",
        ]  # fmt: skip


HEADINGS = ("files", "lines", "public names per 1000", "comments per 100", "Any of arguments", "median body")


def measure(package: Path) -> dict[str, Count]:
    """Return the counts of a package, and of each folder in it."""
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(package.rglob("*.py"))}
    unknown = {"Any"} | {alias for tree in trees.values() for alias in _aliases_of_any(tree)}
    counts: dict[str, Count] = {}
    for path, tree in trees.items():
        inside = path.relative_to(package).parts
        rooms = [package.name, *([f"{package.name}/{inside[0]}"] if len(inside) > 1 else [])]
        for room in rooms:
            _add(counts.setdefault(room, Count()), path, tree, unknown)
    return counts


def _add(count: Count, path: Path, tree: ast.Module, unknown: set[str]) -> None:
    count.files += 1
    count.lines += len(path.read_text(encoding="utf-8").splitlines())
    named = [node for node in tree.body if isinstance(node, FUNCTIONS | ast.ClassDef)]
    count.public += sum(not node.name.startswith("_") for node in named)
    with path.open("rb") as file:
        tokens = tokenize.tokenize(file.readline)
        count.comments += sum(token.type == tokenize.COMMENT and not PRAGMA.match(token.string) for token in tokens)
    for node in ast.walk(tree):
        if isinstance(node, FUNCTIONS):
            body = node.body[ast.get_docstring(node) is not None :]
            count.bodies.append((body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0)
            given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs, node.args.vararg, node.args.kwarg]
            annotations = [one.annotation for one in given if one is not None and one.annotation is not None]
            count.arguments += len(annotations)
            count.of_any += sum(isinstance(one, ast.Name) and one.id in unknown for one in annotations)


def _aliases_of_any(tree: ast.Module) -> Iterator[str]:
    """Yield aliases of Any, as in `Array = Any`."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Name) and node.value.id == "Any":
            yield from (target.id for target in node.targets if isinstance(target, ast.Name))


def files_visited(package: Path) -> int | None:
    """Return the number of files used between a range and a setpoint, or None if the checkout cannot fly."""
    ran = subprocess.run(
        [sys.executable, "-c", TRACE, str(package.resolve())], cwd=package.resolve().parent, check=False,
        env={**os.environ, "PYTHONPATH": "."}, capture_output=True, text=True,
    )  # fmt: skip
    return int(ran.stdout) if ran.returncode == 0 else None


def files_naming(checkout: Path, *folders: str) -> dict[str, int]:
    """Return, for each kind of option, the number of files that contain its rarest name. The other names also occur in
    examples."""
    paths = [path for folder in folders for path in (checkout / folder).rglob("*.*") if path.suffix in WRITTEN]
    texts = [re.sub("[_ -]", "", path.read_text(encoding="utf-8").lower()) for path in paths]
    counts = {}
    for kind, names in NAMED.items():
        wanted = [f"[\"'`]{name}[\"'`]" if kind == "law" else name for name in names]
        counts[kind] = min(sum(re.search(name, text) is not None for text in texts) for name in wanted)
    return counts


def main(folders: list[str]) -> None:
    """Print the figures of each package."""
    packages = [Path(folder).resolve() for folder in folders] or [HERE / name for name in PACKAGES]
    print(f"{'':<28}" + "".join(f"{heading:>{len(heading) + 3}}" for heading in HEADINGS))
    for package in packages:
        for room, count in sorted(measure(package).items()):
            cells = zip(HEADINGS, count.row(), strict=True)
            print(f"{room:<28}" + "".join(f"{cell:>{len(heading) + 3}}" for heading, cell in cells))
    for package in packages:
        if package.name == "circnav_mav":
            visited = files_visited(package)
            print(f"\n{package}")
            print(f"files that a range visits on its way to a setpoint: {'not known' if visited is None else visited}")
            whole = files_naming(package.parent, *ALL)
            for kind, code in files_naming(package.parent, *ALL[:2]).items():
                print(f"files that name a {kind}: {code} of product and emulator, {whole[kind]} of all")


if __name__ == "__main__":
    main(sys.argv[1:])
