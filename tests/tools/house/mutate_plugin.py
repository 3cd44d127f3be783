"""Plugin of pytest for mutate.py, which copies it beside the tests. It records the functions that each test calls, or
runs chosen tests in a given order."""

import json
import os
import sys
import threading
from pathlib import Path
from types import FrameType

import pytest

RECORD, CHOSEN = os.environ.get("MUTATE_RECORD"), os.environ.get("MUTATE_CHOSEN")
"""File to write what was recorded, and file with the names of the chosen tests."""
IMPORT = "import"
"""Where calls are noted before the first test: imports and collection."""

called: dict[str, set[tuple[str, int]]] = {IMPORT: set()}
seconds: dict[str, float] = {}
failed: set[str] = set()
noted = called[IMPORT]


def note(frame: FrameType, event: str, argument: object) -> None:
    """Note a call of a function. Its lines are not traced."""
    noted.add((frame.f_code.co_filename, frame.f_code.co_firstlineno))


def note_in(where: str) -> None:
    """Note calls from now on under this name: a test, or a file for what its fixtures call."""
    global noted
    noted = called.setdefault(where, set())


if RECORD:
    threading.settrace(note)
    sys.settrace(note)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    note_in(item.nodeid.split("::")[0])


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_call(item: pytest.Item) -> None:
    note_in(item.nodeid)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_teardown(item: pytest.Item) -> None:
    note_in(item.nodeid.split("::")[0])


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Keep the time of a test that passed. Skipped and failed tests are not chosen later."""
    if report.failed:
        failed.add(report.nodeid)
    elif report.when == "call" and report.passed:
        seconds[report.nodeid] = report.duration


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep the chosen tests alone, in their order."""
    if CHOSEN:
        names = json.loads(Path(CHOSEN).read_text(encoding="utf-8"))
        found = {item.nodeid: item for item in items}
        items[:] = [found[name] for name in names if name in found]


def pytest_sessionfinish() -> None:
    """Write what was recorded: calls inside the current folder, time of each test, failed tests."""
    if RECORD:
        sys.settrace(None)
        here = f"{Path.cwd()}{os.sep}"
        inside = {
            where: [(path.removeprefix(here), line) for path, line in sorted(calls) if path.startswith(here)]
            for where, calls in called.items()
        }
        places = {name: getattr(module, "__file__", None) or "" for name, module in sorted(sys.modules.items())}
        libraries = [name for name, path in places.items() if "site-packages" in path and not path.startswith(here)]
        result = {"libraries": libraries, "called": inside, "seconds": seconds, "failed": sorted(failed)}
        Path(RECORD).write_text(json.dumps(result), encoding="utf-8")
