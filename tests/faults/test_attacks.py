"""The attack table, row by row; as a table: tests.faults.attacks."""

import pytest

from tests.faults.attacks import row
from tests.faults.cell import Scenario, fly
from tests.faults.scenarios.attacks import ATTACKS


@pytest.mark.parametrize("scenario", ATTACKS, ids=[one.level for one in ATTACKS])
def test_an_attack_moves_nothing_and_the_operator_is_told(scenario: Scenario) -> None:
    verdict = fly(scenario, "arducopter", seed=1)
    assert verdict.passed, row(verdict)
