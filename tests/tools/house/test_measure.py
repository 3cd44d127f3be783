"""The measuring script runs, and its figures of a small package equal the figures counted by hand."""

from pathlib import Path

from tests.tools.house import measure

ROOM = '''"""A room."""

from typing import Any

Array = Any


def open_door(width: float, key: Array, *rest: Any, plain=1) -> None:  # noqa: this is none
    """Its docstring is no body."""
    # why
    print(width,
          key)


class Window:
    def _close(self, hard: bool) -> None:
        pass
'''


def test_a_small_house_is_counted_as_by_hand(tmp_path):
    package = tmp_path / "circnav_mav"
    (package / "room").mkdir(parents=True)
    (package / "room" / "doors.py").write_text(ROOM)
    (package / "hall.py").write_text('LAW = "relay"  # a law\n')
    counts = measure.measure(package)
    assert list(counts) == ["circnav_mav", "circnav_mav/room"]
    assert counts["circnav_mav"].row() == ["2", "18", "111.1", "11.1", "50 %", "2"]
    assert measure.files_naming(tmp_path, "circnav_mav", "sim")["law"] == 0, "the least named of them"
    assert measure.files_visited(package) is None, "nothing there can fly"


def test_every_figure_of_this_house_is_printed(capsys):
    measure.main([str(Path(measure.__file__).parents[3] / "circnav_mav")])
    printed = capsys.readouterr().out
    assert "circnav_mav/guidance " in printed
    for line in ("on its way to a setpoint: ", "name a law: ", "name a vehicle: ", "name a ranging message: "):
        figure = printed.partition(line)[2].split()[0]
        assert 1 <= int(figure) < 60, line
