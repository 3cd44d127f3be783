"""How a fact about a mission or a vehicle comes out, and its line."""

from dataclasses import dataclass
from enum import Enum


class Grade(Enum):
    """How a check came out. FAIL refuses the flight."""

    PASS = "PASS"
    WARN = "WARN"
    FAIL = "FAIL"


PASS, WARN, FAIL = Grade


@dataclass(frozen=True, slots=True)
class Check:
    grade: Grade
    subject: str
    says: str


def graded(value: float, *, warn_above: float, fail_above: float) -> Grade:
    """The grade of a number that should be small."""
    return FAIL if value > fail_above else WARN if value > warn_above else PASS
