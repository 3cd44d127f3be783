"""The table of docs/faults.md: a line for each fault, with the worst of its cells."""

from tests.faults.cell import Scenario, Verdict, Want
from tests.faults.matrix import FAULTS, by_fault


def verdict(want: Want, profile: str, faults: tuple[str, ...] = (), **figures: float | str) -> Verdict:
    known = {"rms": 0.0, "worst_age": 0.0, "to_safe": None, "recovery": None, "rejects": {}, "outcome": ""} | figures
    return Verdict(
        Scenario("F2", f"{want.value} {figures}", want=want), profile, 1, faults, engaged=True, reported=(), **known
    )


def test_a_fault_is_a_line_with_the_worst_of_its_cells_and_who_passed_them_all() -> None:
    """By hand: a circle left on purpose (an outage) does not count as one that was held badly."""
    table = by_fault([
        verdict(Want.HOLD, "arducopter", rms=0.006, recovery=0.0),
        verdict(Want.HOLD, "arduplane", rms=0.011, recovery=0.0),
        verdict(Want.REGAIN, "arducopter", rms=1.4, recovery=21.6),
        verdict(Want.END, "arduplane", ("flew on",), rms=1.4, to_safe=3.0, outcome="no vehicle"),
    ])  # fmt: skip
    *_, line = table.splitlines()
    wants = "holds the circle; regains the circle; ends the mission"
    assert line == f"| F2 | {FAULTS['F2']} | 4 | {wants} | 1.1 | 21.6 | 3.0 | arducopter |"
