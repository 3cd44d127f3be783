"""Result of a check of a mission or a vehicle, with its line of text."""

from dataclasses import dataclass
from enum import Enum


class Grade(Enum):
    """Outcome of a check. FAIL prevents the flight."""

    PASS = "PASS"
    WARN = "WARN"
    FAIL = "FAIL"


PASS, WARN, FAIL = Grade


@dataclass(frozen=True, slots=True)
class Check:
    grade: Grade
    subject: str
    text: str


def graded(value: float, *, warn_above: float, fail_above: float) -> Grade:
    """Return the grade of a number that should be small."""
    return FAIL if value > fail_above else WARN if value > warn_above else PASS
