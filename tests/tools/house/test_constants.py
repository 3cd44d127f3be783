"""Constants are found with value, unit and origin, and are scaled before any use."""

import sys
from pathlib import Path

import pytest

from tests.tools.house import constants
from tests.tools.house.constants import Constant, Finder, apart, effect, effects, page, reached, scaled

ROOM = '''"""A room."""

from math import pi

WIDTH, COUNT = 2.0, 3
"""Of the door, m; and how many, chosen."""
NAMES = ("a", "b")
ALL = (WIDTH, 1)
FAR = WIDTH  # another name
TURN = 2 * pi
NICE = 5  # of the process
R, THETA = range(2)


def area():
    return WIDTH**2
'''


@pytest.fixture
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "room_of_constants.py").write_text(ROOM)
    monkeypatch.setattr(constants, "ROOT", tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "room_of_constants", raising=False)
    return "room_of_constants.py"


def test_numbers_that_are_written_are_constants_and_other_names_of_them_are_not(room: str) -> None:
    found = constants.constants(room)
    assert [(one.name, one.value, one.unit) for one in found] == [
        ("WIDTH", "2", "m"), ("COUNT", "3", "m"), ("ALL", "(2, 1)", ""), ("TURN", "6.28319", ""), ("NICE", "5", ""),
    ]  # fmt: skip
    assert [one.name for one in found if not one.origin] == ["ALL", "TURN"]
    assert found[-1].origin == "of the process"


@pytest.mark.parametrize(("name", "value"), [("WIDTH", (4.0, 3, (4.0, 1))), ("COUNT", (2.0, 6, (2.0, 1)))])
def test_a_constant_is_scaled_before_others_are_made_of_it(
    room: str, monkeypatch: pytest.MonkeyPatch, name: str, value: object
) -> None:
    monkeypatch.setattr(sys, "meta_path", [Finder("room_of_constants", name, 2.0), *sys.meta_path])
    import room_of_constants as loaded  # type: ignore[import-not-found]

    found = loaded.WIDTH, loaded.COUNT, loaded.ALL
    assert found == value


def test_counts_stay_counts() -> None:
    assert scaled((1, 3, (0.5, -2)), 0.5) == (1, 2, (0.25, -1))


def test_a_constant_is_reached_by_a_function_that_runs_or_by_another_constant(room: str) -> None:
    assert "WIDTH" not in reached(constants.constants(room), set())
    assert "WIDTH" in reached(constants.constants(room), {(room, 15)})


def test_effects_are_those_flown_else_those_of_the_page() -> None:
    one = Constant("circnav_mav/guidance/room.py", "WIDTH", "2", "Of the door, m.")
    base = {"plane": (1.0, 4.0)}
    done = {"base": base, "reached": ["WIDTH"], "room.WIDTH=2 x0.5": {"plane": (1.5, 3.0)}, "room.WIDTH=2 x2": base}
    assert effect(done["room.WIDTH=2 x0.5"], base) == "+50, -25 %"
    assert effects(one, done, {}) == "+50, -25 %; none"
    old = page([one], done, "")
    assert "| `WIDTH` | room.py | 2 | m | +50, -25 %; none | Of the door, m. |" in old
    assert page([one], {}, old) == old


def test_every_constant_of_the_product_has_an_origin() -> None:
    assert [f"{one.module}: {one.name}" for one in apart(constants.all_constants) if not one.origin] == []
