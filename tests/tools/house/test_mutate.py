"""Mutants are drawn by the seed, applied to a copy alone, and judged by the tests that call the function."""

import ast
from pathlib import Path

import pytest

from tests.process import PATIENCE, python
from tests.tools.house.mutate import Finder, draw

DOOR = '''"""A door of 2 m."""

WIDTH = 2.0  # m


def fits(size: float = 1.0) -> bool:
    """True if it fits through 2 doors."""
    if size < 0:
        raise ValueError(f"{size + 1} m")
    return size < WIDTH and not size == WIDTH


def unused(size: float) -> float:
    size = min(size, -WIDTH)
    return size


class Door:
    def __repr__(self) -> str:
        return "x" * 3
'''
TEST = """from circnav_mav.hall.door import WIDTH, fits


def test_a_door_of_two_meters():
    assert fits(1.5) and WIDTH == 2.0


def test_a_fault_of_the_test():
    assert fits(3.0)
"""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    for folder in ("circnav_mav/hall", "tests/hall"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "circnav_mav/hall/door.py").write_text(DOOR)
    (tmp_path / "tests/hall/test_door.py").write_text(TEST)
    return tmp_path


def test_mutations_change_code_and_neither_texts_nor_annotations() -> None:
    found = Finder("door.py", DOOR.encode(), 1).found
    for mutant in found:
        assert ast.dump(ast.parse(mutant.applied(DOOR.encode()))) != ast.dump(ast.parse(DOOR))
    assert sorted((mutant.line, mutant.what, mutant.function) for mutant in found) == [
        (3, "constant: 2.0 -> 4.0", 0),
        (6, "constant: 1.0 -> 2.0", 0),
        (8, "comparison: size < 0 -> size <= 0", 6),
        (8, "comparison: size < 0 -> size >= 0", 6),
        (8, "constant: 0 -> 1", 6),
        (9, "removed: raise ValueError(f'{size + 1} m') -> pass", 6),
        (10, "boolean: size < WIDTH and (not size == WIDTH) -> size < WIDTH or not size == WIDTH", 6),
        (10, "comparison: size < WIDTH -> size <= WIDTH", 6),
        (10, "comparison: size < WIDTH -> size >= WIDTH", 6),
        (10, "comparison: size == WIDTH -> size != WIDTH", 6),
        (10, "negated: not size == WIDTH -> size == WIDTH", 6),
        (14, "removed: size = min(size, -WIDTH) -> pass", 13),
        (14, "sign: -WIDTH -> WIDTH", 13),
        (14, "swapped: min -> max", 13),
    ]


def test_a_draw_follows_its_seed_and_not_the_lines(checkout: Path) -> None:
    drawn = [mutant.what for mutant in draw(checkout, "circnav_mav/hall", 1, 5)]
    assert len(drawn) == 5
    assert drawn != [mutant.what for mutant in draw(checkout, "circnav_mav/hall", 2, 5)]
    (checkout / "circnav_mav/hall/door.py").write_text("# moved\n" + DOOR)
    assert drawn == [mutant.what for mutant in draw(checkout, "circnav_mav/hall", 1, 5)]


def test_mutants_are_judged_in_a_copy_and_results_are_kept(checkout: Path) -> None:
    def mutate() -> str:
        command = ["-m", "tests.tools.house.mutate", "circnav_mav/hall", "--checkout", str(checkout), "--seed", "9"]
        with python(*command, "--count", "5", "--keep", str(checkout / "kept")) as process:
            return process.communicate(timeout=PATIENCE)[0]

    printed = mutate()
    heading, rest = printed.split("\n", 1)
    assert heading == "# hall: 1 tests pass unmutated, failing: ['tests/hall/test_door.py::test_a_fault_of_the_test']"
    assert "door.py:10  comparison: size < WIDTH -> size >= WIDTH\n    killed by tests/hall/test_door.py::" in rest
    assert "door.py:3  constant: 2.0 -> 4.0\n    killed by tests/hall/test_door.py::" in rest
    assert "door.py:6  constant: 1.0 -> 2.0\n    survived\n" in rest
    assert "door.py:14  swapped: min -> max\n    not called\n" in rest
    assert (checkout / "circnav_mav/hall/door.py").read_text() == DOOR
    assert mutate() == rest, "nothing runs a second time"
