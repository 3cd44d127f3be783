"""A small seeded share of the fuzzing; the million: python -m tests.faults.fuzz."""

import pytest

from tests.faults.files import assault_files
from tests.faults.fuzz import run


@pytest.mark.parametrize("what", ["mutated", "valid", "flood"])
def test_hostile_frames_neither_crash_the_pilot_nor_make_it_say_anything_unsafe(what: str) -> None:
    broken, _ = run(what, 12_000, seed=2)
    assert broken == []


def test_damaged_files_are_refused_in_one_line_or_read_as_far_as_they_go() -> None:
    assert assault_files(60, seed=2) == []
